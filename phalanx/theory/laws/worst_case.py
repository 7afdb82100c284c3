"""The attack that the paper's bounds assume: the input that raises h_tot fastest."""

from dataclasses import dataclass

from phalanx.arrays import Array
from phalanx.theory.laws.law import View
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import maximiser


@dataclass
class WorstCase:
    """u_j^max of Eq. (adversarialu): the largest push on ψ_q that U_j allows."""

    def prepare(self, dynamics: Dynamics) -> None:
        """Fits every dynamics."""

    def input(self, view: View) -> Array:
        return maximiser(view.terms.c[view.i], view.terms.polytopes[view.i].corners)
