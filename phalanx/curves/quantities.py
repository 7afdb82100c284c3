"""The numbers of control steps as they are plotted, and inputs with their bounds."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.curves.history import AgentSeries
from phalanx.curves.thinning import Series
from phalanx.swarm.swarm import Swarm, unit_of_psi
from phalanx.theory.models.dynamics import units
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.safety.composition import FAR
from phalanx.wire.step_report import OF_ROW, QUANTITIES, Quantity

LEAST_HORIZON = 0.1
"""Where a certified time is drawn that is shorter than this many τ: no logarithm has a 0."""
NOBODY_NEAR = 1e-3 * FAR
"""A residual this small is no row's: no pair was composed, so that none had to be kept."""


def of_steps(swarm: Swarm, name: str, steps: Mapping[int, AgentSeries]) -> dict[int, Series]:
    """A number of these agents' control steps, as it is plotted."""
    return {
        i: Series(s.t, plotted(QUANTITIES[name], s.numbers[name], swarm.horizon(i)))
        for i, s in steps.items()
    }


def plotted(quantity: Quantity, values: Array, horizon: float) -> Array:
    """A number's values as its plot shows them, of an agent with this τ [s]."""
    if quantity.in_horizons:
        return np.maximum(values / horizon, LEAST_HORIZON)
    if quantity.unit == OF_ROW:
        return np.where(values > NOBODY_NEAR, values, np.nan)
    return 1e3 * values if quantity.unit == "s" else values


def plotted_unit(quantity: Quantity, swarm: Swarm) -> str:
    """The unit of its plot."""
    if quantity.in_horizons:
        return "τ"
    return "ms" if quantity.unit == "s" else unit_of(quantity, swarm)


def unit_of(quantity: Quantity, swarm: Swarm) -> str:
    """That of a number as it is recorded; "" if it has none, or none is known."""
    of_row = quantity.unit == OF_ROW
    return unit_of_psi(swarm.scenario, swarm.pairs.degree) if of_row else quantity.unit


class InputCurve(NamedTuple):
    """One component of an agent's inputs."""

    name: str
    unit: str
    applied: Series
    nominal: Series
    """NaN where it is not known."""
    bounds: tuple[float | None, float | None]
    """Least and largest; None where they vary."""


def input_curves(swarm: Swarm, i: int, steps: AgentSeries) -> list[InputCurve]:
    """Every component of agent i's inputs."""
    dynamics, bounds = swarm.members[i].dynamics, input_bounds(swarm, i)
    of_input = units(dynamics).inputs
    return [
        InputCurve(
            name,
            of_input[name],
            Series(steps.t, steps.u[:, c]),
            Series(steps.t, steps.u_nom[:, c]),
            (None, None) if bounds is None else (float(bounds[0][c]), float(bounds[1][c])),
        )
        for c, name in enumerate(dynamics.inputs)
    ]


def input_bounds(swarm: Swarm, i: int) -> tuple[Array, Array] | None:
    """Agent i's least and largest inputs, shapes (m_i,); None where they vary."""
    x = swarm.safe_set.x[swarm.safe_set.parts[i]]
    known = constant_polytope(*swarm.members[i].dynamics.input_polytope(x))
    return None if known is None else (known.corners.min(axis=0), known.corners.max(axis=0))
