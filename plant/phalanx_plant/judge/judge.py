"""The judge: takes every event of a run in order, and says what it found.

Outcome and certificates follow from the true states and the applied inputs alone; what agents say
of their inputs is held against them. What the judge says of an event is all that is recorded and
shown of it.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import asdict

from phalanx.arrays import Array
from phalanx.faults.commands import Condition, ProcessChange
from phalanx.network.inbox import Claim, Fate
from phalanx.recording.records import Level, Log
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.expressions.asked import place_of
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import Telemetry
from phalanx.wire.step_report import AppliedStep
from phalanx_plant.judge.assumptions import Assumptions
from phalanx_plant.judge.claims import Claims, Finding
from phalanx_plant.judge.coverage import Coverage
from phalanx_plant.world.events import (
    CommandObeyed,
    Event,
    InputApplied,
    InputLost,
    MemberLost,
    Sampled,
    StateReached,
)
from phalanx_plant.world.extremes import PairExtremes
from phalanx_plant.world.truth import IntegrationSteps, Seen, Truth
from phalanx_plant.world.world import DisturbanceKnot, DivergedError


class Judged(NamedTuple):
    """An event, and what the judge found."""

    event: Event
    notices: Sequence[Log] = ()
    """Lines of the event log."""
    peak: float = -np.inf
    """Of a state: the largest h_tot since the one before."""
    made: tuple[AppliedStep, Telemetry] | None = None
    """Of an input that took effect: its numbers, and what the agent says of it."""
    heard: Sequence[tuple[Fate, Finding]] = ()
    """Of an input: which broadcasts its agent reports on, and whether they were true."""


class Judge:
    """Holds every event against the safe set, certificates, assumptions and claims."""

    def __init__(self, rows: SafetyRows, telemetry: Callable[[int, int], Telemetry]) -> None:
        """telemetry: agent i's of its sample k, waited for if need be."""
        swarm = self._swarm = rows.swarm
        self.truth = Truth(rows)
        self.extremes = PairExtremes(swarm.safe_set)
        self.coverage = Coverage(swarm)
        self.coverage.begin(swarm.start())
        self.claims = Claims(swarm)
        self.assumptions = Assumptions(rows, self.coverage.assumption, self.claims.truthful)
        self.steps = 0
        """Inputs applied."""
        self.origins = {str(o): 0 for o in Origin if o is not Origin.ATTACK}
        """Steps of normal agents by how their input was made."""
        self._names, self._telemetry = swarm.names, telemetry
        self._latency = swarm.time.latency
        self._seen: deque[Seen] = deque()
        """Of the states to come, what the world went through before."""
        self._proven: deque[Array] = deque()
        """Of the inputs to come, for how long each pair is proven safe [s]."""
        self._unsafe: set[int] = set()
        """Pairs whose h is above zero."""
        self._turned: set[int] = set()
        self._said: set[str] = set()
        """Notices that come the first time alone."""
        self._rejected = [0 for _ in swarm.names]
        self._rejected_before = [0 for _ in swarm.names]
        """By those processes whose place another has taken."""

    @property
    def backups(self) -> int:
        """Steps of normal agents at which u_i^min was applied, for K_i was empty."""
        return self.origins[Origin.BACKUP]

    @property
    def rejected(self) -> dict[str, int]:
        """Payloads that agents dropped, by agent; agents that dropped none are left out."""
        counts = zip(self._names, self._rejected, self._rejected_before, strict=True)
        return {f"by agent {name}": now + before for name, now, before in counts if now + before}

    def prepare(self, events: Sequence[Event]) -> None:
        """Work out what these, which are judged next, need: it costs least for several at once."""
        seen = self.truth.of([e.way for e in events if isinstance(e, StateReached)])
        proven = self.coverage.proven([e for e in events if isinstance(e, InputApplied)])
        self._seen.extend(seen)
        self._proven.extend(proven)

    def take(self, event: Event) -> Judged:
        """Judge the next event, which was prepared. Raises DivergedError."""
        match event:
            case StateReached():
                return self._reached(event)
            case Sampled():
                self.assumptions.sampled(event)
            case CommandObeyed():
                return self._obeyed(event)
            case InputApplied():
                return self._applied(event)
            case InputLost():
                return self._lost(event)
            case MemberLost():
                return self._lost_member(event)
        return Judged(event)

    def saw(self, seen: Seen) -> None:
        """What the world went through. Raises DivergedError."""
        for piece in seen:
            if not isinstance(piece, DisturbanceKnot):
                if not (np.abs(piece.h_tot) <= LARGEST).all():
                    raise self._diverged(piece)
                self.extremes.add(piece.times, piece.pairs, piece.h, piece.h_tot)
            self.assumptions.saw(piece)

    def _diverged(self, steps: IntegrationSteps) -> DivergedError:
        """Which pair's h is not finite, and the method that says it; h_tot, if none is."""
        composed, t = self._swarm.safe_set, float(steps.times[-1])
        bad = ~(np.abs(steps.h) <= LARGEST).all(axis=0)
        if not bad.any():
            return DivergedError("h_tot", t)
        pair = composed.pairs[int(steps.pairs[np.argmax(bad)])]
        return DivergedError(f"h of {composed.label(pair)}", t, place_of(*composed.asked(pair)))

    def _reached(self, event: StateReached) -> Judged:
        self.saw(self._seen.popleft())
        self.coverage.reached(event.t)
        self.assumptions.reached(event)
        extremes, before = self.extremes, self._unsafe
        now = self._unsafe = extremes.take_unsafe()
        notices = [Log(event.t, extremes.left(p), Level.ERROR) for p in sorted(now - before)]
        notices += [
            Log(event.t, f"{extremes.label(p)} is safe again") for p in sorted(before - now)
        ]
        return Judged(event, notices, peak=extremes.take_peak())

    def _obeyed(self, event: CommandObeyed) -> Judged:
        command, effect, i = event.command, event.command.effect, event.changed
        if i is not None and effect is not None:
            if command.fault >= 0 and command.harms:
                self.claims.faults[command.fault] += 1
            if effect.leads_to is not None and effect.leads_to.silent:
                self.assumptions.fell_silent(i, command.t)
            if effect.leads_to is Condition.TURNED:
                self._turn(i)
            if effect.process is ProcessChange.STARTS:
                self._rejected_before[i] += self._rejected[i]
                self._rejected[i] = 0
        of = ", ".join(self._names[j] for j in event.forgotten)
        lost = f"; lost with it: the inputs received of {of}" if of else ""
        level = Level.WARNING if command.harms else Level.INFO
        return Judged(event, [Log(command.t, f"{command}{lost}", level)])

    def _turn(self, i: int) -> None:
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

    def _applied(self, event: InputApplied) -> Judged:
        i, name = event.i, self._names[event.i]
        # Taken first: a report that never comes must not leave it to the next input.
        proven = self._proven.popleft()
        telemetry, heard, notices = self._report(i, event.k, event.t)
        origin = telemetry.report.origin
        self._given(i, event.k, event.t, event.u)
        self.assumptions.applied(event, telemetry)
        self.steps += 1
        if i in self._swarm.normal and origin != Origin.ATTACK:
            self.origins[origin] += 1
        step = AppliedStep(
            u=tuple(event.u.tolist()),
            oldest_input=max((age for _, age in telemetry.ages), default=None),
            certified=self.coverage.applied(i, event.t_apply, proven),
            **asdict(telemetry.report),
        )
        if origin == Origin.BACKUP:
            notices += self._first(event.t_apply, f"agent {name}: first backup")
        return Judged(event, notices, made=(step, telemetry), heard=heard)

    def _lost(self, event: InputLost) -> Judged:
        _, heard, notices = self._report(event.i, event.k, event.sampled)
        self._given(event.i, event.k, event.sampled, event.u)
        self.assumptions.lost(event)
        notices += self._first(event.t, f"agent {self._names[event.i]}: first input lost")
        return Judged(event, notices, heard=heard)

    def _lost_member(self, event: MemberLost) -> Judged:
        name = self._names[event.i]
        if event.back:
            return Judged(event, [Log(event.t, f"agent {name} is back")])
        self.assumptions.fell_silent(event.i, event.t)
        lost = f"agent {name} is lost; its actuator holds its input"
        return Judged(event, [Log(event.t, lost, Level.WARNING)])

    def _given(self, i: int, k: int, sampled: float, u: Array) -> None:
        self.claims.given(i, k, Claim(sampled + self._latency, tuple(u.tolist())))

    def _report(
        self, i: int, k: int, t: float
    ) -> tuple[Telemetry, list[tuple[Fate, Finding]], list[Log]]:
        """Agent i's report on its sample k at t [s], what it heard, and what is new in that."""
        telemetry = self._telemetry(i, k)
        self._rejected[i] = telemetry.rejected
        heard = [(fate, self.claims.heard(i, fate, t)) for fate in telemetry.fates]
        liars = [self._names[fate.sender] for fate, found in heard if found.false]
        notices = [
            n for liar in liars for n in self._first(t, f"agent {liar}: first false broadcast")
        ]
        return telemetry, heard, notices

    def _first(self, t: float, text: str) -> list[Log]:
        """A warning, the first time alone."""
        if text in self._said:
            return []
        self._said.add(text)
        return [Log(t, text, Level.WARNING)]
