"""The judge: the safe set, the certificates that a guarantee rests on, the theorem's assumptions.

Outcome and certificates follow from the true states and the applied inputs alone. What agents say
about how they made their inputs only counts for the theorem's assumptions.
"""

import numpy as np

from phalanx.arrays import Array
from phalanx.guarantee.verdict import Assumption
from phalanx.network.inbox import Claim
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.expressions.asked import place_of
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.rows.origin import EMPTY, Origin
from phalanx.wire.messages import Telemetry
from phalanx_plant.events.events import InputApplied, InputLost, Sampled, StateReached
from phalanx_plant.judge.assumptions import STAYED, Assumptions
from phalanx_plant.judge.claims import Claims
from phalanx_plant.judge.coverage import Coverage
from phalanx_plant.world.actuators import Actuators
from phalanx_plant.world.extremes import PairExtremes
from phalanx_plant.world.integration import DisturbanceKnot
from phalanx_plant.world.truth import IntegrationSteps
from phalanx_plant.world.world import DivergedError

_ROUNDING = 1e-9


class Judge:
    """Sees the world at every event, every sample and every applied input."""

    def __init__(self, rows: SafetyRows) -> None:
        swarm = rows.swarm
        self.extremes = PairExtremes(swarm.safe_set)
        self.coverage = Coverage(swarm)
        self.claims = Claims(swarm)
        self.steps = 0
        """Inputs applied."""
        self.origins = {str(o): 0 for o in Origin if o is not Origin.ATTACK}
        """Steps of normal agents by how their input was made."""
        self._swarm = swarm
        self._latency = swarm.scenario.time.latency
        self._longest_gap = [g.clock.period + g.clock.jitter + _ROUNDING for g in swarm.groups]
        self._bounds = np.array([g.disturbance.bound for g in swarm.groups])
        self._parts = swarm.safe_set.parts
        self._begins = [part.start for part in self._parts]
        self._x = swarm.start()
        """The true stacked state at the last event, shape (n̄,)."""
        self._in_force: dict[int, float] = {}
        """When each agent's input took effect [s]."""
        self._actuators = Actuators(swarm)
        self._at_zero = {i: np.zeros(len(m.dynamics.inputs)) for i, m in enumerate(swarm.members)}
        """What actuators hold before their first input, of those that have had none."""
        self._sampled: dict[int, float] = {}
        self._sampled_in: dict[int, Array] = {}
        """The true state that each agent last sampled."""
        self._instants: dict[int, float] = {}
        """When the first normal agent took its sample k [s], by k."""
        self._turned: set[int] = set()
        self._checks = Assumptions(swarm, self.coverage.assumption, self.claims.truthful)
        self._highest = -np.inf
        """The largest ψ_1 ... ψ_{q-1} so far."""
        inside = bool((rows.invariants()(self._x) <= 0.0).all())
        self._checks.start_kept.check(inside, 0.0)
        self.coverage.begin(self._x)

    @property
    def backups(self) -> int:
        """Steps of normal agents at which u_i^min was applied, for K_i was empty."""
        return self.origins[Origin.BACKUP]

    @property
    def assumptions(self) -> list[Assumption]:
        """What `guaranteed` rests on, and how often each failed so far."""
        return self._checks.of_guarantee

    @property
    def theorem(self) -> list[Assumption]:
        """What the paper's theorem needs, and how often each failed so far."""
        return self._checks.of_theorem

    def reached(self, event: StateReached, seen: list[IntegrationSteps | DisturbanceKnot]) -> None:
        """The world went on to another event; seen: on the way. Raises DivergedError."""
        self.saw(seen)
        self.coverage.reached(event.t)
        if event.t > 0.0:
            for i, zero in self._at_zero.items():
                self._check_input(i, self._x, zero, 0.0)
        self._x = event.x

    def saw(self, seen: list[IntegrationSteps | DisturbanceKnot]) -> None:
        """What the world went through. Raises DivergedError."""
        for piece in seen:
            if isinstance(piece, DisturbanceKnot):
                norms = np.sqrt(np.add.reduceat(piece.phi * piece.phi, self._begins))
                # Norms are convex: within the bound at the knots, within it on the line between.
                self._checks.disturbance.check(
                    bool((norms <= self._bounds * (1.0 + _ROUNDING)).all()), piece.t
                )
                continue
            if not (np.abs(piece.h_tot) <= LARGEST).all():
                raise self._diverged(piece)
            if self._checks.start.checked == 0:
                self._checks.start.check(bool((piece.h[0] <= 0.0).all()), float(piece.times[0]))
            self.extremes.add(piece.times, piece.pairs, piece.h, piece.h_tot)
            for t, resolved in zip(piece.times.tolist(), piece.resolved.tolist(), strict=True):
                self._checks.resolved.check(resolved, t)
            for t, psi in zip(piece.times.tolist(), piece.psi.tolist(), strict=False):
                self._check_invariance(t, psi)

    def _diverged(self, steps: IntegrationSteps) -> DivergedError:
        """Which pair's h is not finite, and the method that says it; h_tot, if none is."""
        composed, t = self._swarm.safe_set, float(steps.times[-1])
        bad = ~(np.abs(steps.h) <= LARGEST).all(axis=0)
        if not bad.any():
            return DivergedError("h_tot", t)
        pair = composed.pairs[int(steps.pairs[np.argmax(bad)])]
        return DivergedError(f"h of {composed.label(pair)}", t, place_of(*composed.asked(pair)))

    def _check_invariance(self, t: float, psi: float) -> None:
        stayed = self._checks.stayed
        stayed.check(psi <= 0.0, t)
        if not psi <= self._highest:
            self._highest = psi
            if not psi <= 0.0:
                stayed.note = f"{STAYED}; the largest was {psi:.4g}, at t = {t:.3f} s"

    def sampled(self, event: Sampled) -> None:
        """An agent took a sample."""
        i, t, truthful = event
        if i in self._swarm.normal:
            self._checks.truthful.check(truthful, t)
        if i in self._sampled:
            self._checks.gap.check(t - self._sampled[i] <= self._longest_gap[i], t)
        self._sampled[i] = t
        self._sampled_in[i] = self._x

    def fell_silent(self, i: int, t: float) -> None:
        """Agent i neither samples nor answers from t [s] on."""
        if i in self._swarm.normal:
            self._checks.faithful.check(False, t)

    def turned(self, i: int) -> None:
        """Agent i became an adversary.

        From now on its pairs without a normal agent are nobody's safety: those of adversaries
        are not in the safe set either.
        """
        self._turned.add(i)
        normal = set(self._swarm.normal) - self._turned
        pairs = enumerate(self._swarm.safe_set.pairs)
        apart = np.array([k for k, p in pairs if not {p.a, p.b} & normal], dtype=np.intp)
        self.extremes.set_apart(apart)
        self.coverage.turned(i, apart)

    def applied(self, event: InputApplied, telemetry: Telemetry, proven: Array) -> float | None:
        """An actuator took its input; proven: as Coverage has it.

        Returns how long all pairs of a normal agent are certified from now on [s].
        """
        self.steps += 1
        self._given(event.i, event.k, event.t, event.u)
        self._checks.prompt.check(
            event.t_apply - event.t <= self._latency + _ROUNDING, event.t_apply
        )
        if event.i in self._swarm.normal:
            if telemetry.report.origin == Origin.ATTACK:
                self._checks.faithful.check(False, event.t)
            else:
                self._check_step(event, telemetry)
        self._in_force[event.i] = event.t_apply
        self._at_zero.pop(event.i, None)
        self._check_input(event.i, self._sampled_in.get(event.i, self._x), event.u, event.t_apply)
        return self.coverage.applied(event.i, event.t_apply, proven)

    def lost(self, event: InputLost) -> None:
        """An input never came to its actuator."""
        self._given(event.i, event.k, event.sampled, event.u)
        self._checks.prompt.check(False, event.t)

    def _given(self, i: int, k: int, sampled: float, u: Array) -> None:
        self.claims.given(i, k, Claim(sampled + self._latency, tuple(u.tolist())))

    def _check_input(self, i: int, x: Array, u: Array, t: float) -> None:
        self._checks.inputs.check(self._actuators.takes(i, x[self._parts[i]], u), t)

    def _check_step(self, event: InputApplied, telemetry: Telemetry) -> None:
        origin = telemetry.report.origin
        self.origins[origin] += 1
        self._checks.rows.check(origin not in EMPTY, event.t)
        first = self._instants.setdefault(event.k, event.t)
        self._checks.synchronous.check(first == event.t, event.t)
        for other, age in telemetry.ages:
            # An agent never heard of has no input in force; an age of one is a lie.
            in_force = self._in_force.get(other, -np.inf)
            self._checks.fresh.check(abs(in_force - (event.t - age)) <= _ROUNDING, event.t)
