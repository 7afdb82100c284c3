"""The events of a run, read from what the loop wrote: the judge gets them as from any engine."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

from phalanx_plant.world.events import Event, InputApplied, Sampled, StateReached
from phalanx_plant.world.world import DisturbanceKnot, History, Segment

from phalanx.messages.kinds import Telemetry
from phalanx.messages.step_report import StepReport
from phalanx.native.loop.memory import MOST_INPUTS, Memory
from phalanx.network.inbox import AnnouncedInput, DeliveryReport
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin

_ORIGINS = Origin.QP, Origin.SOLVER_FAILED, Origin.BACKUP, Origin.NO_AUTHORITY, Origin.ATTACK
"""By number, as terms.c has them."""
_MOST_IN_SEGMENT = 4
_MOST_CLAIMS = 2048
"""Broadcasts of a sender that a later report may be about."""

T = TypeVar("T")


class _Step(NamedTuple):
    """A control step whose input is to take effect."""

    i: int
    k: int
    t: float
    u: Array


class _Results:
    """Results that the loop wrote in its last call."""

    def __init__(self, memory: Memory) -> None:
        sizes = "instants", "segments", "steps", "ages", "fates", "bindings", "applied"
        self.count = {name: int(memory.number(name)[0]) for name in sizes}
        self._memory = memory

    def array(self, name: str, *shape: int) -> Array:
        """Return a copy of an array as far as it is written; shape: of each entry."""
        kind = name.partition("_")[0]
        count = self.count["applied" if kind == "applied" else f"{kind}s"]
        array: Array = self._memory[name].reshape(-1, *shape)[:count].copy()
        return array

    def list(self, name: str) -> list[float]:
        """Return an array of numbers as a list."""
        numbers: list[float] = self.array(name).tolist()
        return numbers


class EventReader:
    """Makes events of the results of one call after the other."""

    def __init__(self, rows: SafetyRows, memory: Memory) -> None:
        """Begin at x(0)."""
        swarm = rows.swarm
        self._memory, self._members = memory, range(len(swarm.members))
        self._sizes = [len(member.dynamics.inputs) for member in swarm.members]
        self._n, self._axes = swarm.safe_set.parts[-1].stop, swarm.groups[0].axes
        self.t = 0.0
        """Of the last instant [s]."""
        self.x: Array = memory["x"].copy()
        """The true stacked state at the last instant, shape (n̄,)."""
        self.p: Array = memory["p"].reshape(-1, self._axes).copy()
        """Output positions there [m], shape (N, d)."""
        self._history: History = []
        """Of the instant that is yet to be reached."""
        self._pending: dict[int, _Step] = {}
        """By number: steps whose input is to take effect."""
        self._telemetry: dict[tuple[int, int], Telemetry] = {}
        self._claims = [dict[int, AnnouncedInput]() for _ in self._members]
        self._latency = swarm.time.latency

    def take_telemetry(self, i: int, k: int) -> Telemetry:
        """Return agent i's report on its sample k, and forget it."""
        return self._telemetry.pop((i, k))

    def instants(self, seconds: float) -> Iterator[list[Event]]:
        """Yield the events of each instant that the last call reached; it took so long [s]."""
        results = _Results(self._memory)
        samples = list(self._read_steps(results, seconds / max(results.count["steps"], 1)))
        pieces, knots = self._segments(results), results.list("segment_knot")
        numbers = results.list("applied_step")
        ends = (results.list(f"instant_{name}") for name in ("steps", "applied", "segments"))
        begun = step = segment = 0
        for t, *upto in zip(results.list("instant_t"), *ends, strict=True):
            self._follow(pieces[segment : int(upto[2])], knots[segment:])
            events: list[Event] = [
                StateReached(t, self.x, self._history),
                *samples[step : int(upto[0])],
            ]
            for number in numbers[begun : int(upto[1])]:
                i, k, sampled, u = self._pending.pop(int(number))
                events.append(InputApplied(i, k, sampled, t, u))
            self.t, self._history = t, []
            yield events
            step, begun, segment = map(int, upto)
        self._follow(pieces[segment:], knots[segment:])
        self._empty(results)

    def _follow(self, pieces: list[Segment], knots: list[float]) -> None:
        """Append to the history of the instant that is yet to be reached."""
        for piece, is_knot in zip(pieces, knots, strict=False):
            if is_knot:
                self._history.append(DisturbanceKnot(piece.t, piece.phi))
            self._history.append(piece)
            self.x, self.p = piece.x[-1], piece.p[-1]

    def _segments(self, results: _Results) -> list[Segment]:
        """Return the integrated motion, piece by piece."""
        n, members, axes = self._n, len(self._members), self._axes
        fields = (results.list(f"segment_{name}") for name in ("t", "dt", "end"))
        vectors = [results.array(f"segment_{name}", n) for name in ("phi", "slope")]
        u = results.array("segment_u", sum(self._sizes))
        start = results.array("segment_start", n)
        x = results.array("segment_x", _MOST_IN_SEGMENT, n)
        p = results.array("segment_p", _MOST_IN_SEGMENT, members, axes)
        counts = map(int, results.list("segment_steps"))
        ends = [(x[s, :count], p[s, :count]) for s, count in enumerate(counts)]
        rows = zip(*fields, *vectors, u, start, ends, strict=True)
        return [Segment(*fields, *after) for *fields, after in rows]

    def _read_steps(self, results: _Results, seconds: float) -> Iterator[Sampled]:
        """Keep the steps, their reports and claims; yield their samples. seconds: of each."""
        first = int(self._memory.number("first_step")[0])
        who, which = (map(int, results.list(f"step_{name}")) for name in ("i", "k"))
        times, origins = results.list("step_t"), map(int, results.list("step_origin"))
        residuals, margins = results.list("step_residual"), results.list("step_margin")
        wishes, inputs = (results.array(f"step_{n}", MOST_INPUTS) for n in ("wish", "u"))
        rejected = map(int, results.list("step_rejected"))
        ages, fates = self._ages(results), self._fates(results)
        others = _parts([int(l) for l in results.list("binding_of")], results.list("step_bindings"))
        steps = zip(
            who, which, times, origins, residuals, margins, wishes, inputs, rejected, ages, fates,
            others, strict=True,
        )  # fmt: skip
        for number, step in enumerate(steps):
            i, k, t, origin, residual, margin, wish, held, refused, a, f, binding = step
            u = held[: self._sizes[i]]
            self._pending[first + number] = _Step(i, k, t, u)
            claims = self._claims[i]
            claims[k] = AnnouncedInput(t + self._latency, tuple(u.tolist()))
            claims.pop(k - _MOST_CLAIMS, None)
            report = StepReport(
                u_nom=tuple(wish[: self._sizes[i]].tolist()),
                origin=_ORIGINS[origin],
                residual=residual if residual == residual else None,
                margin=margin if margin == margin else None,
                binding=binding,
                solve_time=seconds,
            )
            fates_of = tuple(self._fate(*fate) for fate in f)
            telemetry = Telemetry(k=k, report=report, ages=a, fates=fates_of, rejected=refused)
            self._telemetry[i, k] = telemetry
            yield Sampled(i, t)

    def _ages(self, results: _Results) -> Iterator[tuple[tuple[int, float], ...]]:
        """Yield the ages of received inputs of each step."""
        pairs = [
            (int(l), age)
            for l, age in zip(results.list("age_of"), results.list("age"), strict=True)
        ]
        return _parts(pairs, results.list("step_ages"))

    def _fates(self, results: _Results) -> Iterator[tuple[tuple[int, int, float, int], ...]]:
        """Yield what each step decided on: sender, number, delay [s] and bits of faults."""
        names = ("from", "k", "delay", "faults")
        fates = list(zip(*(results.list(f"fate_{name}") for name in names), strict=True))
        return _parts(fates, results.list("step_fates"))

    def _fate(self, sender: int, k: int, delay: float, faults: int) -> DeliveryReport:
        numbers = tuple(n for n in range(faults.bit_length()) if faults >> n & 1)
        claim = None if delay < 0.0 else self._claims[sender][k]
        return DeliveryReport(sender, k, delay, numbers, claim)

    def _empty(self, results: _Results) -> None:
        """Make room for the next call."""
        self._memory.number("first_step")[0] += results.count["steps"]
        for name in results.count:
            self._memory.number(name)[0] = 0


def _parts(entries: list[T], ends: Sequence[float]) -> Iterator[tuple[T, ...]]:
    """Yield the entries up to each end, from the end before on."""
    begin = 0
    for end in map(int, ends):
        yield tuple(entries[begin:end])
        begin = end
