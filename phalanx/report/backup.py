"""Where the backup still suffices: a slice of the state space of two agents."""

from typing import NamedTuple

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from phalanx.arrays import Array
from phalanx.report.style import ReportFigure, style_axes
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.row import joint_sum
from phalanx.theory.rows.terms import Terms, TermsFunction

_CELLS = 121
_UNSAFE, _TOO_LATE, _SUFFICES = range(3)
_LOOKS = {
    _UNSAFE: ("#5b6068", "outside S_I"),
    _TOO_LATE: ("#f4b6b0", "inside, but even u^min leaves ψ_q + η > 0"),
    _SUFFICES: ("#bfe3c6", "inside, and u^min suffices"),
}


class Slice(NamedTuple):
    """Answers on a grid of the other agent's place relative to the normal one."""

    normal: str
    other: str
    axes: tuple[Array, Array]
    """Δx and Δy [m], shapes (c,)."""
    answers: Array
    """_UNSAFE, _TOO_LATE or _SUFFICES, shape (c, c), rows by Δy."""


def backup_slice(rows: SafetyRows, reach: float | None = None) -> Slice | None:
    """Move one agent around another and ask whether Σ γ_min + Σ γ_max + α_q + η <= 0.

    The other agent is the nearest adversary, or the nearest normal agent if there is none; all
    else, headings and velocities among it, is as at the start.

    Args:
        rows: of the scenario.
        reach: half-width of the slice [m]; by default four times the distance at which h = 0
            along the line between the two.

    Returns:
        None if the swarm has no second agent with states x and y.
    """
    swarm = rows.swarm
    pair = _nearest_pair(swarm)
    if pair is None:
        return None
    a, b = swarm.safe_set.pairs[pair].a, swarm.safe_set.pairs[pair].b
    assert b is not None
    chain = rows.pair_chain(pair)
    start = np.concatenate([swarm.start()[swarm.safe_set.parts[l]] for l in (a, b)])
    evaluate = TermsFunction(chain, margin=rows.margin(a).of(chain, 0))
    helping = (0,) if swarm.members[b].adversary else (0, 1)
    place = [chain.set.parts[1].start + swarm.members[b].dynamics.states.index(s) for s in "xy"]
    half = reach or 4.0 * _required_distance(evaluate, start, place)
    offsets = np.linspace(-half, half, _CELLS)
    answers = np.empty((_CELLS, _CELLS))
    x = start.copy()
    for row, dy in enumerate(offsets):
        for column, dx in enumerate(offsets):
            x[place] = start[:2] + np.array([dx, dy])
            answers[row, column] = _answer(evaluate(x), helping)
    return Slice(swarm.names[a], swarm.names[b], (offsets, offsets), answers)


def backup_plate(found: Slice) -> ReportFigure:
    """The slice as a figure."""
    figure = Figure(figsize=(6.4, 5.2), layout="constrained", facecolor="white")
    axes = figure.subplots()
    style_axes(axes)
    colours = [_LOOKS[k][0] for k in sorted(_LOOKS)]
    axes.pcolormesh(*found.axes, found.answers, cmap=ListedColormap(colours), vmin=0, vmax=2)
    axes.plot(0, 0, marker="o", color="#1f5fbf")
    axes.annotate(found.normal, (0, 0), textcoords="offset points", xytext=(6, 4))
    axes.set_aspect("equal")
    axes.set_xlabel(f"place of agent {found.other} beside {found.normal}: Δx [m]")
    axes.set_ylabel("Δy [m]")
    handles = [Patch(color=colour, label=label) for colour, label in _LOOKS.values()]
    figure.legend(handles=handles, loc="outside lower center", ncols=1, frameon=False)
    caption = (
        f"Where the backup of agent {found.normal} still suffices against agent "
        f"{found.other}, the two of them alone; headings and velocities as at the start."
    )
    return ReportFigure("backup", caption, figure)


def _answer(terms: Terms, helping: tuple[int, ...]) -> int:
    if (terms.psi > 0).any():
        return _UNSAFE
    return _SUFFICES if joint_sum(terms, helping) <= 0 else _TOO_LATE


def _nearest_pair(swarm: Swarm) -> int | None:
    composed, start = swarm.safe_set, swarm.start()
    candidates = []
    for index, pair in enumerate(composed.pairs):
        if pair.b is None:
            continue
        both = [swarm.members[l].dynamics.states for l in (pair.a, pair.b)]
        if any(states[:2] != ("x", "y") for states in both):
            continue
        here, there = (start[composed.parts[l]][:2] for l in (pair.a, pair.b))
        friend = not swarm.members[pair.b].adversary
        candidates.append((friend, float(np.linalg.norm(here - there)), index))
    return min(candidates)[2] if candidates else None


def _required_distance(evaluate: TermsFunction, start: Array, place: list[int]) -> float:
    """Distance at which h turns negative when the other agent walks away along x [m]."""
    x = start.copy()
    for distance in np.geomspace(0.05, 500.0, 200):
        x[place] = start[:2] + np.array([distance, 0.0])
        if evaluate(x).psi[0] <= 0:
            return float(distance)
    return 1.0
