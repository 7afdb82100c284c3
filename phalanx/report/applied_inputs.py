"""Figures of an agent's inputs: applied and nominal, within their bounds."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phalanx.arrays import Array
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Step
from phalanx.report.measures import extremes_kept
from phalanx.report.style import LIMIT, MUTED, colours, legend, panels
from phalanx.swarm.swarm import Swarm
from phalanx.theory.models.polytope import Box, constant_polytope
from phalanx.theory.models.units import units
from phalanx.theory.rows.origin import Origin, words_of


class Curve(NamedTuple):
    """One quantity of an agent's steps."""

    label: str
    values: Array
    """shape (s,)"""
    bounds: tuple[float, ...]
    nominal: Array | None = None
    """What its law would have had, shape (s,)."""


def inputs(recording: Recording, swarm: Swarm, i: int) -> Figure:
    """Agent i's inputs beside the nominal ones, their bounds, and a mark where K_i was empty."""
    name = swarm.members[i].name
    steps = steps_by_agent(recording)[name]
    wanted = np.array([s.u_nom for s in steps]) if all(s.u_nom for s in steps) else None
    curves = input_curves(swarm, i, np.array([s.u for s in steps]), wanted)
    figure, rows = panels(len(curves), 1.9)
    applied = np.array([s.t_apply for s in steps])
    held_until = max(recording.times[-1], applied[-1])
    for curve, axes in zip(curves, rows, strict=True):
        if curve.nominal is not None:
            kept = extremes_kept(curve.nominal)
            axes.step(
                applied[kept],
                curve.nominal[kept],
                where="post",
                color=MUTED,
                linewidth=0.7,
            )
        kept = extremes_kept(curve.values)
        axes.step(
            [*applied[kept], held_until],
            [*curve.values[kept], curve.values[-1]],
            where="post",
            color=colours(recording.scenario)[name],
            linewidth=0.9,
        )
        for bound in curve.bounds:
            axes.axhline(bound, color=LIMIT, linestyle=":", linewidth=1.2)
        _mark_empty(axes, steps, curve.values)
        axes.set_ylabel(curve.label)
        axes.margins(x=0.01)
        axes.set_ylim(*_shown(curve))
    rows[-1].set_xlabel("t [s]")
    rows[0].plot([], [], color=colours(recording.scenario)[name], label="applied")
    if wanted is not None:
        rows[0].plot([], [], color=MUTED, label="nominal")
    legend(rows[0], f"agent {name}")
    return figure


def _shown(curve: Curve) -> tuple[float, float]:
    """Where a curve and its bounds lie, and a little more: a nominal input may lie far outside."""
    values = [*curve.bounds, float(curve.values.min()), float(curve.values.max())]
    margin = 0.12 * (max(values) - min(values)) or 1.0
    return min(values) - margin, max(values) + margin


def input_curves(swarm: Swarm, i: int, u: Array, nominal: Array | None = None) -> list[Curve]:
    """Every component of agent i's inputs u, shape (s, m_i); before them ‖u‖_∞ if U_i is its ball.

    The norm is what the paper plots of Simulation 2.
    """
    names, box = swarm.members[i].dynamics.inputs, input_box(swarm, i)
    bounds = [(box.low[c], box.high[c]) if box else () for c in range(len(names))]
    of_input = units(swarm.members[i].dynamics).inputs
    curves = [
        Curve(
            f"{n} [{of_input[n] or 'SI'}]",
            u[:, c],
            bounds[c],
            None if nominal is None else nominal[:, c],
        )
        for c, n in enumerate(names)
    ]
    radius = box.high[0] if box else np.nan
    if box and len(names) > 1 and (box.high == radius).all() and (box.low == -radius).all():
        unit = of_input[names[0]] or "SI"
        curves.insert(0, Curve(f"‖u‖∞ [{unit}]", np.abs(u).max(axis=1), (radius,)))
    return curves


def _mark_empty(axes: Axes, steps: list[Step], values: Array) -> None:
    origins, applied = np.array([s.origin for s in steps]), np.array([s.t_apply for s in steps])
    for origin, colour, size in (
        (Origin.NO_AUTHORITY, "#f2a7a0", 14),
        (Origin.BACKUP, "#e00000", 26),
    ):
        marked = origins == origin
        label = f"{words_of(origin)} ({marked.sum()} steps)"
        places = applied[marked], values[marked]
        axes.scatter(
            *places, marker="x", s=size, linewidths=1.0, color=colour, label=label, zorder=3
        )


def input_box(swarm: Swarm, i: int) -> Box | None:
    """Agent i's bounds, if U_i is a box that does not depend on the state."""
    composed = swarm.safe_set
    A, b = swarm.members[i].dynamics.input_polytope(composed.x[composed.parts[i]])
    known = constant_polytope(A, b)
    return known.box if known else None
