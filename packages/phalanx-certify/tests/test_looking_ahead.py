"""The judge and the independent checker look equally far ahead."""

from phalanx_certify.checker.bounds import _HORIZONS

from phalanx.guarantee.certificate import MULTIPLES


def test_the_checker_looks_as_far_as_the_judge_and_slightly_beyond_the_next_input():
    """Shorter ones leave a run certified for exactly τ a gap of one rounding at every input."""
    multiples = tuple(multiple for multiple, _ in _HORIZONS)
    assert multiples == MULTIPLES
    assert min(multiples) > 1.0
