"""The frames of a recording: the same that viewers were shown while the run went on."""

import functools

import numpy as np

from phalanx.faults.commands import FaultState
from phalanx.guarantee.verdict import Assumption
from phalanx.recording.broadcasts import broadcasts
from phalanx.recording.read import Recording, UnreadableRecordingError, steps_by_agent
from phalanx.wire.messages import Frame, LinkEvent, LogLine, worse
from phalanx_viewer.feeds.agent_steps import AgentSteps
from phalanx_viewer.feeds.history import (
    ConditionChange,
    History,
    PairSeries,
    TimeSeries,
    fates_of,
    pair_states,
)
from phalanx_viewer.scene.model import scene_model

_EVENT_SHOWN = 0.05
"""How long a lost or late broadcast stays in sight [s]."""
_PAIR_STATES = 400
"""Most states of which h of every pair is told."""


class RecordedRun:
    """A recording, asked by time."""

    def __init__(self, recording: Recording) -> None:
        """Raises ScenarioError if its scenario cannot be built; if no state is in it, as read."""
        if not recording.states:
            raise UnreadableRecordingError(f"{recording.path}: the recording holds no state")
        self.model = scene_model(recording.scenario)
        self.summary = recording.summary
        self.times = recording.times
        self._x, self._h_tot = recording.x, recording.h_tot
        self._worst = np.maximum.accumulate(self._h_tot)
        self._log, self._commands = recording.log, recording.commands
        self._broadcasts = list(broadcasts(recording))
        self._agents = [AgentSteps(steps) for steps in steps_by_agent(recording).values()]
        false = [(sender, s.t_apply) for s in recording.steps for sender, *_ in s.false]
        self._lies = [np.sort([t for who, t in false if who == name]) for name in self.model.names]
        """Times of each agent's false broadcasts [s]."""
        self._applied = np.sort([s.t_apply for s in recording.steps])
        poses = [self.model.kinematics.poses(x) for x in self._x]
        self.positions = np.array([p.positions for p in poses])
        """Output points at every state [m], shape (s, N, 3)."""

    @property
    def worst_at(self) -> float:
        """When h_tot was largest [s]."""
        return float(self.times[int(np.argmax(self._h_tot))])

    @property
    def log(self) -> list[LogLine]:
        """The event log."""
        return [LogLine(line.t, line.text) for line in self._log]

    def index_at(self, t: float) -> int:
        """The last state that is not after t [s], by its index."""
        return max(int(np.searchsorted(self.times, t, side="right")) - 1, 0)

    def frame(self, t: float) -> Frame:
        """The run as it was at t [s], standing still."""
        index = self.index_at(t)
        x, faults = self._x[index], self._faults(t)
        violations = self.summary.violations if self.summary else []
        return Frame(
            t=float(self.times[index]),
            x=x.tobytes(),
            h_tot=float(self._h_tot[index]),
            worst_h=float(self._worst[index]),
            pair=self.model.values.worst_pair(x),
            agents=tuple(
                a.status(t, faults.condition[i], int(np.searchsorted(lies, t, side="right")))
                for i, (a, lies) in enumerate(zip(self._agents, self._lies, strict=True))
            ),
            link_events=self._link_events(t),
            steps=int(np.searchsorted(self._applied, t, side="right")),
            real_time_factor=0.0,
            assumptions=self._failed(t),
            violations=tuple(v for v in violations if v.first <= t),
            log=tuple(line for line in self.log if line.t <= t),
            paused=True,
            speed=0.0,
            loss=faults.loss,
            delay=faults.delay,
        )

    def history(self) -> History:
        """The whole run, for the plots."""
        distances = [self.model.smallest_distance(positions) for positions in self.positions]
        psi = np.array([self.model.values.higher_psi(x) for x in self._x])
        swarm = np.column_stack([self.times, self._h_tot, distances, psi])
        series = [a.series(len(self.model.input_names(i))) for i, a in enumerate(self._agents)]
        return History(
            TimeSeries(swarm.shape[1], swarm),
            series.__getitem__,
            functools.cache(self._pairs),
            functools.cache(lambda: fates_of(self._broadcasts)),
            self._broadcasts,
            self._conditions(),
        )

    def _pairs(self) -> PairSeries:
        """At the worst state of each block of time: all of them would be many, of many pairs."""
        most = min(_PAIR_STATES, len(self.times))
        count = pair_states(len(self.model.swarm.safe_set.pairs), most)
        blocks = np.array_split(np.arange(len(self.times)), count)
        worst = [block[int(np.argmax(self._h_tot[block]))] for block in blocks]
        every_h = self.model.values.every_h
        # One state at a time: for several at once it takes half as much memory again.
        return PairSeries(self.times[worst], np.array([every_h(x) for x in self._x[worst]]))

    def _conditions(self) -> list[ConditionChange]:
        faults, found = FaultState(self.model.names), []
        for command in self._commands:
            if (i := faults.obey(command)) is not None:
                found.append(ConditionChange(command.t, i, faults.condition[i]))
        return found

    def _failed(self, t: float) -> tuple[Assumption, ...]:
        """The assumptions that had failed by t [s]: how often is recorded of the end alone."""
        if self.summary is None:
            return ()
        found = [a for a in self.summary.assumptions if a.first is not None and a.first <= t]
        if t >= self.times[-1]:
            return tuple(found)
        # What a note adds to the assumption's own text are figures of the whole run.
        return tuple(Assumption(a.name, 1, 0, a.first, a.note.partition(";")[0]) for a in found)

    def _faults(self, t: float) -> FaultState:
        faults = FaultState(self.model.names)
        for command in self._commands:
            if command.t <= t:
                faults.obey(command)
        return faults

    def _link_events(self, t: float) -> tuple[LinkEvent, ...]:
        found: dict[tuple[int, int], float] = {}
        for receiver, agent in enumerate(self._agents):
            for step in agent.applied_within(t - _EVENT_SHOWN, t):
                for sender, _, delay in step.fates:
                    if delay != 0.0:
                        link = self.model.names.index(sender), receiver
                        found[link] = worse(found.get(link, 0.0), delay)
        return tuple(LinkEvent(*link, delay) for link, delay in found.items())
