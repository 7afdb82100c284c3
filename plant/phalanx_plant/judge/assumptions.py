"""Assumptions of the guarantee and of the paper's theorem, with counts of checks and failures.

Agents' reports on their control steps count for the theorem's assumptions only. Which assumptions
apply depends on the scenario; some apply only after they failed.
"""

import numpy as np

from phalanx.guarantee.proof_gaps import proof_gaps
from phalanx.guarantee.verdict import Assumption
from phalanx.messages.kinds import Telemetry
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import DEFECT, Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.models.world import WorldNote
from phalanx.theory.rows.origin import OF_CONTROLLERS, OF_NO_ROWS, Origin
from phalanx_plant.judge.claims import Claims
from phalanx_plant.world.evaluation import EvaluatedSteps
from phalanx_plant.world.events import InputApplied, InputLost, Sampled, StateReached
from phalanx_plant.world.world import Actuators, DisturbanceKnot

_STAYED = "no ψ_1 ... ψ_{q-1} was above 0: from there the safe set cannot be kept for sure"
_WITHIN = "no disturbance was larger than disturbance.bound"
_ROUNDING = 1e-9


class Assumptions:
    """The assumptions of one run, checked at every event."""

    def __init__(self, rows: SafetyRows, certificates: Assumption, claims: Claims) -> None:
        """Begin at x(0); certificates and broadcasts are checked elsewhere."""
        swarm = self._swarm = rows.swarm
        self._certificates, self._claims = certificates, claims
        self._start = Assumption("start in S", note="every pair is safe at the start")
        self._start_kept = Assumption(
            "start in S_I", note="every agent starts where the safe set can be kept"
        )
        self._gap = Assumption(
            "sampling gap", note="no sample came later than clock.period + clock.jitter"
        )
        self._disturbance = Assumption("disturbance bound", note=_WITHIN)
        self._above = 0.0
        """The most by which a disturbance was above its bound."""
        self._resolved = Assumption(
            "resolved motion",
            note=f"no integration step was off the equation of motion by more than {DEFECT:g} in "
            "a second, which certificates allow for; a shorter time.integration_step, dynamics "
            "without kinks and coordinates nearer to the origin bring it down",
        )
        self._inputs = Assumption("admissible inputs", note="no actuator held an input outside U")
        self._prompt = Assumption(
            "inputs in time", note="every input reached its actuator when it was due"
        )
        self._rows = Assumption(
            "non-empty K_i", note="at every step of every normal agent some input kept its rows"
        )
        self._fresh = Assumption(
            "received inputs in force",
            note="every received input that a row counted on was being applied: its time was that "
            "of the sender's input, and no false broadcast had claimed it",
        )
        self._faithful = Assumption("faithful agents", note="no normal agent fell silent or turned")
        self._model = swarm.safety.information_model
        if not self._model.reads_roles:
            self._faithful.note = (
                "no normal agent fell silent; others may turn, as rows count everyone at worst: "
                "the theorem promises every pair with an agent that did not"
            )
        self._truthful = Assumption(
            "truthful sensors", note="every sample of a normal agent had the true state"
        )
        self._synchronous = Assumption(
            "synchronous sampling", note="all normal agents sample at the same instants"
        )
        self._margin = _proven_margin(swarm)
        self._stayed = Assumption("stayed in S_I", note=_STAYED)
        self._filtered = any(swarm.groups[i].filtered for i in swarm.normal)
        """Whether some agent has rows, as the paper's filter has and other controllers have not."""
        self._latency = swarm.time.latency
        self._sampling = set(swarm.normal)
        """Agents whose samples may not be late: normal ones that did not turn."""
        self._longest_gap = [g.clock.period + g.clock.jitter + _ROUNDING for g in swarm.groups]
        self._bounds = np.array([g.disturbance.bound for g in swarm.groups])
        self._parts = swarm.safe_set.parts
        self._begins = [part.start for part in self._parts]
        self._x = swarm.start()
        """The true stacked state at the last event, shape (n̄,)."""
        self._of_world: dict[str, Assumption] = {}
        """Assumptions that a world of the scenario's says have failed."""
        # Before its first input an agent has none in force; a report of its age is false.
        self._in_force = [-np.inf for _ in swarm.names]
        """Time at which each agent's input took effect [s]."""
        self._actuators = swarm.functions.get(Actuators, lambda: Actuators(swarm))
        self._at_zero = {i: np.zeros(len(m.dynamics.inputs)) for i, m in enumerate(swarm.members)}
        """Zeros that actuators hold from t = 0 on, until they are checked."""
        self._sampled: dict[int, tuple[float, Array]] = {}
        """Time of each agent's last sample [s], and the true state at it."""
        self._instants: dict[int, float] = {}
        """By k, the time at which the first normal agent took its sample k [s]."""
        self._highest = -np.inf
        """The largest ψ_1 ... ψ_{q-1} so far."""
        self._start_kept.check(bool((rows.invariants()(self._x) <= 0.0).all()), 0.0)

    @property
    def of_guarantee(self) -> list[Assumption]:
        """The assumptions of the outcome `guaranteed`."""
        assumptions = [self._start, self._gap, self._disturbance, self._inputs, self._certificates]
        return [
            *assumptions,
            *[a for a in (self._resolved, self._prompt) if a.failed],
            *self._of_world.values(),
        ]

    @property
    def of_theorem(self) -> list[Assumption]:
        """The assumptions of the paper's theorem."""
        assumptions = [self._start_kept, self._gap, self._disturbance]
        assumptions += [self._rows, self._margin] if self._filtered else [self._margin]
        assumptions += [self._stayed] if self._stayed.checked else []
        assumptions += [a for a in (self._prompt, self._truthful) if a.failed]
        assumptions += [self._faithful] if self._faithful.checked else []
        safety = self._swarm.safety
        if safety.centralised:
            return [*assumptions, self._synchronous]
        believed = self._model.counts_on_received and self._filtered
        assumptions += [self._fresh] if believed else []
        return assumptions + ([self._claims.truthful] if believed or self._swarm.by_radio else [])

    def add(self, piece: DisturbanceKnot | WorldNote) -> None:
        """Check a disturbance, or what a world says of its motion."""
        if isinstance(piece, DisturbanceKnot):
            norms = np.sqrt(np.add.reduceat(piece.phi * piece.phi, self._begins))
            # Norms are convex: the bound holds between two knots if it holds at both.
            within = bool((norms <= self._bounds * (1.0 + _ROUNDING)).all())
            self._disturbance.check(within, piece.t)
            if not within:
                self._name_largest(norms, piece.t)
        elif piece.fails:
            name, new = piece.fails, Assumption(piece.fails, note=piece.text)
            self._of_world.setdefault(name, new).check(False, piece.t)

    def moved(self, steps: EvaluatedSteps) -> None:
        """Check integration steps."""
        if self._start.checked == 0:
            self._start.check(bool((steps.h[0] <= 0.0).all()), float(steps.times[0]))
        times, psi = steps.times.tolist(), steps.psi.tolist()
        self._resolved.check_each(steps.resolved.tolist(), times)
        if not psi:
            return
        self._stayed.check_each([value <= 0.0 for value in psi], times)
        for t, value in zip(times, psi, strict=True):
            if not value <= self._highest:
                self._highest = value
                if not value <= 0.0:
                    self._stayed.note = f"{_STAYED}; the largest was {value:.4g}, at t = {t:.3f} s"

    def _name_largest(self, norms: Array, t: float) -> None:
        """Say whose disturbance is the most above its bound; no number where none explains it."""
        above = np.nan_to_num(norms - self._bounds, nan=np.inf)
        i = int(above.argmax())
        if above[i] > self._above:
            self._above = float(above[i])
            most = f"{norms[i]:.4g}, of agent {self._swarm.names[i]}, at t = {t:.3f} s"
            self._disturbance.note = f"{_WITHIN}; the most above was {most}"

    def reached(self, event: StateReached) -> None:
        """Check once each actuator that has held zero since t = 0, and store the state.

        At the end of the run also how long ago each normal agent's last sample was.
        """
        if event.t > 0.0:
            for i, zero in self._at_zero.items():
                self._inputs.check(self._actuators.takes(i, self._x[self._parts[i]], zero), 0.0)
            self._at_zero = {}
        self._x = event.x
        if event.t >= self._swarm.scenario.duration:
            for i in self._sampling:
                self._check_gap(i, event.t)

    def sampled(self, event: Sampled) -> None:
        """Check a normal agent's sample: its truth, and the gap since the previous one."""
        i, t = event.i, event.t
        if i in self._swarm.normal:
            self._truthful.check(event.truthful, t)
        if i in self._sampling and t > 0.0:
            self._check_gap(i, t)
        self._sampled[i] = t, self._x

    def state_at_sample(self, i: int) -> Array:
        """Return the true stacked state at agent i's last sample, shape (n̄,)."""
        return self._sampled[i][1]

    def _check_gap(self, i: int, t: float) -> None:
        last, _ = self._sampled.get(i, (0.0, self._x))
        self._gap.check(t - last <= self._longest_gap[i], t)

    def turned(self, i: int) -> None:
        """Record that agent i is an adversary from now on: when it samples matters to none."""
        self._sampling.discard(i)

    def fell_silent(self, i: int, t: float) -> None:
        """Record that agent i neither samples nor answers from t [s] on."""
        if i in self._swarm.normal:
            self._faithful.check(False, t)

    def applied(self, event: InputApplied, telemetry: Telemetry) -> None:
        """Check an input at the time it took effect."""
        i, t, t_apply = event.i, event.t_sample, event.t_apply
        self._prompt.check(t_apply - t <= self._latency + _ROUNDING, t_apply)
        if i in self._swarm.normal:
            if telemetry.report.origin == Origin.ATTACK:
                self._faithful.check(not self._model.reads_roles, t)
            else:
                self._check_step(event, telemetry)
        self._in_force[i] = t_apply
        self._at_zero.pop(i, None)
        x = self._sampled[i][1] if i in self._sampled else self._x
        self._inputs.check(self._actuators.takes(i, x[self._parts[i]], event.u), t_apply)

    def lost(self, event: InputLost) -> None:
        """Record that an input never reached its actuator."""
        self._prompt.check(False, event.t_due)

    def _check_step(self, event: InputApplied, telemetry: Telemetry) -> None:
        """Check the control step of a normal agent."""
        t = event.t_sample
        if telemetry.report.origin not in OF_CONTROLLERS:
            self._rows.check(telemetry.report.origin not in OF_NO_ROWS, t)
        self._synchronous.check(self._instants.setdefault(event.k, t) == t, t)
        for other, age in telemetry.ages:
            held = abs(self._in_force[other] - (t - age)) <= _ROUNDING
            self._fresh.check(held and not self._claims.misled(event.i, other, t - age), t)


def _proven_margin(swarm: Swarm) -> Assumption:
    gaps = proof_gaps(swarm)
    note = "; ".join(gaps) or "the margin is a bound, computed at each sample"
    margin = Assumption("proven margin", note=note)
    margin.check(not gaps, 0.0)
    return margin
