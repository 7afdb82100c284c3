"""Judge a recorded run again: the plant with the recorded inputs in place of its agents.

The motion follows from scenario, seed, commands and inputs, and so do all events: the same judge
folds over them. No agent decides anything, so no controller need be repeatable.
"""

from collections import defaultdict, deque

import numpy as np
from msgspec.structs import replace

from phalanx.faults.commands import CommandPolicy
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.messages.kinds import Sample, Telemetry
from phalanx.messages.step_report import StepReport
from phalanx.network.inbox import Conviction, DeliveryReport
from phalanx.recording.fates import RecordedFates
from phalanx.recording.read import Recording, UnreadableRecordingError, swarm_of
from phalanx.swarm.rows import build_rows
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.judge.event_queue import LARGE_BATCH
from phalanx_plant.run import PlantRun
from phalanx_plant.sampling.sampling import NoProcesses

_REPORTED = StepReport.__struct_fields__


def judge_again(recording: Recording) -> Summary:
    """Return the summary of a recorded run, from its recorded inputs and reports alone.

    It equals the recorded one but for its wall time, and the payloads that agents dropped.
    Raises UnreadableRecordingError: the run has no verdict of its own or was in real time, or its
    inputs give another trajectory.
    """
    summary, swarm = recording.summary, swarm_of(recording)
    if summary is None or summary.outcome in (Outcome.STOPPED, Outcome.BROKEN):
        raise UnreadableRecordingError(f"{recording.path}: the run did not reach its end")
    if summary.punctuality is not None:
        raise UnreadableRecordingError(f"{recording.path}: a run in real time happens only once")
    agents = RecordedAgents(recording, summary, swarm)
    policy = CommandPolicy(schedule=tuple(c for c in recording.commands if c.fault < 0))
    commands = CommandQueue(policy, swarm.names)
    rows = build_rows(swarm)
    again = PlantRun(rows, agents, None, commands, Lockstep, batch=LARGE_BATCH).run()
    if again.trajectory != summary.trajectory:
        raise UnreadableRecordingError(f"{recording.path}: its inputs give another trajectory")
    return again


class RecordedAgents(NoProcesses):
    """Agents that answer as recorded."""

    def __init__(self, recording: Recording, summary: Summary, swarm: Swarm) -> None:
        index = self._index = {name: i for i, name in enumerate(swarm.names)}
        self._swarm, self._newest = swarm, dict[int, int]()
        """The latter: by agent, the number of its newest sample."""
        recorded = RecordedFates(recording, swarm)
        self._steps = recorded.steps
        self._fates = [deque[DeliveryReport]() for _ in swarm.names]
        """By receiver, those of broadcasts that no sample has counted yet."""
        for step in recording.steps:
            self._fates[index[step.agent]] += recorded.of(step)
        self._convictions = defaultdict[tuple[int, float], list[Conviction]](list)
        """By agent and time of its sample [s]."""
        for c in summary.trust.convictions if summary.trust else ():
            conviction = Conviction(index[c.of], c.begin, c.end, c.excess)
            self._convictions[index[c.by], c.t].append(conviction)
        self._telemetry: dict[tuple[int, int], Telemetry] = {}
        self._codec, self._states = StateCodec(swarm), dict[tuple[int, int], tuple[float, ...]]()
        """The latter: by agent with a radio and number, the state that it could state."""

    def send_sample(self, i: int, sample: Sample) -> None:
        """Answer agent i's sample as recorded; of an input that was lost only fates are known."""
        latest = dict(zip(sample.senders, sample.latest, strict=True))
        fates = list[DeliveryReport]()
        if self._swarm.peers(i):
            state = self._codec.unpack_one(i, sample.x, sample.seen)
            self._states[i, sample.k] = tuple(state.tolist())
        while (queue := self._fates[i]) and queue[0].k <= latest.get(queue[0].sender, -1):
            fates.append(self._with_state(queue.popleft()))
        self._newest[i], step = sample.k, self._steps.get((i, sample.k))
        report: StepReport = step or StepReport(origin=Origin.QP, residual=None, solve_time=0.0)
        self._telemetry[i, sample.k] = Telemetry(
            k=sample.k,
            report=StepReport(**{name: getattr(report, name) for name in _REPORTED}),
            ages=tuple((self._index[name], age) for name, age in (step.ages if step else ())),
            fates=tuple(fates),
            convictions=tuple(self._convictions[i, sample.t]),
        )

    def _with_state(self, fate: DeliveryReport) -> DeliveryReport:
        """Add the sender's state to a true claim."""
        x = self._states.get((fate.sender, fate.k), ())
        if fate.claim is None or fate.claim.x or not x:
            return fate
        return replace(fate, claim=replace(fate.claim, x=x))

    def await_input(self, i: int) -> Array:
        """Return agent i's input for its newest sample, shape (m_i,); zeros if it was lost."""
        step = self._steps.get((i, self._newest[i]))
        return np.array(step.u) if step else np.zeros(len(self._swarm.members[i].dynamics.inputs))

    take_input = await_input

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """Return agent i's report on its sample k."""
        return self._telemetry.pop((i, k))

    def publish_status(self, message: object) -> None:
        """Do nothing."""
