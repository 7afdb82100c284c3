"""Values of the safe set at a state, for texts and plots."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.safety.chain import Chain

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SafetyValues:
    """h of pairs, and the chain of h_tot, compiled when first asked for."""

    chain: Chain

    def h(self, pair: int, x: Array) -> float:
        """One pair's h at a state, shape (n̄,)."""
        # Compiled one by one: a live frame asks for its worst pair alone, and of many pairs only
        # few are ever the worst.
        if pair not in self._of_pair:
            composed = self.chain.set
            self._of_pair[pair] = CompiledFunction([composed.x], [composed.h[pair]])
        return float(self._of_pair[pair](x)[0][0])

    def worst_pair(self, x: Array) -> int:
        """The pair whose h is largest."""
        return int(np.argmax(self._of_all_pairs(x)[0]))

    def higher_psi(self, x: Array) -> Array:
        """ψ_1^d ... ψ_{q-1}^d, shape (q - 1,)."""
        return self._higher_psi(x)[0] if len(self.chain.psi) > 1 else np.zeros(0)

    @cached_property
    def _of_pair(self) -> dict[int, CompiledFunction]:
        return {}

    @cached_property
    def _of_all_pairs(self) -> CompiledFunction:
        return CompiledFunction([self.chain.set.x], [self.chain.set.h])

    @cached_property
    def _higher_psi(self) -> CompiledFunction:
        composed = self.chain.set
        higher = ca.vertcat(*[composed.substitute(psi) for psi in self.chain.psi[1:]])
        return CompiledFunction([composed.x], [higher])
