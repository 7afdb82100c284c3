"""`none`, no safety filter at all, and `escape`, which forgets the task."""

from dataclasses import dataclass

from phalanx.theory.arrays import Array
from phalanx.theory.laws.law import ControlledAgent, ControllerView
from phalanx.theory.models.polytope import minimiser


@dataclass(frozen=True)
class Nominal:
    """The nominal input, clipped to what the actuators take."""

    def prepare(self, agent: ControlledAgent) -> None:
        """Prepare nothing."""

    def input(self, view: ControllerView) -> Array:
        """Return u_nom; the run projects it onto U_i."""
        return view.u_nom


@dataclass(frozen=True)
class Escape:
    """Flight from whatever is nearest, by the pair with the largest h."""

    def prepare(self, agent: ControlledAgent) -> None:
        """Prepare nothing."""

    def input(self, view: ControllerView) -> Array:
        """Return the corner of U_i that lowers ψ_q of that pair most; u_nom if none is in sight."""
        pairs = view.pairs
        if not len(pairs.psi):
            return view.u_nom
        return minimiser(pairs.a[pairs.psi[:, 0].argmax()], view.inputs.corners)
