"""The judge and the independent checker look equally far ahead."""

from phalanx.certify.checker.bounds import _RUNGS
from phalanx.guarantee.certificate import MULTIPLES


def test_the_checker_looks_as_far_as_the_judge_and_a_hair_beyond_the_next_input():
    """With less, a run that is certified for exactly τ has a gap of one rounding at every input."""
    multiples = tuple(multiple for multiple, _ in _RUNGS)
    assert multiples == MULTIPLES
    assert min(multiples) > 1.0
