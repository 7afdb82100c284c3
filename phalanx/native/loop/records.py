"""The recording of a run, from columns of its events: the same records as of any engine."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from phalanx_plant.observers.recorder import RecordSink
from phalanx_plant.observers.track import DueStates

from phalanx.native.loop.columns import Batch
from phalanx.native.loop.steps import Lists, Steps
from phalanx.recording.records import Log, State, Step
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin

_EVERY_ORIGIN = tuple(Origin)


class ColumnRecorder:
    """Records one run."""

    def __init__(self, swarm: Swarm, recording: RecordSink) -> None:
        self._names, self._declared = swarm.names, swarm.links.declared
        self._sizes = [len(member.dynamics.inputs) for member in swarm.members]
        self._recording = recording
        self._due, self._peak = DueStates(swarm), np.full(2, -np.inf)
        """The latter: the largest values since the last recorded state."""

    def record(
        self, batch: Batch, peaks: Array, certified: Array, notices: Mapping[int, Sequence[Log]],
        seconds: float,
    ) -> None:  # fmt: skip
        """Record what happened. Raises RecordingError.

        Args:
            batch: the events.
            peaks: of each state, shape (n, 2).
            certified: of each input [s], shape (r,); NaN of an adversary.
            notices: lines of the log, by the number of the event that comes before them.
            seconds: wall time of a step.
        """
        states, inputs = batch.columns.states, batch.columns.inputs
        number, records = states.number.tolist(), list[tuple[int, int, Any]]()
        begin = 0
        for row in self._due.of(states.t):
            peak = np.maximum(self._peak, peaks[begin : row + 1].max(axis=0)).tolist()
            state = State(float(states.t[row]), states.x[row].tolist(), *peak)
            records.append((number[row], 0, state))
            self._peak, begin = np.full(2, -np.inf), row + 1
        self._peak = np.maximum(self._peak, peaks[begin:].max(axis=0, initial=-np.inf))
        records += [(n, 1, line) for n, lines in notices.items() for line in lines]
        steps = self._steps(batch, certified, seconds)
        records += [(n, 2, step) for n, step in zip(inputs.number.tolist(), steps, strict=True)]
        records.sort(key=lambda record: record[:2])
        self._recording.write(*[record for _, _, record in records])

    def _steps(self, batch: Batch, certified: Array, seconds: float) -> list[Step]:
        """Return the records of control steps."""
        inputs, steps, names, sizes = batch.columns.inputs, batch.answers, self._names, self._sizes
        numbers = (inputs.i, inputs.k, inputs.t_sample, inputs.t_apply, inputs.origin)
        missing = (_or_none(column) for column in (steps["residual"], steps["margin"], certified))
        columns = [*(c.tolist() for c in (*numbers, inputs.u, inputs.u_nom)), *missing]
        lists = (self._ages(steps), *self._fates(steps), _tuples(steps.lists["bindings"]))
        return [
            Step(
                origin=_EVERY_ORIGIN[origin], residual=residual, margin=margin,
                u_nom=tuple(wish[: sizes[i]]), solve_time=seconds, binding=binding,
                u=tuple(u[: sizes[i]]), certified=proven, agent=names[i], k=k, t=t,
                t_apply=t_apply, ages=ages, fates=fates, faults=faults,
            )
            for i, k, t, t_apply, origin, u, wish, residual, margin, proven, ages, fates, faults,
            binding in zip(*columns, *lists, strict=True)
        ]  # fmt: skip

    def _ages(self, steps: Steps) -> list[list[Any]]:
        """Return sender and age [s] of the received inputs that each step used."""
        ages = steps.lists["ages"]
        names = [self._names[l] for l in ages["age_of"].tolist()]
        return _cut(ages, list(zip(names, ages["age"].tolist(), strict=True)))

    def _fates(self, steps: Steps) -> tuple[list[list[Any]], list[list[Any]]]:
        """Return sender, number and delay [s] of what each step decided on, and what hit it."""
        fates = steps.lists["fates"]
        names = [self._names[l] for l in fates["fate_from"].tolist()]
        numbers, delays = fates["fate_k"].tolist(), fates["fate_delay"].tolist()
        faults = fates["fate_faults"]
        decided = _cut(fates, list(zip(names, numbers, delays, strict=True)))
        hits: list[list[Any]] = [[] for _ in decided]
        rows = fates.row
        for entry in np.flatnonzero(faults).tolist():
            hit = [self._declared[n] for n in bits(int(faults[entry]))]
            hits[int(rows[entry])].append((names[entry], numbers[entry], hit))
        return decided, hits


def bits(faults: int) -> list[int]:
    """Return the numbers of declared faults that a word has."""
    return [n for n in range(faults.bit_length()) if faults >> n & 1]


def _cut(lists: Lists, entries: list[Any]) -> list[list[Any]]:
    """Return the entries of each list."""
    ends = np.cumsum(lists.counts).tolist()
    return [entries[begin:end] for begin, end in pairwise([0, *ends])]


def _tuples(bindings: Lists) -> list[tuple[int, ...]]:
    return [tuple(rows) for rows in _cut(bindings, bindings["binding_of"].tolist())]


def _or_none(column: Array) -> list[float | None]:
    """Return numbers, None for NaN."""
    return [value if value == value else None for value in column.tolist()]
