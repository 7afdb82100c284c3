"""The judge: hashes the trajectory, counts steps, and checks the theorem's assumptions."""

import hashlib
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from phalanx.guarantee.verdict import Assumption
from phalanx.plant.truth import PairExtremes
from phalanx.plant.world import DisturbanceKnot, IntegrationSteps
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.information import Information
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import Input

Array = NDArray[np.float64]

_ROUNDING = 1e-9


class Judge:
    """Sees the world at every event, every sample and every applied input."""

    def __init__(self, swarm: Swarm) -> None:
        self.truth = PairExtremes(swarm.chain.set)
        self.steps = 0
        """Inputs applied."""
        self.origins = {str(o): 0 for o in Origin if o is not Origin.ATTACK}
        """Steps of normal agents by how their input was made."""
        self._swarm = swarm
        self._trajectory = hashlib.sha256()
        groups = [group for _, group, _ in swarm.scenario.roster()]
        self._longest_gap = [g.clock.period + g.clock.jitter + _ROUNDING for g in groups]
        self._bounds = np.array([g.disturbance.bound for g in groups])
        self._parts = [part.start for part in swarm.chain.set.parts]
        self._in_force: dict[int, Input] = {}
        self._sampled: dict[int, float] = {}
        self._instants: dict[int, float] = {}
        """When the first normal agent took its sample k [s], by k."""
        self._start = Assumption("start in S", note="x(0) lies in S_I: ψ_0 ... ψ_{q-1} <= 0")
        self._gap = Assumption("sampling gap", note="t_i^{k+1} - t_i^k <= Γ_i + δ^max")
        self._phi = Assumption("disturbance bound", note="‖φ_i‖ <= φ_i^max")
        self._rows = Assumption("non-empty K_i", note="every normal agent's row had a solution")
        self._fresh = Assumption("fresh û", note="every û_l that a row used was in force")
        self._faithful = Assumption("faithful agents", note="no normal agent fell silent or turned")
        self._together = Assumption(
            "synchronous sampling", note="all normal agents sample at the same instants"
        )
        gaps = swarm.gaps_in_the_proof()
        note = "; ".join(gaps) or "the margin is a bound, computed at each sample"
        self._margin = Assumption("proven margin", note=note)
        self._margin.check(not gaps, 0.0)
        self._starts_inside = bool((swarm.invariants()(swarm.start())[0] <= 0.0).all())

    @property
    def trajectory(self) -> str:
        """SHA-256 of all states at events and all applied inputs so far."""
        return self._trajectory.hexdigest()

    @property
    def backups(self) -> int:
        """Steps of normal agents whose K_i was empty."""
        return sum(self.origins.values()) - self.origins[Origin.QP]

    @property
    def assumptions(self) -> list[Assumption]:
        """The theorem's assumptions, and how often each failed so far."""
        found = [self._start, self._gap, self._phi, self._rows, self._margin]
        found += [self._faithful] if self._faithful.failed else []
        safety = self._swarm.scenario.safety
        if safety.control == "centralised":
            return [*found, self._together]
        relies_on_received = safety.information in (Information.PAPER, Information.IN_FLIGHT)
        return [*found, self._fresh] if relies_on_received else found

    def fell_silent(self, i: int, t: float) -> None:
        """Agent i neither samples nor answers from t [s] on."""
        if i in self._swarm.normal:
            self._faithful.check(False, t)

    def saw(self, seen: Iterable[IntegrationSteps | DisturbanceKnot]) -> None:
        """What the world went through."""
        for piece in seen:
            self._saw(piece)

    def _saw(self, seen: IntegrationSteps | DisturbanceKnot) -> None:
        if isinstance(seen, DisturbanceKnot):
            norms = np.sqrt(np.add.reduceat(seen.phi * seen.phi, self._parts))
            # Norms are convex: within the bound at the knots, within it on the line between.
            self._phi.check(bool((norms <= self._bounds * (1.0 + _ROUNDING)).all()), seen.t)
            return
        if self._start.checked == 0:
            inside = self._starts_inside and bool((seen.h[0] <= 0.0).all())
            self._start.check(inside, float(seen.times[0]))
        self.truth.add(*seen)

    def at_event(
        self, t: float, x: Array, seen: Iterable[IntegrationSteps | DisturbanceKnot]
    ) -> None:
        """The world's stacked state, shape (n̄,), at t [s], and what was seen on the way there."""
        self.saw(seen)
        self._trajectory.update(np.float64(t).tobytes() + x.tobytes())

    def sampled(self, i: int, t: float) -> None:
        """Agent i samples at t [s]."""
        if i in self._sampled:
            self._gap.check(t - self._sampled[i] <= self._longest_gap[i], t)
        self._sampled[i] = t

    def applied(self, i: int, message: Input) -> None:
        """Agent i's actuator takes its input."""
        self._trajectory.update(np.array([i, message.k, *message.u]).tobytes())
        self.steps += 1
        if i in self._swarm.normal and message.origin == Origin.ATTACK:
            self._faithful.check(False, message.t)
        elif i in self._swarm.normal:
            self.origins[message.origin] += 1
            self._rows.check(message.origin == Origin.QP, message.t)
            together = self._instants.setdefault(message.k, message.t) == message.t
            self._together.check(together, message.t)
            for other, age in enumerate(message.ages):
                if age is not None:
                    sent = message.t - age
                    holds = abs(self._in_force[other].t_apply - sent) <= _ROUNDING
                    self._fresh.check(holds, message.t)
        self._in_force[i] = message
