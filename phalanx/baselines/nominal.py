"""`none`: no safety filter at all."""

from dataclasses import dataclass

from phalanx.arrays import Array
from phalanx.theory.controllers.controller import ControlledAgent, ControllerView


@dataclass(frozen=True)
class Nominal:
    """The nominal input, clipped to what the actuators take."""

    def prepare(self, agent: ControlledAgent) -> None:
        """Prepare nothing."""

    def input(self, view: ControllerView) -> Array:
        """Return u_nom; the run projects it onto U_i."""
        return view.u_nom
