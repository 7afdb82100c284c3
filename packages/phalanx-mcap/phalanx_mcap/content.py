"""Contents of an exported recording: numbers, violated pairs, and the log."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from phalanx_viewer.scene.model import SceneModel

from phalanx.guarantee.verdict import Outcome
from phalanx.messages.step_report import QUANTITIES
from phalanx.recording.curves.beliefs import RecordedBeliefs
from phalanx.recording.curves.history import recorded_series
from phalanx.recording.curves.series import Series, unit_of
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Level, Log
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.models.dynamics import units

_AT_ONCE = 64
"""States whose pairs are evaluated together."""
_LEVELS = {
    Outcome.GUARANTEED: Level.INFO,
    Outcome.SAFE: Level.WARNING,
    Outcome.VIOLATED: Level.ERROR,
    Outcome.BROKEN: Level.ERROR,
    Outcome.STOPPED: Level.INFO,
}


class Numbers(NamedTuple):
    """Numbers that are known at the same times."""

    topic: str
    kind: str
    """Name of their type, such as "UnicycleState"."""
    t: Array
    """[s], shape (s,)."""
    values: Mapping[str, Array]
    """By name, shapes (s,); NaN where unknown."""
    units: Mapping[str, str]
    """By name; "" if it has none."""
    origins: Sequence[str] = ()
    """Of control steps: how each input was made."""


class Content:
    """A recording, ready to be written."""

    def __init__(self, recording: Recording, model: SceneModel) -> None:
        self.recording, self.model, self.x = recording, model, recording.x
        self.poses = [model.kinematics.poses(x) for x in self.x]
        self.radio = RecordedBeliefs(recording, model.swarm) if model.swarm.by_radio else None
        """What agents knew of one another; None where they see one another."""
        self.pairs, self.h = near_pairs(model.swarm, self.x)
        """Pairs that were the worst one of some agent, and their h, shape (s, r)."""
        self.labels = [model.label(pair) for pair in self.pairs]

    def numbers(self) -> Iterator[Numbers]:
        """h of the swarm and of pairs; each agent's states, numbers of its steps, and ages."""
        t, swarm, steps = self.recording.times, self.model.swarm, steps_by_agent(self.recording)
        h = {"h_tot": self.recording.h_tot}
        h |= {f"h_{label}": of for label, of in zip(self.labels, self.h.T, strict=True)}
        yield Numbers("h", "H", t, h, {})
        of_quantities = {name: unit_of(quantity, swarm) for name, quantity in QUANTITIES.items()}
        for member, part in zip(swarm.members, swarm.safe_set.parts, strict=True):
            of, kind, name = units(member.dynamics), type(member.dynamics).__name__, member.name
            states = dict(zip(of.states, self.x[:, part].T, strict=True))
            yield Numbers(f"agents/{name}/state", f"{kind}State", t, states, of.states)
            series = recorded_series(steps[name], len(of.inputs))
            inputs = {f"u_{i}": unit for i, unit in of.inputs.items()}
            inputs |= {f"nominal_{i}": unit for i, unit in of.inputs.items()}
            values = dict(zip(inputs, [*series.u.T, *series.u_nom.T], strict=True)) | series.numbers
            origins = [step.origin for step in steps[name]]
            yield Numbers(
                f"agents/{name}/step", f"{kind}Step", series.sampled, values,
                inputs | of_quantities, origins,
            )  # fmt: skip

        if self.radio:
            for i in self.radio.news:
                yield self._ages(self.radio, i)

    def _ages(self, radio: RecordedBeliefs, i: int) -> Numbers:
        """Return ages of what agent i knew; of itself NaN, so that all agents' have one type."""
        t, ages, names = np.array(radio.sampled[i]), radio.ages(i), self.model.names
        unknown = Series(t, np.full(len(t), np.nan))
        values = {names[l]: ages.get(l, unknown).y for l in radio.news}
        return Numbers(f"agents/{names[i]}/ages", "Ages", t, values, dict.fromkeys(values, "s"))

    def violated(self) -> Iterator[tuple[dict[str, tuple[Array, Array]], list[str]]]:
        """Ends [m] of each pair with h > 0, by its name, and pairs that are over, at each state.

        Pairs without a normal agent are left out.
        """
        before: list[str] = []
        unsafe, turns = ~(self.h <= 0.0), self.recording.turns
        for t in turns.values():
            turned = [i for i, at in turns.items() if at <= t]
            excluded = self.model.swarm.without_normal(turned)
            unsafe[self.recording.times >= t] &= ~excluded[self.pairs]
        for outside, poses in zip(unsafe, self.poses, strict=True):
            now = {
                self.labels[k]: self.model.ends(self.pairs[k], poses.positions)
                for k in np.flatnonzero(outside)
            }
            yield now, sorted(set(before) - now.keys())
            before = list(now)

    def log(self) -> list[Log]:
        """Events and failed assumptions by time, the verdict last."""
        recording, end = self.recording, self.recording.states[-1].t
        summary, failed = recording.summary, []
        if summary is None:
            verdict = Log(end, f"no verdict: {recording.unfinished}", Level.ERROR)
        else:
            text = f"{summary.outcome}: {summary.reason}"
            verdict = Log(max(summary.t, end), text, _LEVELS[summary.outcome])
            failed = [
                Log(a.first, f"failed: {a.name} ({a.failed} of {a.checked} checks)", Level.WARNING)
                for a in summary.assumptions
                if a.failed and a.first is not None
            ]
        return [*sorted([*recording.log, *failed], key=lambda line: line.t), verdict]


def near_pairs(swarm: Swarm, x: Array) -> tuple[list[int], Array]:
    """Find the pairs that were the worst one of some agent at some of the states, shape (s, n̄).

    Returns the r pairs' indices in the composed set, and their h, shape (s, r).
    """
    pairs = swarm.pairs.every
    every = swarm.pairs.choose(pairs)
    mine = [np.flatnonzero((every.pairs == i).any(axis=1)) for i in swarm.normal]
    worst: set[int] = set()
    for begin in range(0, len(x), _AT_ONCE):
        h = every.h(x[begin : begin + _AT_ONCE])
        for rows in mine:
            worst.update(every.order[rows[h[:, rows].argmax(axis=1)]].tolist() if len(rows) else ())
    near = sorted(worst)
    chosen = swarm.pairs.choose(pairs[near])
    h = np.empty((len(x), len(near)))
    h[:, chosen.order] = chosen.h(x)
    return near, h
