"""Sampling instants t_i^{k+1} = t_i^k + Γ_i + δ_i(k), Eq. (perturbedT)."""

import math

from phalanx.seeded.draws import Seeds, Tables


class SamplingClock:
    """One agent's perturbed clock, identical in the plant and in the agent."""

    def __init__(self, seeds: Seeds | int, agent: str, period: float, jitter: float) -> None:
        """Γ_i = period [s]; δ_i(k) uniform in ±jitter, with jitter = δ_i^max < period [s]."""
        self._period = period
        self._jitter = jitter
        self._tables = Tables(seeds, "clock", agent)

    def after(self, k: int, t: float, now: float = 0.0) -> float:
        """Return t_i^{k+1} [s], given that sample k was at t_i^k = t [s].

        now: when this is decided [s].
        """
        draws = self._tables.decide(k, now)()
        delta = self._jitter * (2.0 * draws.value(k) - 1.0)
        return t + self._period + delta

    def most_samples(self, duration: float) -> int:
        """Bound the number of samples in a run of this duration [s].

        Twice as many as fit: an agent that is thawed samples at once, out of turn.
        """
        return 1000 + 2 * math.ceil(duration / (self._period - self._jitter))
