"""The check of a controller's inputs, since it may be a user's own."""

from phalanx.arrays import Array
from phalanx.theory.controllers.controller import ControlledAgent, Controller, ControllerView
from phalanx.theory.expressions.user_methods import call_user
from phalanx.theory.laws.law import checked_input, expected_input
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.decision import Decision
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.qp import NearestInput


class CheckedController:
    """One agent's controller, whose inputs are checked and brought into U_i."""

    def __init__(self, controller: Controller, agent: ControlledAgent) -> None:
        """controller: prepared for the agent."""
        member = agent.members[agent.i]
        self._controller, self._agent = controller, member.name
        self._size = len(member.dynamics.inputs)
        self._nearest = NearestInput(member.dynamics.input_metric())
        self._watched = not type(controller).__module__.startswith("phalanx.")

    def __call__(self, view: ControllerView) -> Decision:
        """The input to apply, projected onto U_i by the dynamics' metric if it is outside.

        Raises:
            MistakenMethodError: a user's controller returned anything but an input, raised, or does
                not return.
            ArithmeticError: the projection fails.
        """
        u = self._input(view)
        if view.inputs.takes(u):
            return Decision(u, Origin.CONTROLLER, None)
        return Decision(self.project(u, view.inputs), Origin.PROJECTED, None)

    def project(self, u: Array, inputs: Polytope) -> Array:
        """The input nearest to u by the dynamics' metric. Raises ArithmeticError if it fails."""
        inside = self._nearest.solve(u, inputs)
        if inside is None:
            raise ArithmeticError(f"the input {u} cannot be brought within the input polytope")
        return inside

    def _input(self, view: ControllerView) -> Array:
        controller, size, agent = self._controller, self._size, self._agent
        if self._watched:
            u = call_user(controller, "input", expected_input(size), view, agent=agent)
        else:
            u = controller.input(view)
        return checked_input(controller, u, size, agent)
