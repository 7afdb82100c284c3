"""The recording of a run, and the hash of its trajectory."""

import hashlib
import struct
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from phalanx.messages.kinds import Sample, Telemetry
from phalanx.network.inbox import DeliveryReport
from phalanx.recording.columns import Inputs, States
from phalanx.recording.records import State, Step, StepData
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Index
from phalanx_plant.judge.claims import Finding
from phalanx_plant.judge.judge import Judged
from phalanx_plant.observers.track import DueStates
from phalanx_plant.world.events import CommandApplied, InputApplied, InputLost, StateReached
from phalanx_plant.world.extremes import LOWEST, larger

_TIME, _INPUT = struct.Struct("=d"), struct.Struct("=dd")


class TrajectoryHash:
    """SHA-256 over the states at all events and all applied inputs, in order.

    Two runs have the same hash if they are equal to the last bit.
    """

    def __init__(self) -> None:
        self._sha = hashlib.sha256()

    def add(self, events: Sequence[Judged]) -> None:
        """Take the next events."""
        parts = list[bytes | memoryview]()
        for judged in events:
            match judged.event:
                case StateReached(t=t, x=x):
                    parts += _TIME.pack(t), x.data
                case InputApplied(i=i, k=k, u=u):
                    parts += _INPUT.pack(i, k), u.data
        self._sha.update(b"".join(parts))

    def add_columns(self, states: States, inputs: Inputs, sizes: Index) -> None:
        """Take the same of events as columns; sizes: numbers of inputs of each agent."""
        begun = np.column_stack([states.t, states.x])
        applied = np.column_stack([inputs.i, inputs.k, inputs.u])
        fits = np.arange(applied.shape[1]) < (2 + sizes[inputs.i])[:, None]
        widths = np.append(np.full(len(begun), begun.shape[1]), fits.sum(axis=1))
        order = np.argsort(np.append(states.number, inputs.number))
        begins = np.empty(len(order), dtype=np.intp)
        begins[order] = np.cumsum(widths[order]) - widths[order]
        numbers = np.empty(widths.sum())
        numbers[begins[: len(begun), None] + np.arange(begun.shape[1])] = begun
        indices = begins[len(begun) :, None] + np.arange(applied.shape[1])
        numbers[indices[fits]] = applied[fits]
        self._sha.update(numbers.data)

    @property
    def hexadecimal(self) -> str:
        """The hash of all events so far."""
        return self._sha.hexdigest()


class RecordSink(Protocol):
    """Takes the records of a run: the writer of a file, or a list in memory."""

    def write(self, *records: Any) -> None:
        """Take the next records. Raises RecordingError."""


class Recorder:
    """Records one run."""

    def __init__(self, swarm: Swarm, recording: RecordSink) -> None:
        self._names, self._declared = swarm.names, swarm.links.declared
        self._recording = recording
        self._due = DueStates(swarm)
        self._peak = LOWEST
        """Largest values since the last recorded state."""
        self._received: list[list[tuple[DeliveryReport, Finding]]] = [[] for _ in swarm.names]
        """By agent, the broadcasts since its last recorded step: a step whose input was lost is not
        recorded."""

    def record(self, events: Sequence[Judged]) -> None:
        """Record the next events. Raises RecordingError."""
        records: list[Any] = []
        for judged in events:
            event = judged.event
            match event:
                case StateReached():
                    self._peak = larger(self._peak, judged.peak)
                    if self._due.take(event.t):
                        records.append(State(event.t, event.x.tolist(), *self._peak))
                        self._peak = LOWEST
                case CommandApplied():
                    records.append(event.command)
                case InputApplied() | InputLost():
                    self._received[event.i] += judged.received
            records += judged.notices
            if isinstance(event, InputApplied) and event.telemetry:
                records.append(self._step(judged, event, event.telemetry))
                if event.answers is not None:
                    records.append(self._step_data(event.i, event.answers, event.telemetry))
        self._recording.write(*records)

    def _step(self, judged: Judged, event: InputApplied, telemetry: Telemetry) -> Step:
        names = self._names
        received, self._received[event.i] = self._received[event.i], []
        return Step(
            agent=names[event.i],
            k=event.k,
            t=event.t_sample,
            t_apply=event.t_apply,
            ages=[(names[l], age) for l, age in telemetry.ages],
            fates=[(names[fate.sender], fate.k, fate.delay) for fate, _ in received],
            faults=[
                (names[fate.sender], fate.k, [self._declared[n] for n in hit])
                for fate, finding in received
                if (hit := (*fate.faults, *finding.lies))
            ],
            false=[
                (names[fate.sender], fate.k, fate.claim.t_apply, list(fate.claim.u))
                for fate, finding in received
                if finding.false and fate.claim is not None
            ],
            false_states=[
                (names[fate.sender], fate.k, list(fate.claim.x))
                for fate, finding in received
                if finding.false and fate.claim is not None and fate.claim.x
            ],
            notes=dict(telemetry.notes),
            **judged.step,
        )

    def _step_data(self, i: int, sample: Sample, telemetry: Telemetry) -> StepData:
        names = self._names
        return StepData(
            agent=names[i],
            k=sample.k,
            t=sample.t,
            seen=[names[l] for l in sample.seen],
            x=np.frombuffer(sample.x, dtype="<f8").tolist(),
            received=[(names[l], since, list(u)) for l, since, u in telemetry.received],
            adversary=sample.commands is not None and sample.commands.adversary,
        )
