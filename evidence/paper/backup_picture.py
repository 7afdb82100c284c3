"""Draw the region where the backup suffices, as a slice of the state space of two agents.

python evidence/paper/backup_picture.py one-on-one backup.png [--set FIELD=VALUE]
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from phalanx.report.style import style_axes
from phalanx.scenario.load import load
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.margins.margin import RowPart

_CELLS = 121
_UNSAFE, _TOO_LATE, _SUFFICES = range(3)
_LOOKS = {
    _UNSAFE: ("#5b6068", "outside S_I"),
    _TOO_LATE: ("#f4b6b0", "inside, but even u^min leaves ψ_q + η > 0"),
    _SUFFICES: ("#bfe3c6", "inside, and u^min suffices"),
}


class Slice(NamedTuple):
    """Results on a grid of positions of the other agent relative to the normal one."""

    normal: str
    other: str
    axes: tuple[Array, Array]
    """Δx and Δy [m], shapes (c,)."""
    results: Array
    """_UNSAFE, _TOO_LATE or _SUFFICES, shape (c, c), rows by Δy."""


def main() -> None:
    """Draw the slice of a scenario as PNG."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("scenario")
    arguments.add_argument("picture", type=Path)
    arguments.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE")
    options = arguments.parse_args()
    plane = backup_slice(build_rows(build_swarm(load(options.scenario, options.set))))
    if plane is None:
        raise SystemExit("expected two agents with states x and y")
    backup_figure(plane).savefig(options.picture, dpi=110)


def backup_slice(rows: SafetyRows) -> Slice | None:
    """Test Σ γ_min + Σ γ_max + α_q + η <= 0 with one agent moved around another.

    The other agent is the nearest adversary, or the nearest normal agent if there is none.
    Headings, velocities and all other states are as at the start.

    The slice reaches four times as far as the distance at which h = 0 along the line between the
    two. Returns None if the swarm has no second agent with states x and y.
    """
    swarm = rows.swarm
    pair = _nearest_pair(swarm)
    if pair is None:
        return None
    a, b = swarm.safe_set.pairs[pair]
    moved = _Moved(rows, pair, (a, b))
    half = 4.0 * _required_distance(moved)
    offsets = np.linspace(-half, half, _CELLS)
    dy, dx = np.meshgrid(offsets, offsets, indexing="ij")
    psi, residual = moved(np.column_stack([dx.ravel(), dy.ravel()]))
    inside = np.where(residual <= 0, _SUFFICES, _TOO_LATE)
    results = np.where((psi > 0).any(axis=1), _UNSAFE, inside).reshape(dx.shape)
    return Slice(swarm.names[a], swarm.names[b], (offsets, offsets), results)


def backup_figure(plane: Slice) -> Figure:
    """Draw the slice."""
    figure = Figure(figsize=(6.4, 5.2), layout="constrained", facecolor="white")
    axes = figure.subplots()
    style_axes(axes)
    colours = [_LOOKS[k][0] for k in sorted(_LOOKS)]
    axes.pcolormesh(*plane.axes, plane.results, cmap=ListedColormap(colours), vmin=0, vmax=2)
    axes.plot(0, 0, marker="o", color="#1f5fbf")
    axes.annotate(plane.normal, (0, 0), textcoords="offset points", xytext=(6, 4))
    axes.set_aspect("equal")
    axes.set_xlabel(f"position of agent {plane.other} relative to {plane.normal}: Δx [m]")
    axes.set_ylabel("Δy [m]")
    handles = [Patch(color=colour, label=label) for colour, label in _LOOKS.values()]
    figure.legend(handles=handles, loc="outside lower center", ncols=1, frameon=False)
    return figure


class _Moved:
    """ψ of a pair and the condition of its backup, with the second member moved."""

    def __init__(self, rows: SafetyRows, pair: int, ends: tuple[int, int]) -> None:
        swarm, chain = rows.swarm, rows.pair_chain(pair)
        self._polytopes = rows.composed.members.constant_polytopes
        self._ends = ends
        self._helping = [not swarm.members[l].adversary for l in ends]
        self._start = np.concatenate([swarm.start()[swarm.safe_set.parts[l]] for l in ends])
        states = swarm.members[ends[1]].dynamics.states
        self._axes = [chain.set.parts[1].start + states.index(s) for s in "xy"]
        unforced, margin = (
            ca.sum1(chain.drift) + chain.alpha,
            rows.margin(ends[0]).of(chain, 0, RowPart.WHOLE),
        )
        self._columns = np.cumsum([len(chain.psi), 1, chain.actuation[0].numel()])
        self._evaluate = MappedFunction(
            [chain.set.x], [*chain.psi, unforced + margin, *chain.actuation]
        )

    def __call__(self, offsets: Array) -> tuple[Array, Array]:
        """ψ_0 ... ψ_{q-1}, shape (s, q), and Σ γ_min + Σ γ_max + α_q + η, (s,).

        offsets: the second member's position from the first's [m], shape (s, 2).
        """
        x = np.tile(self._start, (len(offsets), 1))
        x[:, self._axes] = self._start[:2] + offsets
        values = self._evaluate(x.ravel(), np.arange(x.size).reshape(x.shape))
        psi, residual, *c = np.split(values, self._columns, axis=1)
        total = residual[:, 0]
        for l, forces, helps in zip(self._ends, c, self._helping, strict=True):
            values = dot(forces[:, None], self._polytopes[l].corners)
            total = total + (values.min(axis=1) if helps else values.max(axis=1))
        return psi, total


def _nearest_pair(swarm: Swarm) -> int | None:
    composed, start = swarm.safe_set, swarm.start()
    candidates = []
    for index, pair in enumerate(composed.pairs):
        if pair.b >= len(swarm.members):
            continue
        both = [swarm.members[l].dynamics.states for l in pair]
        if any(states[:2] != ("x", "y") for states in both):
            continue
        here, there = (start[composed.parts[l]][:2] for l in pair)
        friend = not swarm.members[pair.b].adversary
        candidates.append((friend, float(np.linalg.norm(here - there)), index))
    return min(candidates)[2] if candidates else None


def _required_distance(moved: _Moved) -> float:
    """Distance at which h turns negative when the other agent is moved away along x [m]."""
    distances = np.geomspace(0.05, 500.0, 200)
    psi, _ = moved(np.column_stack([distances, np.zeros_like(distances)]))
    safe = distances[psi[:, 0] <= 0]
    return float(safe[0]) if len(safe) else 1.0


if __name__ == "__main__":
    main()
