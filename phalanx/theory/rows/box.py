"""The QP in a box with one row, solved as what it is: one number to find, the row's multiplier.

With the multiplier λ >= 0 of the row, the nearest input is u_k(λ) = u_nom_k - λ a_k / (2 w_k),
clipped to its bounds. aᵀu(λ) falls along straight pieces from that of the clipped nominal input to
the least in the box, so λ lies on the piece along which it passes the bound: no iteration, and
nothing that could fail to converge.
"""

from collections.abc import Sequence

from phalanx.theory.expressions.exact import added

_Component = tuple[float, float, float, float, float]
"""u_nom, -du/dλ, least, greatest, a"""


def nearest_in_box(
    u_nom: Sequence[float],
    weights: Sequence[float],
    low: Sequence[float],
    high: Sequence[float],
    a: Sequence[float],
    bound: float,
    tolerance: float,
) -> list[float] | None:
    """argmin of Σ w (u - u_nom)² over low <= u <= high and aᵀu <= bound, each of m numbers.

    Plain numbers: so few of them are several times faster than arrays.

    Args:
        tolerance: how far the least aᵀu may be above the bound, over Σ |a|. Then that is the
            answer; beyond it there is none, and None is returned.
    """
    components = [
        (wanted, c / (w + w), least, greatest, c)
        for wanted, w, least, greatest, c in zip(u_nom, weights, low, high, a, strict=True)
    ]
    u, value = _at(components, 0.0)
    if value <= bound:
        return u
    # aᵀu(λ) bends where a component reaches one of its bounds.
    ends = [
        (wanted - end) / slope
        for wanted, slope, least, greatest, _ in components
        if slope != 0.0
        for end in (least, greatest)
    ]
    begin = 0.0
    for end in sorted(ends):
        if end <= 0.0:
            continue
        u, then = _at(components, end)
        if then <= bound:
            return _at(components, begin + (end - begin) * (value - bound) / (value - then))[0]
        begin, value = end, then
    return u if value - bound <= tolerance * added(map(abs, a)) else None


def _at(components: Sequence[_Component], multiplier: float) -> tuple[list[float], float]:
    """u(λ) and aᵀu(λ)."""
    u, value = [], 0.0
    for wanted, slope, least, greatest, c in components:
        component = wanted - multiplier * slope
        if component < least:
            component = least
        elif component > greatest:
            component = greatest
        u.append(component)
        value += c * component
    return u, value
