"""The scribe: has every event judged, recorded and shown, while the agents compute."""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from msgspec.structs import asdict

from phalanx.arrays import Array
from phalanx.faults.commands import Condition, ProcessChange
from phalanx.network.inbox import Fate
from phalanx.recording.records import Level, Log, Shown, State, Step
from phalanx.recording.write import RecordingWriter
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import Sample, Status, Telemetry
from phalanx.wire.step_report import AppliedStep
from phalanx_plant.events.events import (
    CommandObeyed,
    Event,
    InputApplied,
    InputLost,
    InstantOver,
    MemberLost,
    Sampled,
    StateReached,
)
from phalanx_plant.judge.claims import Finding
from phalanx_plant.judge.coverage import Applied
from phalanx_plant.judge.judge import Judge
from phalanx_plant.scribe.ahead import Ahead
from phalanx_plant.scribe.frames import FramePublisher
from phalanx_plant.scribe.trajectory import TrajectoryHash
from phalanx_plant.world.truth import Seen, Truth, Way

_STATUS_EVERY = 0.1
"""Wall time between status messages [s]."""


class RunScribe:
    """Judges, records and shows one run."""

    def __init__(
        self,
        names: tuple[str, ...],
        declared: tuple[str, ...],
        truth: Truth,
        judge: Judge,
        recording: RecordingWriter,
        frames: FramePublisher,
        telemetry: Callable[[int, int], Telemetry],
        publish_status: Callable[[Status], None],
        recording_step: float = 0.0,
    ) -> None:
        """Write to a recording, and show.

        Args:
            names: of all agents.
            declared: names of all faults.
            truth: of the way that the world went.
            judge: is told every event.
            recording: of the run.
            frames: for viewers.
            telemetry: agent i's of its sample k, waited for if need be.
            publish_status: tells whoever watches how far the run is.
            recording_step: least time between two recorded states [s].
        """
        self._names, self._declared, self._judge = names, declared, judge
        # Looked up at each call, for a stopwatch may time them.
        self._ways = Ahead[Way, Seen](lambda ways: truth.of(ways))
        self._inputs = Ahead[Applied, Array](lambda applied: judge.coverage.proven(applied))
        self._x = np.zeros(0)
        """The stacked state at the last event that is expected, shape (n̄,)."""
        self._recording, self._frames = recording, frames
        self._telemetry, self._publish_status = telemetry, publish_status
        self.trajectory = TrajectoryHash()
        self._rejected = [0 for _ in names]
        self._rejected_before = [0 for _ in names]
        """By those processes whose place another has taken."""
        self.faults: Counter[int] = Counter()
        """Messages on which each declared fault had an effect."""
        self._backed_up: set[int] = set()
        self._without_input: set[int] = set()
        """Agents of which an input was lost on its way to the actuator."""
        self._lied: set[int] = set()
        """Agents that told a peer what they did not apply."""
        self._heard: list[list[tuple[Fate, Finding]]] = [[] for _ in names]
        """For each agent, what it heard since its last step that is recorded: one whose input was
        lost is not."""
        self._unsafe: set[int] = set()
        """Pairs whose h is above zero."""
        self._began = self._status_at = time.monotonic()
        self._t = 0.0
        self._recording_step, self._state_due = recording_step, 0.0
        self._peak = -np.inf
        """Largest h_tot since the last recorded state."""

    @property
    def rejected_by_agents(self) -> dict[str, int]:
        """Payloads that agents dropped, by agent; agents that dropped none are left out."""
        counts = zip(self._names, self._rejected, self._rejected_before, strict=True)
        return {f"by agent {name}": now + before for name, now, before in counts if now + before}

    def expect(self, event: Event) -> None:
        """This will be told, after all that was expected before."""
        match event:
            case StateReached():
                self._x = event.x
                self._ways.ask(event.way)
            case InputApplied():
                self._inputs.ask(Applied(event.i, event.t_apply, self._x, event.u))

    def witness(self, event: Event) -> None:
        """Take the next event. Raises RecordingError, DivergedError."""
        match event:
            case StateReached():
                self._on_state(event)
            case Sampled():
                self._judge.sampled(event)
            case CommandObeyed():
                self._on_command(event)
            case InputApplied():
                self._on_input(event)
            case InputLost():
                self._on_lost_input(event)
            case MemberLost():
                self._on_lost_member(event)
            case InstantOver():
                self._frames.settled()

    def idle(self) -> None:
        """Show what is due to be shown."""
        self._frames.show()
        now = time.monotonic()
        if now < self._status_at:
            return
        self._status_at = now + _STATUS_EVERY
        judge = self._judge
        self._publish_status(
            Status(
                t=self._t,
                real_time_factor=self._t / max(now - self._began, 1e-9),
                worst_h=judge.extremes.worst_h_tot,
                steps=judge.steps,
                backups=judge.backups,
            )
        )

    def _on_state(self, event: StateReached) -> None:
        self._t = event.t
        self._judge.reached(event, self._ways.next())
        self.trajectory.add(event)
        peak = self._judge.extremes.take_peak()
        self._frames.saw_state(event, peak)
        self._peak = max(self._peak, peak)
        if event.t >= self._state_due:
            self._recording.write(State(event.t, event.x.tolist(), self._peak))
            self._state_due, self._peak = event.t + self._recording_step, -np.inf
        unsafe = self._judge.extremes.take_unsafe()
        for pair in sorted(unsafe - self._unsafe):
            self._say(event.t, self._judge.extremes.left(pair), Level.ERROR)
        for pair in sorted(self._unsafe - unsafe):
            self._say(event.t, f"{self._judge.extremes.label(pair)} is safe again")
        self._unsafe = unsafe

    def _on_command(self, event: CommandObeyed) -> None:
        command = event.command
        self._recording.write(command)
        self._frames.saw_command(command)
        of = ", ".join(self._names[j] for j in event.forgotten)
        lost = f"; lost with it: the inputs received of {of}" if of else ""
        self._say(command.t, f"{command}{lost}", Level.WARNING if command.harms else Level.INFO)
        effect = command.effect
        if event.changed is None or effect is None:
            return
        if command.fault >= 0 and command.harms:
            self.faults[command.fault] += 1
        if effect.leads_to is not None and effect.leads_to.silent:
            self._judge.fell_silent(event.changed, command.t)
        if effect.leads_to is Condition.TURNED:
            self._judge.turned(event.changed)
        if effect.process is ProcessChange.STARTS:
            self._rejected_before[event.changed] += self._rejected[event.changed]
            self._rejected[event.changed] = 0

    def _on_input(self, event: InputApplied) -> None:
        i, name = event.i, self._names[event.i]
        # Taken first: a report that never comes must not leave it to the next input.
        proven = self._inputs.next()
        telemetry = self._take_telemetry(i, event.k, event.t)
        step = AppliedStep(
            u=tuple(event.u.tolist()),
            oldest_input=max((age for _, age in telemetry.ages), default=None),
            certified=self._judge.applied(event, telemetry, proven),
            **asdict(telemetry.report),
        )
        self.trajectory.add(event)
        self._frames.saw_step(i, step, telemetry.fates)
        if step.origin == Origin.BACKUP and i not in self._backed_up:
            self._backed_up.add(i)
            self._say(event.t_apply, f"agent {name}: first backup", Level.WARNING)
        self._recording.write(self._recorded(event, step, telemetry.ages))
        if event.answers is not None:
            self._recording.write(_shown(self._names, event.i, event.answers, telemetry))

    def _on_lost_input(self, event: InputLost) -> None:
        self._take_telemetry(event.i, event.k, event.sampled)
        self._judge.lost(event)
        if event.i not in self._without_input:
            self._without_input.add(event.i)
            lost = f"agent {self._names[event.i]}: first input lost"
            self._say(event.t, lost, Level.WARNING)

    def _on_lost_member(self, event: MemberLost) -> None:
        what = "is back" if event.back else "is lost; its actuator holds its input"
        level = Level.INFO if event.back else Level.WARNING
        self._say(event.t, f"agent {self._names[event.i]} {what}", level)
        if not event.back:
            self._judge.fell_silent(event.i, event.t)

    def _take_telemetry(self, i: int, k: int, t: float) -> Telemetry:
        """Agent i's report on its sample k at t [s]."""
        telemetry = self._telemetry(i, k)
        self._rejected[i] = telemetry.rejected
        for fate in telemetry.fates:
            for fault in fate.faults:
                self.faults[fault] += 1
            finding = self._judge.claims.heard(i, fate, t)
            self._heard[i].append((fate, finding))
            if finding.false:
                self._frames.saw_lie(fate.sender)
            if finding.false and fate.sender not in self._lied:
                self._lied.add(fate.sender)
                lied = f"agent {self._names[fate.sender]}: first false broadcast"
                self._say(t, lied, Level.WARNING)
        return telemetry

    def _say(self, t: float, text: str, level: Level = Level.INFO) -> None:
        self._recording.write(Log(t, text, level))
        self._frames.say(t, text)

    def _recorded(
        self, event: InputApplied, step: AppliedStep, ages: Iterable[tuple[int, float]]
    ) -> Step:
        names = self._names
        heard, self._heard[event.i] = self._heard[event.i], []
        hit = [
            (names[fate.sender], fate.k, [self._declared[n] for n in (*fate.faults, *found.lies)])
            for fate, found in heard
        ]
        return Step(
            agent=names[event.i],
            k=event.k,
            t=event.t,
            t_apply=event.t_apply,
            ages=[(names[l], age) for l, age in ages],
            fates=[(names[fate.sender], fate.k, fate.delay) for fate, _ in heard],
            faults=[entry for entry in hit if entry[2]],
            false=[
                (names[fate.sender], fate.k, fate.claim.t_apply, list(fate.claim.u))
                for fate, found in heard
                if found.false and fate.claim is not None
            ],
            **asdict(step),
        )


def _shown(names: Sequence[str], i: int, sample: Sample, telemetry: Telemetry) -> Shown:
    return Shown(
        agent=names[i],
        k=sample.k,
        t=sample.t,
        seen=[names[l] for l in sample.seen],
        x=np.frombuffer(sample.x, dtype="<f8").tolist(),
        received=[(names[l], since, list(u)) for l, since, u in telemetry.received],
        adversary=sample.orders is not None and sample.orders.adversary,
    )
