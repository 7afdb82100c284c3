"""An agent's input by the controller that its group names, in place of the paper's filter."""

from collections.abc import Callable, Mapping

import numpy as np

from phalanx.arrays import Array
from phalanx.scenario.load import ScenarioError
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.user_methods import MistakenMethodError, call_user
from phalanx.theory.laws.controller import (
    CheckedController,
    ControlledAgent,
    ControllerView,
    Received,
)
from phalanx.theory.laws.law import View
from phalanx.theory.rows.decision import Decision
from phalanx.theory.rows.information import ReceivedInput

Certified = Callable[[Array, Array, tuple[int, ...]], float]
"""(stacked state, shape (n̄,), own input, agents seen) -> time proven safe [s]."""


class OwnController:
    """Makes the views of one agent's controller, and calls it."""

    def __init__(
        self, rows: SafetyRows, i: int, controller: CheckedController, certified: Certified
    ) -> None:
        self._controller, self._certified = controller, certified
        self._pairs = rows.plain_pairs(i)

    def __call__(
        self,
        view: View,
        u_nom: Array,
        x: Array,
        seen: tuple[int, ...],
        t: float,
        received: Mapping[int, ReceivedInput],
    ) -> tuple[Decision, dict[str, float]]:
        """Return the input for the stacked state x, shape (n̄,), sampled at t [s], and its notes.

        Raises as CheckedController.
        """
        inputs, notes = view.terms.polytopes[view.i], dict[str, float]()
        decision = self._controller(
            ControllerView(
                t,
                view.i,
                view.x,
                view.normal,
                view.goal,
                u_nom,
                {l: Received(np.array(h.u), t - h.t_apply) for l, h in received.items()},
                inputs,
                view.terms,
                lambda: self._pairs(x, seen),
                lambda u: self._controller.project(u, inputs),
                lambda u: self._certified(x, u, seen),
                notes,
            )
        )
        return decision, notes


def own_controller(rows: SafetyRows, i: int, certified: Certified) -> OwnController | None:
    """Build agent i's controller; None if it applies the paper's filter.

    Raises ScenarioError if it does not fit the agent.
    """
    swarm = rows.swarm
    controller = swarm.groups[i].fresh_controller()
    if controller is None:
        return None
    agent = _agent(swarm, i)
    try:
        if type(controller).__module__.startswith("phalanx."):
            controller.prepare(agent)  # unwatched: a library may take its time to compile
        else:
            call_user(controller, "prepare", "no error", agent, agent=swarm.names[i])
    except (MistakenMethodError, ValueError) as error:
        reason = error.__cause__ if isinstance(error.__cause__, ValueError) else error
        raise ScenarioError(
            f"{swarm.scenario.name}: controller of {swarm.names[i]}: {reason}"
        ) from error
    return OwnController(rows, i, CheckedController(controller, agent), certified)


def _agent(swarm: Swarm, i: int) -> ControlledAgent:
    safety = swarm.safety
    return ControlledAgent(
        i,
        swarm.members,
        swarm.scenario.static,
        safety.safe_set_function,
        safety.class_k,
        swarm.groups[i].clock.period,
        swarm.horizon(i),
        swarm.sensing(i),
        swarm.seed,
    )
