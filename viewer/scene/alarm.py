"""Who is unsafe, how deep and since when, in words."""

from phalanx.arrays import Array
from phalanx.guarantee.verdict import Violation
from phalanx.viewer.scene.model import SceneModel


def alarms(
    model: SceneModel, unsafe: list[int], violations: tuple[Violation, ...], x: Array, p: Array
) -> list[str]:
    """A line for each unsafe pair, the deepest first.

    Args:
        model: of the swarm.
        unsafe: the pairs with h > 0.
        violations: what is known of the run so far.
        x: the state, shape (n̄,).
        p: output points, shape (N, 3).
    """
    since = {violation.pair: violation.first for violation in violations}
    lines = []
    for pair in unsafe:
        label = model.label(pair)
        first = f", since t = {since[label]:.3f} s" if label in since else ""
        lines.append(f"{label} unsafe: {model.told(pair, x, p)} where 0 is allowed{first}")
    return lines


def past_alarms(
    model: SceneModel, unsafe: list[int], violations: tuple[Violation, ...], t: float
) -> list[str]:
    """A line for each pair that was unsafe before t [s], and is not any more."""
    now = {model.label(pair) for pair in unsafe}
    lines = []
    for violation in violations:
        if violation.pair not in now and violation.first <= t:
            deepest = f", up to h = {violation.worst:.3g}" if violation.worst_at <= t else ""
            lines.append(
                f"{violation.pair} was unsafe from t = {violation.first:.3f} s on{deepest}"
            )
    return lines
