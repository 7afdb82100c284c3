"""An agent's input by the controller that its group names, in place of the paper's filter."""

from collections.abc import Callable, Mapping

import numpy as np

from phalanx.scenario.model import ScenarioError
from phalanx.schema.registry import part_of_agent
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.laws.law import (
    CheckedInput,
    ControlledAgent,
    Controller,
    ControllerView,
    Received,
    View,
)
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.decision import Decision
from phalanx.theory.rows.information import ReceivedInput
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.qp import NearestInput

Certified = Callable[[Array, Array, tuple[int, ...]], float]
"""(stacked state, shape (n̄,), own input, agents seen) -> time proven safe [s]."""


class OwnController:
    """One agent's controller, whose inputs are checked and brought into U_i."""

    def __init__(
        self, rows: SafetyRows, i: int, controller: Controller, certified: Certified
    ) -> None:
        """controller: prepared for the agent."""
        member = rows.swarm.members[i]
        self._input, self._certified = CheckedInput(controller, member), certified
        self._nearest = NearestInput(member.dynamics.input_metric())
        self._pairs = rows.plain_pairs(i)

    def __call__(
        self,
        view: View,
        u_nom: Array,
        x: Array,
        in_sight: tuple[int, ...],
        t: float,
        received: Mapping[int, ReceivedInput],
    ) -> tuple[Decision, dict[str, float]]:
        """Return the decision for what wish takes, and notes.

        The input is projected onto U_i by the dynamics' metric if it is outside.

        Raises:
            MistakenMethodError: a user's controller returned anything but an input, raised, or does
                not return.
            ArithmeticError: the projection fails.
        """
        inputs = view.terms.polytopes[view.i]
        u, notes = self.wish(view, u_nom, x, in_sight, t, received)
        if inputs.takes(u):
            return Decision(u, Origin.CONTROLLER, None), notes
        return Decision(self._projected(u, inputs), Origin.PROJECTED, None), notes

    def wish(
        self,
        view: View,
        u_nom: Array,
        x: Array,
        in_sight: tuple[int, ...],
        t: float,
        received: Mapping[int, ReceivedInput],
    ) -> tuple[Array, dict[str, float]]:
        """Return the input, shape (m_i,), wherever it is, and notes.

        It is for the stacked state x, shape (n̄,), sampled at t [s].

        Raises MistakenMethodError.
        """
        inputs, notes = view.terms.polytopes[view.i], dict[str, float]()
        controller_view = ControllerView(
            t,
            view.i,
            view.x,
            view.normal,
            view.goal,
            u_nom,
            {l: Received(np.array(h.u), t - h.t_apply) for l, h in received.items()},
            inputs,
            view.terms,
            lambda: self._pairs(x, in_sight),
            lambda u: self._projected(u, inputs),
            lambda u: self._certified(x, u, in_sight),
            notes,
            view.age,
            view.boxes,
        )
        return self._input(controller_view), notes

    def _projected(self, u: Array, inputs: Polytope) -> Array:
        inside = self._nearest.solve(u, inputs)
        if inside is None:
            raise ArithmeticError(f"the input {u} cannot be brought within the input polytope")
        return inside


def own_controller(
    rows: SafetyRows, i: int, certified: Certified | None = None
) -> OwnController | None:
    """Build agent i's controller; None if it applies the paper's filter.

    certified: by default by the verdict's certificates.

    Raises ScenarioError if it does not fit the agent.
    """
    swarm = rows.swarm
    group = swarm.groups[i]
    controller: Controller | None = (
        part_of_agent("agents.program")(swarm, i) if group.program else group.fresh_controller()
    )
    if controller is None:
        return None
    safety = swarm.safety
    agent = ControlledAgent(
        i,
        swarm.members,
        swarm.scenario.static,
        safety.safe_set_function,
        safety.class_k,
        group.clock.period,
        swarm.horizon(i),
        swarm.sensing(i),
        swarm.seed,
    )
    try:
        controller.prepare(agent)
    except ValueError as error:
        raise ScenarioError(
            f"{swarm.scenario.name}: controller of {swarm.names[i]}: {error}"
        ) from error
    certified = certified or part_of_agent("agents.controller certified")(swarm, i)
    return OwnController(rows, i, controller, certified)
