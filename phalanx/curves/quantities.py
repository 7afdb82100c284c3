"""The numbers of control steps as they are plotted, and inputs with their bounds."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.curves.history import AgentSeries
from phalanx.curves.thinning import Series
from phalanx.swarm.swarm import Swarm, unit_of_psi
from phalanx.theory.models.dynamics import units
from phalanx.theory.models.polytope import Polytope, constant_polytope
from phalanx.theory.safety.composition import FAR
from phalanx.wire.step_report import OF_ROW, QUANTITIES, Quantity

LEAST_HORIZON = 0.1
"""Where a certified time is drawn that is shorter than this many τ: no logarithm has a 0."""
NO_ROW = 1e-3 * FAR
"""A residual at or below this is no row's: no pair was composed, so that none had to be kept."""


def step_series(swarm: Swarm, name: str, steps: Mapping[int, AgentSeries]) -> dict[int, Series]:
    """A number of these agents' control steps over time, in the plot's unit."""
    return {
        i: Series(s.t, plotted(QUANTITIES[name], s.numbers[name], swarm.horizon(i)))
        for i, s in steps.items()
    }


def plotted(quantity: Quantity, values: Array, horizon: float) -> Array:
    """Convert values to the unit of their plot, for an agent with this τ [s]."""
    if quantity.in_horizons:
        return np.maximum(values / horizon, LEAST_HORIZON)
    if quantity.unit == OF_ROW:
        return np.where(values > NO_ROW, values, np.nan)
    return 1e3 * values if quantity.unit == "s" else values


def plotted_unit(quantity: Quantity, swarm: Swarm) -> str:
    """Unit of the number's plot."""
    if quantity.in_horizons:
        return "τ"
    return "ms" if quantity.unit == "s" else unit_of(quantity, swarm)


def unit_of(quantity: Quantity, swarm: Swarm) -> str:
    """Unit of a number as it is recorded; "" if it has none, or none is known."""
    of_row = quantity.unit == OF_ROW
    return unit_of_psi(swarm.scenario, swarm.pairs.degree) if of_row else quantity.unit


class InputCurve(NamedTuple):
    """One component of an agent's inputs."""

    name: str
    unit: str
    applied: Series
    nominal: Series
    """NaN where it is unknown."""
    bounds: tuple[float | None, float | None]
    """Least and largest; None where they vary."""


def input_curves(swarm: Swarm, i: int, steps: AgentSeries) -> list[InputCurve]:
    """Every component of agent i's inputs."""
    dynamics, known = swarm.members[i].dynamics, input_polytope(swarm, i)
    unknown = [(None, None)] * len(dynamics.inputs)
    bounds = [(min(c), max(c)) for c in known.corners.T.tolist()] if known else unknown
    input_units = units(dynamics).inputs
    return [
        InputCurve(
            name,
            input_units[name],
            Series(steps.t, steps.u[:, c]),
            Series(steps.t, steps.u_nom[:, c]),
            bounds[c],
        )
        for c, name in enumerate(dynamics.inputs)
    ]


def input_polytope(swarm: Swarm, i: int) -> Polytope | None:
    """Agent i's U_i; None where it depends on the state."""
    x = swarm.safe_set.x[swarm.safe_set.parts[i]]
    return constant_polytope(*swarm.members[i].dynamics.input_polytope(x))
