"""The judge: a fold over the events of a run, checked in order against safe set and assumptions.

Nothing but events changes its state: the same events have the same verdict again. Outcome and
certificates follow from the true states and the applied inputs alone. Agents' reports are compared
with these. All that is recorded and shown of an event is in its judgement.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import chain, pairwise
from math import isnan
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict

from phalanx.faults.commands import Condition, ProcessChange
from phalanx.guarantee.verdict import (
    Assumption,
    CertificateSummary,
    Convicted,
    Deadlock,
    PromiseSummary,
    TrustSummary,
    Violation,
)
from phalanx.network.inbox import Conviction, DeliveryReport
from phalanx.recording.columns import ORIGINS, Inputs, TrueStates
from phalanx.recording.deadlock import DeadlockWatch
from phalanx.recording.records import Level, Log
from phalanx.schema.registry import part_of_agent
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.statements import OwnStatement
from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.expressions.user_methods import located_method
from phalanx.theory.models.world import WorldNote
from phalanx.theory.rows.origin import Origin
from phalanx_plant.judge.assumptions import Assumptions
from phalanx_plant.judge.claims import TRUE, Claims, FalseClaims, Finding
from phalanx_plant.judge.coverage import Coverage
from phalanx_plant.judge.event_columns import Columns, EventColumns
from phalanx_plant.world.evaluation import EvaluatedSteps, Evaluation
from phalanx_plant.world.events import (
    CommandApplied,
    Event,
    InputApplied,
    InputLost,
    MemberLost,
    Sampled,
    StateReached,
)
from phalanx_plant.world.extremes import LOWEST, Crossing, Extremes, PairExtremes, Peak
from phalanx_plant.world.world import DisturbanceKnot, DivergedError, History

_CHANGES = (CommandApplied, MemberLost)
_BACKUP = ORIGINS[Origin.BACKUP]


class Judged(Struct, frozen=True):
    """An event with its judgement."""

    event: Event
    notices: Sequence[Log] = ()
    """Lines of the event log."""
    peak: Peak = LOWEST
    """Of a StateReached: the largest values since the previous one."""
    pair: int = 0
    """Of a StateReached: the pair with a normal agent whose h is largest there."""
    certified: float | None = None
    """Of an InputApplied: for how long all pairs of a normal agent are proven safe from then on."""
    false: Mapping[int, Finding] | None = None
    """Of an input: what was found of false broadcasts, by their place in its report."""

    @property
    def received(self) -> list[tuple[DeliveryReport, Finding]]:
        """The broadcasts that an input's agent reports on, and whether they were true."""
        telemetry = getattr(self.event, "telemetry", None)
        fates = telemetry.fates if telemetry else ()
        false = self.false or {}
        return [(fate, false.get(place, TRUE)) for place, fate in enumerate(fates)]

    @property
    def step(self) -> dict[str, Any]:
        """The numbers of an applied input's control step, by the names of an AppliedStep.

        Empty of another event, and without a report.
        """
        event = self.event
        if not isinstance(event, InputApplied) or event.telemetry is None:
            return {}
        ages = event.telemetry.ages
        return {
            **asdict(event.telemetry.report),
            "u": tuple(event.u.tolist()),
            "oldest_input": max([age for _, age in ages]) if ages else None,
            "certified": self.certified,
        }


class _Folded(NamedTuple):
    """Findings of the judge on columns of events."""

    extremes: Extremes
    """By state."""
    certified: Array
    """For how long all pairs of each input's agent are proven safe [s], shape (r,); NaN of lost
    inputs and those of adversaries."""
    false: FalseClaims
    notices: defaultdict[int, list[Log]]
    """Lines of the log, by the row of the state that shows it."""
    x: TrueStates


class Findings(Struct):
    """The judgement of all events so far, with the names of a Summary."""

    worst_h: float
    worst_at: float
    worst_pair: str
    largest_h_tot: float
    largest_h_tot_at: float
    steps: int
    origins: dict[str, int]
    assumptions: list[Assumption]
    theorem: list[Assumption]
    certificates: CertificateSummary
    violations: list[Violation]
    excluded: list[Violation] | None
    """None if no pair was excluded."""
    trust: TrustSummary | None
    deadlocks: list[Deadlock]
    promise: PromiseSummary | None
    rejected: dict[str, int]
    """Payloads that agents dropped, by agent, if there are any."""
    lost: list[str]
    """Agents that became unreachable, when, and what they had reported."""


class Judge:
    """Checks events against the safe set, and updates certificates, assumptions and claims."""

    def __init__(self, rows: SafetyRows) -> None:
        """Begin at x(0)."""
        swarm = self._swarm = rows.swarm
        self.evaluation = Evaluation(rows)
        self.extremes = PairExtremes(swarm.safe_set)
        self.coverage = Coverage(swarm)
        self.coverage.begin(swarm.start())
        self.claims = Claims(swarm)
        self._knowledge = part_of_agent("agents.radio judged")(swarm) if swarm.by_radio else None
        self.assumptions = Assumptions(rows, self.coverage.assumption, self.claims)
        self._promise = (
            part_of_agent("safety.keep judged")(swarm) if swarm.safety.committed else None
        )
        self._t = 0.0
        """Time of the last state [s]."""
        self._steps = 0
        """Inputs applied."""
        self._origins = {str(o): 0 for o in swarm.origins}
        """Steps of normal agents by how their input was made."""
        self._names = swarm.names
        self._with_radio = frozenset(i for i in swarm.normal if swarm.peers(i))
        self._columns = EventColumns(swarm, self.claims)
        self._at_start = list[Log]()
        """Pairs that are unsafe at the start, until the first event."""
        self._turned: set[int] = set()
        """Normal agents that became adversaries."""
        self._warned: set[str] = set()
        """Warnings given; each is given once."""
        self._convictions: list[Convicted] = []
        self._truthful = dict[int, bool]()
        """By agent, whether its last sample had the true state."""
        self._watch = DeadlockWatch(swarm)
        self._rejected = [0 for _ in swarm.names]
        self._rejected_before = [0 for _ in swarm.names]
        self._lost_members: list[str] = []
        """By earlier processes of restarted agents."""

    def findings(self) -> Findings:
        """Return the judgement of all events so far."""
        extremes, assumptions = self.extremes, self.assumptions
        counts = zip(self._names, self._rejected, self._rejected_before, strict=True)
        return Findings(
            worst_h=extremes.worst_h,
            worst_at=extremes.worst_at,
            worst_pair=extremes.worst_pair,
            largest_h_tot=extremes.largest_h_tot,
            largest_h_tot_at=extremes.largest_h_tot_at,
            steps=self._steps,
            origins=self._origins,
            assumptions=assumptions.of_guarantee,
            theorem=[*assumptions.of_theorem, *self._known],
            certificates=self.coverage.summary,
            violations=extremes.violations(),
            excluded=extremes.excluded(),
            trust=self._trust,
            deadlocks=self._watch.deadlocks,
            promise=self._promise and self._promise.summary(self._t, extremes.violations()),
            rejected={f"by agent {name}": now + old for name, now, old in counts if now + old},
            lost=self._lost_members,
        )

    @property
    def _known(self) -> list[Assumption]:
        held: Assumption | None = self._knowledge and self._knowledge.held
        return [held] if held and held.checked else []

    @property
    def statements(self) -> Mapping[int, Mapping[int, OwnStatement]]:
        """The newest statement by radio that had come, by agent and peer."""
        return self._knowledge.statements if self._knowledge else {}

    def judge(self, events: Sequence[Event], judged: list[Judged]) -> None:
        """Judge the next events in order, and append the results; a sample has none.

        Together, as everything costs least for many. Raises DivergedError.
        """
        # What comes after one of these is judged with all that it changed.
        changes = [k + 1 for k, event in enumerate(events) if type(event) in _CHANGES]
        for begin, end in pairwise([0, *changes, len(events)]):
            self._judge(events[begin:end], judged)

    def _judge(self, events: Sequence[Event], judged: list[Judged]) -> None:
        indices = [k for k, event in enumerate(events) if type(event) is StateReached]
        histories = [event.history for event in events if type(event) is StateReached]
        evaluated = list(self.evaluation.of(histories))
        if (failed := self.diverged(evaluated)) is not None:
            number, diverged = failed
            self._judge(events[: indices[number]], judged)
            raise diverged
        self.add_pieces(histories)
        folded = self.fold(self._columns.of(events), evaluated)
        peaks, pairs = folded.extremes.peaks.tolist(), folded.extremes.pairs.tolist()
        state = row = 0
        for event in events:
            if type(event) is StateReached:
                notices = self._reached(event, folded.notices.get(state, []))
                judged.append(Judged(event, notices, tuple(peaks[state]), pairs[state]))
                state += 1
            elif type(event) is InputApplied or type(event) is InputLost:
                judged.append(self._answered(event, row, folded))
                row += 1
            elif type(event) is Sampled:
                if self._promise is not None:
                    self._truthful[event.i] = event.truthful
                    self._promise.sampled(event.i, event.t)
            elif type(event) is CommandApplied:
                judged.append(self._command(event))
            elif type(event) is MemberLost:
                judged.append(self._lost_member(event))

    def fold(self, columns: Columns, evaluated: Sequence[EvaluatedSteps]) -> _Folded:
        """Judge events by their columns, and the steps that led to their states.

        No command is among them, and no agent is lost or comes back.
        """
        states, samples, inputs, aged, stated = columns
        extremes = self._moved(evaluated, len(states.t))
        x = self.assumptions.true_states(states, samples, inputs)
        issued = self.coverage.proven(inputs, x.table[x.now])
        certified = self.coverage.add(states, inputs, issued)
        findings = self.claims.add(inputs, x, stated)
        self.assumptions.add_samples(states, samples)
        self.assumptions.add(states, inputs, aged, x)
        self._count_origins(inputs)
        notices = defaultdict[int, list[Log]](list)
        if len(states.t):
            notices[0], self._at_start = self._at_start, []
        for row, crossing in extremes.crossings:
            notices[row].append(self._crossed(crossing))
        for row, deadlock in self._watch.add(states, inputs):
            notices[row].append(Log(float(states.t[row]), deadlock))
        return _Folded(extremes, certified, findings, notices, x)

    def _count_origins(self, inputs: Inputs) -> None:
        self._steps += int(np.count_nonzero(~inputs.lost))
        of_normal = np.isin(inputs.i, self._swarm.normal) & ~inputs.lost
        counts = np.bincount(inputs.origin[of_normal], minlength=len(Origin))
        for origin, steps in zip(Origin, counts.tolist(), strict=True):
            if steps and origin != Origin.ATTACK:
                self._origins[origin] += steps

    def add_reports(
        self, inputs: Inputs, rejected: Index, hits: Mapping[int, int]
    ) -> dict[int, list[Log]]:
        """Count what is reported on inputs that `fold` took, where no agent convicts another.

        rejected: payloads that their agents had dropped by then, shape (r,). hits: messages on
        which each declared fault had an effect, by its number.

        Returns lines of the log by the row of the input.
        """
        for i, count in dict(zip(inputs.i.tolist(), rejected.tolist(), strict=True)).items():
            self._rejected[i] = count
        self.claims.faults.update(hits)
        rows = np.flatnonzero(inputs.origin == _BACKUP)
        rows = rows[np.unique(inputs.i[rows], return_index=True)[1]]
        return {row: self._backup(int(inputs.i[row]), float(inputs.t_apply[row]))
                for row in rows.tolist()}  # fmt: skip

    def begin(self, start: StateReached) -> Judged:
        """Check the start, whose log lines come with the next event. Raises DivergedError."""
        evaluated = list(self.evaluation.of([start.history]))
        if (failed := self.diverged(evaluated)) is not None:
            raise failed[1]
        self.add_pieces([start.history])
        extremes = self._moved(evaluated, 1)
        self._at_start = [self._crossed(crossing) for _, crossing in extremes.crossings]
        return Judged(start, (), extremes.peak(0), int(extremes.pairs[0]))

    def _moved(self, evaluated: Sequence[EvaluatedSteps], states: int) -> Extremes:
        for steps in evaluated:
            self.assumptions.moved(steps)
        return self.extremes.add(evaluated, states)

    def add_pieces(self, histories: Sequence[History]) -> None:
        """Check what happened in consecutive histories, apart from motion."""
        for history in histories:
            for piece in history:
                if type(piece) is DisturbanceKnot or type(piece) is WorldNote:
                    self.assumptions.add_piece(piece)
                    self._add_to_promise(piece)

    def _add_to_promise(self, piece: DisturbanceKnot | WorldNote) -> None:
        if self._promise is None:
            return
        if isinstance(piece, DisturbanceKnot):
            self._promise.disturbed(piece)
        elif piece.fails:
            self._promise.failed(piece.t, piece.text)

    def diverged(self, evaluated: Sequence[EvaluatedSteps]) -> tuple[int, DivergedError] | None:
        """Return the number of the first history that is not finite, and the error."""
        for steps in evaluated:
            finite = np.abs(steps.h_tot) <= LARGEST
            if not np.logical_and.reduce(finite):
                number = int(steps.numbers[finite.argmin()])
                mask = steps.numbers == number
                t = float(steps.times[mask][-1])
                return number, self._diverged(t, steps.pairs, steps.h[mask])
        return None

    def _diverged(self, t: float, pairs: Index, h: Array) -> DivergedError:
        """Name the pair whose h is not finite, and the method behind it; else h_tot."""
        composed, bad = self._swarm.safe_set, ~(np.abs(h) <= LARGEST).all(axis=0)
        if not bad.any():
            return DivergedError("h_tot", t)
        pair = composed.pairs[int(pairs[np.argmax(bad)])]
        return DivergedError(
            f"h of {composed.label(pair)}", t, located_method(*composed.method_of(pair))
        )

    def _crossed(self, crossing: Crossing) -> Log:
        level = Level.ERROR if crossing.unsafe else Level.INFO
        pair = self.extremes.label(crossing.pair)
        return Log(crossing.t, self.extremes.in_words(crossing), level, pair)

    def _reached(self, event: StateReached, notices: list[Log]) -> list[Log]:
        """Return what is said of a state, in the order of time."""
        self._t = event.t
        said = [
            Log(piece.t, piece.text, Level.WARNING)
            for piece in event.history
            if type(piece) is WorldNote
        ]
        said += notices
        return sorted(said, key=lambda line: line.t) if said else said

    def _command(self, event: CommandApplied) -> Judged:
        command, effect, i = event.command, event.command.effect, event.changed
        if i is not None and effect is not None:
            if command.fault >= 0 and command.is_failure:
                self.claims.faults[command.fault] += 1
            if effect.new_condition is not None and effect.new_condition.silent:
                self.assumptions.fell_silent(i, command.t)
                if self._promise is not None:
                    self._promise.fell_silent(i)
            if effect.new_condition is Condition.TURNED:
                self._turn(i, command.t)
            if effect.process is ProcessChange.STARTS:
                self._rejected_before[i] += self._rejected[i]
                self._rejected[i] = 0
                if self._knowledge is not None:
                    self._knowledge.restarted(i)
                if self._promise is not None:
                    self._promise.restarted(i)
        of = ", ".join(self._names[j] for j in event.forgotten)
        lost = f"; lost with it: the inputs received of {of}" if of else ""
        level = Level.WARNING if command.is_failure else Level.INFO
        return Judged(event, [Log(command.t, f"{command}{lost}", level)])

    def _turn(self, i: int, t: float) -> None:
        """Exclude agent i's pairs without a normal agent, as it is an adversary from t [s] on.

        Two adversaries are no pair of the safe set from the start either.
        """
        self._turned.add(i)
        self.assumptions.turned(i)
        self._columns.turned(i)
        if self._promise is not None:
            self._promise.turned(i, t)
        excluded = np.flatnonzero(self._swarm.without_normal(self._turned))
        self.extremes.exclude(excluded, t)
        self.evaluation.pairs.excluded[excluded] = True
        self.coverage.turned(i, excluded)

    def _answered(self, event: InputApplied | InputLost, row: int, folded: _Folded) -> Judged:
        """Judge an input by its agent's report, and warn of what happened for the first time."""
        i, t, telemetry, notices = event.i, event.t_sample, event.telemetry, list[Log]()
        assert telemetry is not None
        self._rejected[i] = telemetry.rejected
        self.claims.faults.update(chain.from_iterable([fate.faults for fate in telemetry.fates]))
        false = folded.false.get(row)
        for place in sorted(false or ()):
            sender = self._names[telemetry.fates[place].sender]
            notices += self._warn_once(t, f"agent {sender}: first false broadcast")
        if self._knowledge is not None and i in self._with_radio:
            late = isinstance(event, InputLost) or event.t_apply > t
            x = folded.x.at_sample(row)
            self._knowledge.sampled(i, t, x, telemetry, late, self._turned)
        for conviction in telemetry.convictions:
            # An adversary may accuse whom it likes.
            if i in self._swarm.normal and i not in self._turned:
                notices.append(self._conviction(i, t, conviction))
        if isinstance(event, InputLost):
            if self._promise is not None:
                self._promise.lost(i, event.t_due)
            notices += self._warn_once(event.t_due, f"agent {self._names[i]}: first input lost")
            return Judged(event, notices, false=false)
        if self._promise is not None:
            self._promise.applied(event, folded.x.at_sample(row), self._truthful[i])
        if telemetry.report.origin == Origin.BACKUP:
            notices += self._backup(i, event.t_apply)
        certified = float(folded.certified[row])
        proven = None if isnan(certified) else certified
        return Judged(event, notices, certified=proven, false=false)

    def _backup(self, i: int, t: float) -> list[Log]:
        return self._warn_once(t, f"agent {self._names[i]}: first backup")

    def _lost_member(self, event: MemberLost) -> Judged:
        name = self._names[event.i]
        if event.back:
            return Judged(event, [Log(event.t, f"agent {name} is back")])
        self.assumptions.fell_silent(event.i, event.t)
        because = f" ({event.why})" if event.why else ""
        self._lost_members.append(f"agent {name} at t = {event.t:.3f} s{because}")
        lost = f"agent {name} is lost{because}; its actuator holds its input"
        return Judged(event, [Log(event.t, lost, Level.WARNING)])

    def _conviction(self, i: int, t: float, conviction: Conviction) -> Log:
        """Keep a conviction by agent i at t [s], and describe it."""
        by, of = self._names[i], self._names[conviction.of]
        begin, end, excess = conviction.begin, conviction.end, conviction.excess
        self._convictions.append(Convicted(by, of, t, begin, end, excess))
        reason = (
            f"did not hold what it announced, by {excess:.3g} more than a disturbance explains"
            if self._swarm.safety.watch
            else f"cannot have moved as it states, by {excess:.3g} m"
        )
        text = f"agent {by} convicts agent {of}: from {begin:.3f} to {end:.3f} s it {reason}"
        return Log(t, text, Level.WARNING)

    @property
    def _trust(self) -> TrustSummary | None:
        """Betrayals and convictions; None unless agents watch others or have a radio."""
        if not (self._swarm.safety.watch or self._swarm.by_radio):
            return None
        begun = dict(self.claims.betrayals)
        for conviction in self._convictions:
            guilty = begun.get(conviction.of, np.inf) <= conviction.end
            conviction.after = conviction.t - begun[conviction.of] if guilty else None
        return TrustSummary(begun, self._convictions)

    def _warn_once(self, t: float, text: str) -> list[Log]:
        if text in self._warned:
            return []
        self._warned.add(text)
        return [Log(t, text, Level.WARNING)]
