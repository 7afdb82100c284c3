"""Assumptions of the guarantee and of the paper's theorem, with counts of checks and failures.

Agents' reports on their control steps count for the theorem's assumptions only. Which assumptions
apply depends on the scenario; some apply only after they failed.
"""

import numpy as np

from phalanx.guarantee.proof_gaps import proof_gaps
from phalanx.guarantee.verdict import Assumption
from phalanx.recording.columns import (
    ORIGINS,
    Aged,
    Inputs,
    Samples,
    States,
    TrueStates,
    last_before,
)
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import DEFECT, Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.models.world import WorldNote
from phalanx.theory.rows.origin import OF_CONTROLLERS, OF_NO_ROWS, Origin
from phalanx_plant.judge.claims import Claims
from phalanx_plant.world.evaluation import EvaluatedSteps
from phalanx_plant.world.world import Actuators, DisturbanceKnot

_STAYED = "no ψ_1 ... ψ_{q-1} was above 0: from there the safe set cannot be kept for sure"
_WITHIN = "no disturbance was larger than disturbance.bound"
_ROUNDING = 1e-9
_ATTACK = ORIGINS[Origin.ATTACK]
_OF_CONTROLLERS = [ORIGINS[origin] for origin in OF_CONTROLLERS]
_OF_NO_ROWS = [ORIGINS[origin] for origin in OF_NO_ROWS]


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
        self._normal: Mask = np.isin(np.arange(len(swarm.names)), swarm.normal)
        self._sampling = self._normal.copy()
        """Agents whose samples may not be late: normal ones that did not turn."""
        self._longest_gap = np.array(
            [g.clock.period + g.clock.jitter + _ROUNDING for g in swarm.groups]
        )
        self._bounds = np.array([g.disturbance.bound for g in swarm.groups])
        self._parts = swarm.safe_set.parts
        self._begins = [part.start for part in self._parts]
        self._sizes = [len(m.dynamics.inputs) for m in swarm.members]
        self._x = swarm.start()
        """The true stacked state at the last event, shape (n̄,)."""
        self._of_world: dict[str, Assumption] = {}
        """Assumptions that a world of the scenario's says have failed."""
        # Before its first input an agent has none in force; a report of its age is false.
        self._in_force = np.full(len(swarm.names), -np.inf)
        """Time at which each agent's input took effect [s], shape (N,)."""
        self._actuators = swarm.functions.get(Actuators, lambda: Actuators(swarm))
        self._at_zero = {i: np.zeros(len(m.dynamics.inputs)) for i, m in enumerate(swarm.members)}
        """Zeros that actuators hold from t = 0 on, until they are checked."""
        self._sampled_at = np.zeros(len(swarm.names))
        """Time of each agent's last sample [s], shape (N,); 0 before the first."""
        self._sampled = np.tile(self._x, (len(swarm.names), 1))
        """The true state at each agent's last sample, shape (N, n̄)."""
        self._has_sampled: Mask = np.zeros(len(swarm.names), dtype=bool)
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

    def add_piece(self, piece: DisturbanceKnot | WorldNote) -> None:
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
        self._resolved.check_each(steps.resolved, steps.times)
        if not len(psi := steps.psi):
            return
        self._stayed.check_each(psi <= 0.0, steps.times)
        if not (largest := float(psi[k := int(psi.argmax())])) <= self._highest:
            self._highest = largest
            if not largest <= 0.0:
                t = float(steps.times[k])
                self._stayed.note = f"{_STAYED}; the largest was {largest:.4g}, at t = {t:.3f} s"

    def _name_largest(self, norms: Array, t: float) -> None:
        """Say whose disturbance is the most above its bound; no number where none explains it."""
        above = np.nan_to_num(norms - self._bounds, nan=np.inf)
        i = int(above.argmax())
        if above[i] > self._above:
            self._above = float(above[i])
            most = f"{norms[i]:.4g}, of agent {self._swarm.names[i]}, at t = {t:.3f} s"
            self._disturbance.note = f"{_WITHIN}; the most above was {most}"

    def add_samples(self, states: States, samples: Samples) -> None:
        """Check the truth of normal agents' samples, and the gap since their previous ones.

        At the end of the run also how long ago each normal agent's last sample was.
        """
        number, i, t, truthful = samples
        mine = self._normal[i]
        self._truthful.check_each(truthful[mine], t[mine])
        before = last_before(i, number, i, number)
        gap = t - np.where(before >= 0, t[before], self._sampled_at[i])
        due = self._sampling[i] & (t > 0.0)
        self._gap.check_each((gap <= self._longest_gap[i])[due], t[due])
        self._sampled_at[i] = t  # of several the last one counts
        ends = states.t[states.t >= self._swarm.scenario.duration]
        for end in ends:
            since = (end - self._sampled_at <= self._longest_gap)[self._sampling]
            self._gap.check_each(since, np.full(len(since), end))

    def true_states(self, states: States, samples: Samples, inputs: Inputs) -> TrueStates:
        """Return the true states at inputs and their samples; now if there was no sample."""
        table, count = np.concatenate([self._sampled, self._x[None], states.x]), len(self._sampled)
        now, then = (
            count + np.searchsorted(states.number, numbers)
            for numbers in (inputs.number, samples.number)
        )
        newest = last_before(samples.i, samples.number, inputs.i, inputs.number)
        earlier = np.where(self._has_sampled[inputs.i], inputs.i, now)
        rows = np.where(newest >= 0, np.append(then, 0)[newest], earlier)
        self._sampled[samples.i], self._has_sampled[samples.i] = table[then], True
        return TrueStates(table, now, rows)

    def add(self, states: States, inputs: Inputs, aged: Aged, x: TrueStates) -> None:
        """Check inputs at the time they took effect, and the control steps of normal agents.

        aged: what their rows used. x: at the samples that they answer.
        """
        self._check_zeros(states, inputs)
        in_time = inputs.t_apply - inputs.t_sample <= self._latency + _ROUNDING
        self._prompt.check_each(in_time & ~inputs.lost, inputs.t_apply)
        normal, attacks = self._normal[inputs.i] & ~inputs.lost, inputs.origin == _ATTACK
        if (turned := inputs.t_sample[normal & attacks]).size:
            self._faithful.check_each(np.full(len(turned), not self._model.reads_roles), turned)
        steps = normal & ~attacks
        self._check_steps(inputs, steps)
        self._check_received(inputs, aged, steps)
        applied = np.flatnonzero(~inputs.lost)
        self._check_admissible(applied, inputs, x)
        self._in_force[inputs.i[applied]] = inputs.t_apply[applied]
        if len(states.t):
            self._x = states.x[-1]

    def _check_zeros(self, states: States, inputs: Inputs) -> None:
        """Check once each actuator that has held zero since t = 0."""
        if not self._at_zero:
            return
        later = states.number[states.t > 0.0]
        before = inputs.number < later[0] if len(later) else np.full(len(inputs.i), True)
        for i in inputs.i[before & ~inputs.lost].tolist():
            self._at_zero.pop(i, None)
        if len(later):
            first = int(np.searchsorted(states.number, later[0]))
            x = states.x[first - 1] if first else self._x
            for i, zero in self._at_zero.items():
                self._inputs.check(self._actuators.takes(i, x[self._parts[i]], zero), 0.0)
            self._at_zero = {}

    def _check_steps(self, inputs: Inputs, steps: Mask) -> None:
        """Check that rows could be kept, and that agents whose control is central sample at once.

        steps: the inputs that normal agents' control steps made, shape (r,).
        """
        origin, t = inputs.origin, inputs.t_sample
        of_rows = steps & ~np.isin(origin, _OF_CONTROLLERS)
        self._rows.check_each(~np.isin(origin, _OF_NO_ROWS)[of_rows], t[of_rows])
        if self._swarm.safety.centralised:
            together = zip(inputs.k[steps].tolist(), t[steps].tolist(), strict=True)
            for k, at in together:
                self._synchronous.check(self._instants.setdefault(k, at) == at, at)

    def _check_received(self, inputs: Inputs, aged: Aged, steps: Mask) -> None:
        """Check that received inputs which rows used were in force."""
        some = steps[aged.row]
        row, sender, age = aged.row[some], aged.sender[some], aged.age[some]
        if not len(row):
            return
        number, of, t = inputs.number[row], inputs.i[row], inputs.t_sample[row]
        there = np.flatnonzero(~inputs.lost)
        newest = last_before(inputs.i[there], inputs.number[there], sender, number)
        since = np.append(inputs.t_apply[there], np.inf)[newest]
        since = np.where(newest >= 0, since, self._in_force[sender])
        held = np.abs(since - (t - age)) <= _ROUNDING
        misled = self._claims.misled(of, sender, t - age, number)
        self._fresh.check_each(held & ~misled, t)

    def _check_admissible(self, rows: Index, inputs: Inputs, x: TrueStates) -> None:
        """Check that applied inputs were in U_i of the states that were sampled."""
        takes = self._actuators.inside(inputs.i[rows], inputs.u[rows])
        for n in np.flatnonzero(~takes).tolist():
            row = int(rows[n])
            i = int(inputs.i[row])
            part, u = self._parts[i], inputs.u[row, : self._sizes[i]]
            takes[n] = self._actuators.takes(i, x.at_sample(row)[part], u)
        self._inputs.check_each(takes, inputs.t_apply[rows])

    def turned(self, i: int) -> None:
        """Record that agent i is an adversary from now on: when it samples matters to none."""
        self._sampling[i] = False

    def fell_silent(self, i: int, t: float) -> None:
        """Record that agent i neither samples nor answers from t [s] on."""
        if i in self._swarm.normal:
            self._faithful.check(False, t)


def _proven_margin(swarm: Swarm) -> Assumption:
    gaps = proof_gaps(swarm)
    note = "; ".join(gaps) or "the margin is a bound, computed at each sample"
    margin = Assumption("proven margin", note=note)
    margin.check(not gaps, 0.0)
    return margin
