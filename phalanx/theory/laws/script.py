"""Inputs that are written down beforehand: constant between given instants, whatever is seen."""

from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import casadi as ca
import numpy as np
from annotated_types import Ge, Le, MinLen

from phalanx.arrays import Array
from phalanx.theory.laws.law import View
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import constant_polytope

Instant = Annotated[float, Ge(0), Le(1e9)]
Number = Annotated[float, Ge(-1e9), Le(1e9)]


@dataclass
class Script:
    """u(t) = inputs[k] from at[k] until at[k + 1]: the attack of a search, or of a person.

    An agent changes its input at its first sample at or after the instant. It keeps the last one.
    """

    at: Annotated[tuple[Instant, ...], MinLen(1)]
    """When each input begins [s]: 0 first, then ascending."""
    inputs: Annotated[tuple[tuple[Number, ...], ...], MinLen(1)]
    """One input of U_j for each instant, in the order of the dynamics' inputs."""

    def __post_init__(self) -> None:
        """Raises ValueError unless each instant has an input, and instants ascend from 0."""
        if len(self.at) != len(self.inputs):
            raise ValueError(
                f"expected an input for each instant of at: {len(self.at)}, got {len(self.inputs)}"
            )
        if self.at[0] != 0.0:
            raise ValueError(f"expected at to begin with 0, got {self.at[0]:g}")
        for earlier, later in pairwise(self.at):
            if later <= earlier:
                raise ValueError(f"expected at to ascend, got {later:g} after {earlier:g}")

    def prepare(self, dynamics: Dynamics) -> None:
        """Take the inputs for a dynamics. Raises ValueError if one is not in its U."""
        size, x = len(dynamics.inputs), ca.SX.sym("x", len(dynamics.states))
        names = ", ".join(dynamics.inputs)
        known = constant_polytope(*dynamics.input_polytope(x))
        self._inputs = [np.array(u, dtype=np.float64) for u in self.inputs]
        for place, u in enumerate(self._inputs):
            if len(u) != size:
                raise ValueError(f"inputs.{place}: expected {size} numbers ({names}), got {len(u)}")
            # Where U depends on the state, an input outside is projected onto it.
            if known is not None and not known.takes(u):
                raise ValueError(
                    f"inputs.{place}: expected ({names}) within U, {_extent(known.corners)}, "
                    f"got {list(self.inputs[place])}"
                )

    def input(self, view: View) -> Array:
        return self._inputs[bisect_right(self.at, view.t) - 1]


def _extent(corners: Array) -> str:
    """Bounds of each input in words, from the corners of U, shape (v, m)."""
    bounds = zip(corners.min(axis=0).tolist(), corners.max(axis=0).tolist(), strict=True)
    return " x ".join(f"[{low:g}, {high:g}]" for low, high in bounds)
