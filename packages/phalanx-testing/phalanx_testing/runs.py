"""A run with assertions, in the words of fault tests: safe, arrives, recovers, detects."""

from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from phalanx.faults.fault import TimedFault
from phalanx.guarantee.verdict import Outcome, waiting_in_words
from phalanx.launcher.network_effect import network_effect
from phalanx.launcher.run import Run
from phalanx.launcher.run import run as run_scenario
from phalanx.launcher.verify import first_difference, verify
from phalanx.recording.metrics.measures import Thresholds, deadlocks_of
from phalanx.recording.metrics.table import metrics_of
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.rows.origin import EMPTY
from phalanx_testing.claims import claim
from phalanx_testing.conditions import Source, faulty

FASTEST_ENGINE = "auto"
"""It runs every scenario, with the bits of processes."""


class Moment(NamedTuple):
    """The swarm at one recorded event."""

    t: float
    """[s]"""
    states: Mapping[str, Array]
    """True state of every agent, by name."""
    h: Mapping[str, float]
    """Every pair's h, as "<agent>-<agent>"; safe is h <= 0."""


class CheckedRun(Run):
    """A finished run whose assertions raise ClaimError, which names pair and time."""

    @classmethod
    def of(cls, run: Run) -> Self:
        """Return a finished run with assertions."""
        return cls(run.folder, run.summary, run._temporary)

    @property
    def moments(self) -> Iterator[Moment]:
        """The swarm at every recorded event."""
        swarm, recording = self._swarm, self.recording
        h = {pair: values.tolist() for pair, values in swarm.h_of_pairs(recording.x).items()}
        for k, (t, x) in enumerate(zip(recording.times.tolist(), recording.x, strict=True)):
            states = {n: x[part] for n, part in zip(swarm.names, swarm.safe_set.parts, strict=True)}
            yield Moment(t, states, {pair: values[k] for pair, values in h.items()})

    @claim
    def assert_guaranteed(self) -> str | None:
        """Claim that every pair was proven safe at every instant."""
        return None if self.verdict is Outcome.GUARANTEED else self._verdict_in_words

    @claim
    def assert_safe(self) -> str | None:
        """Claim that no pair was unsafe at any integration step, until the run's end."""
        safe = self.verdict in (Outcome.GUARANTEED, Outcome.SAFE)
        return None if safe else self._verdict_in_words

    @claim
    def assert_never_closer(self, distance: float) -> str | None:
        """Claim that no normal agent comes closer to another agent than this [m]."""
        swarm, recording = self._swarm, self.recording
        p = swarm.positions(recording.x)
        others = [(i, l) for i in swarm.normal for l in range(len(swarm.names)) if i != l]
        if not others:
            return "there is no other agent"
        distances = np.array([length(p[:, i] - p[:, l]) for i, l in others])
        pair, k = np.unravel_index(distances.argmin(), distances.shape)
        if distances[pair, k] >= distance:
            return None
        i, l = (swarm.names[agent] for agent in others[pair])
        return (
            f"{i} and {l} were {distances[pair, k]:.4g} m apart at t = {recording.times[k]:.3f} s"
        )

    @claim
    def assert_arrives(self, by: float, reach: float = 0.5) -> str | None:
        """Claim that normal agents are where their goals come to rest by a time [s], to the end.

        reach: an agent is there within this distance [m].
        """
        swarm = self._swarm
        metrics = metrics_of(self.recording, swarm, Thresholds(arrival=reach))
        agents = {swarm.names[i]: metrics[swarm.names[i]] for i in swarm.normal}
        if all(agent["arrived"] is None for agent in agents.values()):
            return "no normal agent has a goal that comes to rest"
        for name, agent in agents.items():
            if agent["arrived"] is False:
                return f"{name} ended {agent['distance_to_goal']:.4g} m from its goal"
            if (arrival := agent["arrival_time"]) is not None and arrival > by:
                return f"{name} was there from t = {arrival:.3f} s on"
        return None

    @claim
    def assert_no_deadlock(self) -> str | None:
        """Claim that no normal agent stands though it wants to move, as deadlock_time has it."""
        deadlocks = deadlocks_of(self.recording, self._swarm)
        waiting = waiting_in_words(deadlocks)
        return f"{waiting}: phalanx explain {self.folder} --stuck" if deadlocks else None

    @claim
    def assert_promise_kept(self) -> str | None:
        """Claim that pairs were promised something before the run, and that nothing broke it."""
        promise = self.summary.promise if self.summary else None
        if promise is None:
            return "nothing was promised: no agent keeps a fallback (safety.keep)"
        return None if promise.kept else str(promise)

    @claim
    def assert_recovers(self, after: str, within: float) -> str | None:
        """Claim that all is well from some time after the end of each fault on, until the next.

        Well is: no pair is unsafe, and no normal agent is on its backup or without authority.

        Args:
            after: the kind of the faults, such as "partition".
            within: the time [s].
        """
        spans = self._spans(after)
        end = min((end for _, end in spans), default=np.inf)
        if not spans or end + within >= self.scenario.duration:
            reason = "no such fault" if not spans else f"it lasts until t = {end:g} s"
            return f"nothing to see of a recovery: {reason}"
        idle = [name for name in self._idle if f"({after})" in name]
        if idle:
            return f"{idle[0]} never had an effect"
        normal = {self._swarm.names[i] for i in self._swarm.normal}
        unsafe = ((s.t, "a pair is unsafe") for s in self.recording.states if (s.h or 0.0) > 0.0)
        empty = (
            (step.t, f"{step.agent} has the origin {step.origin}")
            for step in self.recording.steps
            if step.origin in EMPTY and step.agent in normal
        )
        for t, words in sorted(chain(unsafe, empty)):
            if t >= end and not any(begin <= t < over + within for begin, over in spans):
                return f"{words} at t = {t:.3f} s"
        return None

    @claim
    def assert_never(self, predicate: Callable[[Moment], bool]) -> str | None:
        """Claim that something holds at no recorded event."""
        return next((f"true at t = {m.t:.3f} s" for m in self.moments if predicate(m)), None)

    @claim
    def assert_eventually(
        self, predicate: Callable[[Moment], bool], by: float = np.inf
    ) -> str | None:
        """Claim that something holds at a recorded event up to a time [s]."""
        came_true = any(moment.t <= by and predicate(moment) for moment in self.moments)
        return None if came_true else f"false at every event up to t = {min(by, self._end):g} s"

    @claim
    def assert_detects(self, liar: str, within: float = np.inf) -> str | None:
        """Claim that an agent convicts a liar within a time of its first false broadcast [s]."""
        trust = self.summary.trust if self.summary else None
        if trust is None:
            return "no agent watches another (safety.watch), or knows one by radio"
        if false := [c for c in trust.convictions if c.after is None]:
            return f"{false[0].by} convicted {false[0].of} falsely at t = {false[0].t:.3f} s"
        delays = [c.after for c in trust.convictions if c.of == liar and c.after is not None]
        if delays and min(delays) <= within:
            return None
        return f"it took {min(delays):.3f} s" if delays else f"no agent convicted {liar}"

    @claim
    def assert_same_bits(
        self, other: Run | None = None, engine: str = FASTEST_ENGINE
    ) -> str | None:
        """Claim that another run has the same trajectory; by default it is run again, on `engine`.

        Raises as phalanx.verify.
        """
        if other is None:
            return verify(self, engine=engine).difference
        return first_difference(self.recording, other.recording)

    @claim
    def assert_network_matters(self) -> str | None:
        """Claim that every fault had an effect, and the network changed an input.

        Inputs are held against those of agents that know the truth: see Run.network_effect. A test
        without such an effect would pass for any network.
        """
        if self._idle:
            return f"{self._idle[0]} never had an effect"
        if not any(effect.effect for effect in network_effect(self.scenario)):
            return "every input is that of an agent which knows the truth"
        return None

    @property
    def _verdict_in_words(self) -> str:
        assert self.summary is not None, "claims ask it first"
        words = f"{self.summary.outcome}: {self.summary.reason}"
        return f"{words}; worst h {self.summary.worst_in_words}"

    @property
    def _end(self) -> float:
        return self.summary.t if self.summary else 0.0

    @property
    def _idle(self) -> list[str]:
        """Declared faults that never had an effect."""
        faults = self.summary.faults if self.summary else []
        return [fault.name for fault in faults if not fault.count]

    def _spans(self, kind: str) -> list[tuple[float, float]]:
        """Return begin and end of all faults of a kind [s]."""
        scenario = self.scenario
        timed = [
            (fault.at, fault.end)
            for fault in scenario.faults
            if isinstance(fault, TimedFault) and fault.kind == kind
        ]
        occurrences = scenario.links().occurrences
        return timed + [(o.begin, o.end) for o in occurrences if o.fault.kind == kind]


def run(
    scenario: Source,
    *,
    engine: str = FASTEST_ENGINE,
    out: str | Path | None = None,
    **conditions: Any,
) -> CheckedRun:
    """Run a scenario under faults to its verdict.

    Args:
        scenario: as `faulty` takes it.
        engine: as phalanx.run takes it.
        out: the same.
        conditions: seed, faults, overrides and fields of the network, as `faulty` takes them.

    Raises as `faulty` and phalanx.run.
    """
    return CheckedRun.of(run_scenario(faulty(scenario, **conditions), engine=engine, out=out))
