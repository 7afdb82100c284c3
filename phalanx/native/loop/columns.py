"""The events of a run as columns, read from what the loop wrote: no object stands for an event."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from phalanx_plant.judge.event_columns import Columns
from phalanx_plant.world.segments import Segments

from phalanx.native.loop.memory import MOST_IN_SEGMENT, Memory
from phalanx.native.loop.steps import Lists, Steps, written, written_steps
from phalanx.recording.columns import ORIGINS, Aged, Inputs, Samples, Stated, States
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array, Index
from phalanx.theory.rows.origin import Origin

_MADE_BY = Origin.QP, Origin.SOLVER_FAILED, Origin.BACKUP, Origin.NO_AUTHORITY, Origin.ATTACK
_ORIGINS = np.array([ORIGINS[origin] for origin in _MADE_BY])
"""By number, as terms.c has them."""
_MOST_CLAIMS = 2048
"""Broadcasts of a sender that a later report may be about, and those of a call."""
_RESULTS = "instants", "segments", "steps", "ages", "fates", "bindings", "applied"


class Batch(NamedTuple):
    """Events of consecutive instants, and the motion up to each."""

    columns: Columns
    segments: Segments
    knots: Sequence[tuple[float, Array]]
    """Time [s] and stacked disturbance at each of its knots, shape (n̄,)."""
    answers: Steps
    """The control steps that made the inputs."""


class _Instants(NamedTuple):
    """The numbers of the events of each instant: its state, its samples, its inputs."""

    t: Array
    first: int
    """Number of the first state."""
    steps: Index
    applied: Index
    """Ends of each instant's samples and inputs among those of the call."""

    @property
    def states(self) -> Index:
        """Numbers of the states, shape (n,)."""
        before = np.append(0, (self.steps + self.applied)[:-1])
        numbers: Index = self.first + np.arange(len(self.t)) + before
        return numbers

    def samples(self, count: int) -> Index:
        """Numbers of so many samples."""
        s = np.arange(count)
        instant = np.searchsorted(self.steps, s, side="right")
        numbers: Index = self.first + instant + 1 + s + np.append(0, self.applied)[instant]
        return numbers

    def inputs(self, count: int) -> tuple[Index, Index]:
        """Return numbers of so many inputs, and their instants."""
        a = np.arange(count)
        instant = np.searchsorted(self.applied, a, side="right")
        return self.first + instant + 1 + a + self.steps[instant], instant


class ColumnReader:
    """Makes columns of the results of one call after the other."""

    def __init__(self, rows: SafetyRows, memory: Memory) -> None:
        """Begin at x(0), with event 0."""
        swarm = rows.swarm
        self._memory, self._swarm, members = memory, swarm, len(swarm.members)
        self._sizes = np.array([len(member.dynamics.inputs) for member in swarm.members])
        self.t, self.x = 0.0, memory["x"].copy()
        """The last instant [s], and the true stacked state there, shape (n̄,)."""
        self._number, self._latency = 0, swarm.time.latency
        self._believed = np.isin(np.arange(members), swarm.normal)
        self._said_t = np.zeros((members, _MOST_CLAIMS))
        self._said_u = np.zeros((members, _MOST_CLAIMS, int(self._sizes.max())))
        """Of the newest broadcasts, by sender and number: since when [s] which input counts."""
        self._pending = self._with_claims(written_steps(memory, self._sizes))
        """Steps whose input is to take effect."""
        self._knots = list[tuple[float, Array]]()
        self._segments = self._written_segments()
        """Both of the instant that is yet to be reached."""

    def read(self) -> Batch | None:
        """Return what happened up to the last instant of the last call; None if it has none."""
        memory = self._memory
        begun = self._with_claims(written_steps(memory, self._sizes))
        segments, left = self._segments.and_then(self._written_segments()), len(self._segments.t)
        t, steps, applied, upto = (
            written(memory, "instants", f"instant_{name}")
            for name in ("t", "steps", "applied", "segments")
        )
        numbers = written(memory, "applied", "applied_step")
        self._make_room()
        last = left + int(upto[-1]) if len(t) else 0
        self._segments = segments.between(last, len(segments.t))
        if not len(t):
            return None
        answers = self._answers(begun, numbers)
        return self._batch(
            _Instants(t, self._number, steps, applied), segments.between(0, last), left + upto,
            begun, answers,
        )  # fmt: skip

    def _batch(
        self, instants: _Instants, segments: Segments, upto: Index, begun: Steps, answers: Steps
    ) -> Batch:
        """Return the events of instants; upto: the end of each one's segments, shape (n,)."""
        i, ages = begun["i"], answers.lists["ages"]
        table = np.concatenate([self.x[None], segments.x])
        x = table[np.append(0, np.cumsum(segments.counts))[upto]]
        self.t, self.x = float(instants.t[-1]), x[-1]
        columns = Columns(
            States(instants.states, instants.t, x),
            Samples(instants.samples(len(i)), i, begun["t"], np.full(len(i), True)),
            _inputs(answers, instants),
            Aged(ages.row, ages["age_of"], ages["age"]),
            self._stated(answers),
        )
        self._number += len(x) + len(i) + len(answers["i"])
        knots, self._knots = self._knots, []
        history = np.searchsorted(upto, np.arange(len(segments.t)), side="right")
        return Batch(columns, segments._replace(history=history), knots, answers)

    def _answers(self, begun: Steps, numbers: Index) -> Steps:
        """Return the steps with these numbers; others wait for their inputs to take effect."""
        steps = self._pending.and_then(begun)
        rows = np.searchsorted(steps["number"], numbers)
        self._pending = steps.take(np.setdiff1d(np.arange(len(steps["number"])), rows))
        return steps.take(rows)

    def _written_segments(self) -> Segments:
        """Return the motion of the last call, and keep its knots."""

        def column(name: str, *shape: int) -> Any:
            return written(self._memory, "segments", f"segment_{name}", *shape)

        n, axes = len(self.x), self._swarm.groups[0].axes
        t, counts, phi = column("t"), column("steps"), column("phi", n)
        self._knots += [(float(t[s]), phi[s]) for s in np.flatnonzero(column("knot")).tolist()]
        some = np.arange(MOST_IN_SEGMENT) < counts[:, None]
        return Segments(
            np.zeros_like(counts), t, column("dt"), counts, phi, column("slope", n),
            column("u", int(self._sizes.sum())), column("start", n),
            column("x", MOST_IN_SEGMENT, n)[some],
            column("p", MOST_IN_SEGMENT, len(self._sizes), axes)[some],
        )  # fmt: skip

    def _with_claims(self, steps: Steps) -> Steps:
        """Add to the fates of steps what was claimed, and remember what these claim."""
        i, slots = steps["i"], steps["k"] % _MOST_CLAIMS
        self._said_t[i, slots] = steps["t"] + self._latency
        self._said_u[i, slots] = steps["u"]
        fates = steps.lists["fates"]
        of = fates["fate_from"], fates["fate_k"] % _MOST_CLAIMS
        claims = {"claim_t": self._said_t[of], "claim_u": self._said_u[of]}
        fates = Lists(fates.counts, {**fates.columns, **claims})
        return Steps(steps.columns, {**steps.lists, "fates": fates})

    def _stated(self, answers: Steps) -> Stated:
        """Return the claims that believed agents report."""
        fates = answers.lists["fates"]
        row, place = fates.row, fates.place
        some = ~(fates["fate_delay"] < 0.0) & self._believed[answers["i"]][row]
        names = "fate_from", "fate_k", "claim_t", "claim_u"
        return Stated(row[some], place[some], *(fates[name][some] for name in names))

    def _make_room(self) -> None:
        """Forget the results of the last call."""
        self._memory.number("first_step")[0] += self._memory.number("steps")[0]
        for name in _RESULTS:
            self._memory.number(name)[0] = 0


def _inputs(answers: Steps, instants: _Instants) -> Inputs:
    count, bindings = len(answers["i"]), answers.lists["bindings"]
    numbers, instant = instants.inputs(count)
    return Inputs(
        numbers, answers["i"], answers["k"], answers["t"], instants.t[instant],
        np.zeros(count, dtype=bool), _ORIGINS[answers["origin"]], answers["u"], answers["wish"],
        np.cumsum(bindings.counts), bindings["binding_of"],
    )  # fmt: skip
