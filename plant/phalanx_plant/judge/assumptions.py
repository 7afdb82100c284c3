"""What a guarantee and the paper's theorem assume of a run, each counted as often as it is asked.

What agents say about how they made their inputs only counts for the theorem's assumptions. Which of
them count depends on the scenario, and some on what happened.
"""

import numpy as np

from phalanx.arrays import Array
from phalanx.guarantee.advice import gaps_in_the_proof
from phalanx.guarantee.certificate import DEFECT
from phalanx.guarantee.verdict import Assumption
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.origin import EMPTY, Origin
from phalanx.wire.messages import Telemetry
from phalanx_plant.world.events import InputApplied, InputLost, Sampled, StateReached
from phalanx_plant.world.truth import IntegrationSteps
from phalanx_plant.world.world import Actuators, DisturbanceKnot

_STAYED = "no ψ_1 ... ψ_{q-1} was above 0: from there the safe set cannot be kept for sure"
_ROUNDING = 1e-9


class Assumptions:
    """The assumptions of one run, checked at every event."""

    def __init__(self, rows: SafetyRows, certificates: Assumption, broadcasts: Assumption) -> None:
        """Of one run: certificates says that they covered it, broadcasts that all were true."""
        swarm = self._swarm = rows.swarm
        self._certificates, self._broadcasts = certificates, broadcasts
        self._start = Assumption("start in S", note="every pair is safe at the start")
        self._start_kept = Assumption(
            "start in S_I", note="every agent starts where the safe set can be kept"
        )
        self._gap = Assumption(
            "sampling gap", note="no sample came later than clock.period + clock.jitter"
        )
        self._disturbance = Assumption(
            "disturbance bound", note="no disturbance was larger than disturbance.bound"
        )
        self._resolved = Assumption(
            "resolved motion",
            note=f"no integration step was off the equation of motion by more than {DEFECT:g} in "
            "a second, which certificates allow for; a shorter time.integration_step and dynamics "
            "without kinks bring it down",
        )
        self._inputs = Assumption("admissible inputs", note="no actuator held an input outside U")
        self._prompt = Assumption(
            "inputs in time", note="every input came to its actuator when it was due"
        )
        self._rows = Assumption(
            "non-empty K_i", note="at every step of every normal agent some input kept its rows"
        )
        self._fresh = Assumption(
            "received inputs in force",
            note="every received input that a row counted on was being applied",
        )
        self._faithful = Assumption("faithful agents", note="no normal agent fell silent or turned")
        self._truthful = Assumption(
            "truthful sensors", note="every sample of a normal agent told the true state"
        )
        self._synchronous = Assumption(
            "synchronous sampling", note="all normal agents sample at the same instants"
        )
        self._margin = _proven_margin(swarm)
        self._stayed = Assumption("stayed in S_I", note=_STAYED)
        self._latency = swarm.time.latency
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
        self._sampled: dict[int, tuple[float, Array]] = {}
        """When each agent last sampled [s], and the true state then."""
        self._instants: dict[int, float] = {}
        """When the first normal agent took its sample k [s], by k."""
        self._highest = -np.inf
        """The largest ψ_1 ... ψ_{q-1} so far."""
        self._start_kept.check(bool((rows.invariants()(self._x) <= 0.0).all()), 0.0)

    @property
    def of_guarantee(self) -> list[Assumption]:
        """What `guaranteed` rests on, and how often each failed so far."""
        found = [self._start, self._gap, self._disturbance, self._inputs, self._certificates]
        return [*found, *[each for each in (self._resolved, self._prompt) if each.failed]]

    @property
    def of_theorem(self) -> list[Assumption]:
        """What the paper's theorem needs, and how often each failed so far."""
        found = [self._start_kept, self._gap, self._disturbance, self._rows, self._margin]
        found += [self._stayed] if self._stayed.checked else []
        found += [each for each in (self._prompt, self._faithful, self._truthful) if each.failed]
        safety = self._swarm.safety
        if safety.centralised:
            return [*found, self._synchronous]
        return [*found, self._fresh, self._broadcasts] if safety.counts_on_received else found

    def saw(self, piece: IntegrationSteps | DisturbanceKnot) -> None:
        """The world went through this."""
        if isinstance(piece, DisturbanceKnot):
            norms = np.sqrt(np.add.reduceat(piece.phi * piece.phi, self._begins))
            # Norms are convex: within the bound at the knots, within it on the line between.
            within = bool((norms <= self._bounds * (1.0 + _ROUNDING)).all())
            self._disturbance.check(within, piece.t)
            return
        if self._start.checked == 0:
            self._start.check(bool((piece.h[0] <= 0.0).all()), float(piece.times[0]))
        for t, resolved in zip(piece.times.tolist(), piece.resolved.tolist(), strict=True):
            self._resolved.check(resolved, t)
        for t, psi in zip(piece.times.tolist(), piece.psi.tolist(), strict=False):
            self._stayed.check(psi <= 0.0, t)
            if not psi <= self._highest:
                self._highest = psi
                if not psi <= 0.0:
                    self._stayed.note = f"{_STAYED}; the largest was {psi:.4g}, at t = {t:.3f} s"

    def reached(self, event: StateReached) -> None:
        """The world went on to another event."""
        if event.t > 0.0:
            for i, zero in self._at_zero.items():
                self._inputs.check(self._actuators.takes(i, self._x[self._parts[i]], zero), 0.0)
        self._x = event.x

    def sampled(self, event: Sampled) -> None:
        """An agent took a sample."""
        i, t, truthful = event
        if i in self._swarm.normal:
            self._truthful.check(truthful, t)
        if i in self._sampled:
            self._gap.check(t - self._sampled[i][0] <= self._longest_gap[i], t)
        self._sampled[i] = t, self._x

    def fell_silent(self, i: int, t: float) -> None:
        """Agent i neither samples nor answers from t [s] on."""
        if i in self._swarm.normal:
            self._faithful.check(False, t)

    def applied(self, event: InputApplied, telemetry: Telemetry) -> None:
        """An actuator took its input."""
        i, t, t_apply = event.i, event.t, event.t_apply
        self._prompt.check(t_apply - t <= self._latency + _ROUNDING, t_apply)
        if i in self._swarm.normal:
            if telemetry.report.origin == Origin.ATTACK:
                self._faithful.check(False, t)
            else:
                self._made(event, telemetry)
        self._in_force[i] = t_apply
        self._at_zero.pop(i, None)
        _, x = self._sampled.get(i, (t, self._x))
        self._inputs.check(self._actuators.takes(i, x[self._parts[i]], event.u), t_apply)

    def lost(self, event: InputLost) -> None:
        """An input never came to its actuator."""
        self._prompt.check(False, event.t)

    def _made(self, event: InputApplied, telemetry: Telemetry) -> None:
        """A normal agent made the input."""
        t = event.t
        self._rows.check(telemetry.report.origin not in EMPTY, t)
        self._synchronous.check(self._instants.setdefault(event.k, t) == t, t)
        for other, age in telemetry.ages:
            # An agent never heard of has no input in force; an age of one is a lie.
            in_force = self._in_force.get(other, -np.inf)
            self._fresh.check(abs(in_force - (t - age)) <= _ROUNDING, t)


def _proven_margin(swarm: Swarm) -> Assumption:
    gaps = gaps_in_the_proof(swarm)
    note = "; ".join(gaps) or "the margin is a bound, computed at each sample"
    margin = Assumption("proven margin", note=note)
    margin.check(not gaps, 0.0)
    return margin
