"""Try sets, gaps, cones, own parts, tubes and shares on adverse motions, and count what is wrong.

    python -m evidence.knowledge.sets [PEERS] [RUNS]

Peers are double integrators, in each other block single ones. They were heard up to 1 s ago, some
with announced inputs or errors of stamps, and move at random or at their bounds with few changes;
each is compared with its set, gap and cones, and one own input with its largest own part, at 48
instants of a hold. Tubes are compared with the worst disturbance that an adjoint finds, brakes with
their own part in the worst direction. Runs have 4 agents that rush at one another, or cross, and
lose half of their broadcasts, in each other run single integrators; each gap that one uses is
compared with the true one.
"""

import argparse
from functools import partial
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.cones import cones, own_motion
from phalanx.knowledge.held import held, moved
from phalanx.knowledge.motion import Motion, Motions, PointMotion, stacked
from phalanx.knowledge.own_parts import OwnPartsInput
from phalanx.knowledge.sets import Boxes, HeardState, enclosures
from phalanx.knowledge.spending import hold_pieces
from phalanx.theory.arrays import Array
from tests.unit.knowledge.adverse import (
    box_motion,
    draw_motion,
    draw_states,
    draw_velocity_motion,
    gap,
)
from tests.unit.knowledge.swarms import RADIUS, Member, Radio, cross, keep_right, rush
from tests.unit.knowledge.test_tracking import draw_gaps, worst_error

BLOCK = 500
"""Peers of one own state."""
PARTS = 12
INSTANTS = 48
ROUNDING = 1e-9
"""Allowed for this trial's own rounding [m, m/s]."""


class Count:
    """Counts of claims that were compared and that are wrong, and the least that was left."""

    def __init__(self, name: str) -> None:
        self._name, self._claims, self._wrong, self._least = name, 0, 0, np.inf

    def add(self, slack: Array) -> None:
        """Add claims by what they are on the safe side."""
        self._claims += slack.size
        self._wrong += int((slack < -ROUNDING).sum())
        self._least = min(self._least, float(slack.min(initial=np.inf)))

    def __str__(self) -> str:
        return f"| {self._name} | {self._claims} | {self._wrong} | {self._least:.2g} |"


class Peers(NamedTuple):
    """Peers of one block: what was heard, and where they are."""

    states: list[HeardState]
    motions: Motions
    now: Array
    """True references, shape (n, 2 axes)."""
    boxes: Boxes


def main() -> None:
    """Print one line for each kind of claim."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("peers", type=int, nargs="?", default=100_000)
    arguments.add_argument("runs", type=int, nargs="?", default=20)
    options, rng = arguments.parse_args(), np.random.default_rng(0)
    print("| claim | compared | wrong | least slack [m, m/s] |\n|---|---|---|---|")
    names = "sets", "gaps by sets", "cones", "own parts over a hold"
    counts = [Count(name) for name in names]
    for number in range(-(-options.peers // BLOCK)):
        try_block(counts, draw_velocity_motion(rng) if number % 2 else draw_motion(rng), rng)
    counts += [try_brakes(options.peers // 20, rng), try_tubes(options.runs * 5, rng)]
    print(*counts, *try_runs(options.runs), sep="\n")


def try_block(counts: list[Count], motion: Motion, rng: np.random.Generator) -> None:
    """Compare one own state with many peers."""
    axes, peers = motion.axes, draw_peers(motion, rng)
    low, high = peers.boxes
    counts[0].add(np.minimum(peers.now - low, high - peers.now).min(axis=1))
    own = draw_states(motion, 1, rng)[0] * rng.choice([0.0, 0.3, 3.0])
    own[:axes] = 0.0
    claims = peers.boxes.distance(own[:axes]) - peers.motions.stopping(peers.boxes.speed())
    ways = peers.motions.stopping(np.linalg.norm(peers.now[:, axes:], axis=1))
    counts[1].add(np.linalg.norm(peers.now[:, :axes], axis=1) - ways - claims)
    hold = hold_pieces(motion, 4)
    around = cones(own_motion(own, motion), peers.boxes, peers.motions, hold.times)
    u = motion.authority * rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], axes)
    if rng.random() < 0.2:
        u = motion.brake(own[axes:])
    claims = hold.spending(own[axes:], u[None], around)[0]
    largest, there = np.full(BLOCK, -np.inf), peers.now
    inputs = draw_inputs(INSTANTS, peers.motions, axes, rng)
    step = motion.longest / INSTANTS
    here = own
    for instant in range(INSTANTS):
        # In the middle of each part: where a brake ends at rest, L has no derivative.
        time = step * (0.5 if instant == 0 else 1.0)
        there = moved(there, inputs[instant], peers.motions.held(np.full((BLOCK, 1), time)))
        here = moved(here, u, motion.held(np.array([time])))
        n = here[:axes] - there[:, :axes]
        n /= np.linalg.norm(n, axis=1)[:, None]
        largest = np.maximum(largest, own_part(motion, here[axes:], u, n))
        piece = min(instant * 4 // INSTANTS, 3)
        counts[2].add((around.axis[:, piece] * n).sum(axis=1) - around.cos[:, piece])
    counts[3].add(claims - largest)


def draw_peers(motion: Motion, rng: np.random.Generator) -> Peers:
    """Peers around the origin, their sets, and where they are by now."""
    axes, drag = motion.axes, motion.drag
    bounds = zip(rng.uniform(1.0, 6.0, BLOCK), rng.uniform(0.01, 0.05, BLOCK), strict=True)
    peers = [
        box_motion(axes, float(a), 0.0, 0.0, 0.05, float(g))
        if motion.jumps
        else PointMotion(axes, float(a), drag, 0.0, longest=0.05, shortest=float(g))
        for a, g in bounds
    ]
    motions, believes = stacked(peers), bool(rng.random() < 0.3)
    error = float(rng.choice([0.0, 0.0, 0.05]))
    z = 2.0 * draw_states(motion, BLOCK, rng)
    z[:, :axes] *= rng.choice([0.5, 2.0, 10.0], BLOCK)[:, None]
    age = rng.uniform(0.0, 1.0, BLOCK)
    inputs = draw_inputs(PARTS, motions, axes, rng)
    announced = rng.uniform(-1.0, 1.0, (BLOCK, axes)) * motions.authority
    applies = np.minimum(rng.choice([0.0, 0.02], BLOCK), age)
    believed = np.minimum(motions.shortest, age - applies)
    if not believes:
        believed = np.zeros(BLOCK)
    now = moved(z, inputs[0], motions.held(applies[:, None]))
    now = moved(now, announced, motions.held(believed[:, None]))
    for u in inputs:
        now = moved(now, u, motions.held((age - applies - believed)[:, None] / PARTS))
    stamps = -age + rng.uniform(-error, error, BLOCK)
    rows = zip(stamps, z, applies, announced, strict=True)
    states = [HeardState(float(t), x, x, float(t + a), u) for t, x, a, u in rows]
    boxes = enclosures(states, np.zeros(BLOCK), motions, error, believes)
    return Peers(states, motions, now, boxes)


def draw_inputs(count: int, motions: Motions, axes: int, rng: np.random.Generator) -> Array:
    """Inputs of equal parts, shape (count, n, axes): at their bounds with one change, or random."""
    shape = len(motions.longest), axes
    begin, end = (rng.choice([-1.0, 1.0], shape) for _ in range(2))
    changes = rng.integers(0, count + 1, shape)
    bang = np.where(np.arange(count)[:, None, None] < changes, begin, end)
    mixed = rng.random(shape[0]) < 0.2
    drawn = np.where(mixed[:, None], rng.uniform(-1.0, 1.0, (count, *shape)), bang)
    inputs: Array = drawn * motions.authority
    return inputs


def own_part(motion: Motion, v: Array, u: Array, n: Array) -> Array:
    """(d/dt) L - n·v at a speed, for n of shape (k, axes)."""
    value: Array
    if motion.jumps:
        value = -(n @ u)
        return value
    change, speed = u - motion.drag * v, float(np.linalg.norm(v))
    turn = float(change @ v) / speed if speed > 0.0 else float(np.linalg.norm(change))
    value = change @ v / motion.authority + motion.longest * turn - n @ v
    return value


def try_brakes(number: int, rng: np.random.Generator) -> Count:
    """Compare the own part of brakes, others being in the worst direction, with 0."""
    count = Count("brakes: own part at most 0")
    for _ in range(number):
        motion = draw_motion(rng)
        v = rng.normal(size=motion.axes) * 10.0 ** rng.uniform(-3.0, 1.5)
        u, times = motion.brake(v), np.arange(16) / 16.0 * motion.longest
        factors = held(np.array([[motion.drag]]), times[:, None])
        for path in factors.decay * v + factors.speed * u:
            n = -path / max(float(np.linalg.norm(path)), 1e-300)
            scale = 1.0 + float(np.linalg.norm(v))
            count.add(-own_part(motion, path, u, n[None]) / scale)
    return count


def try_tubes(number: int, rng: np.random.Generator) -> Count:
    """Compare tubes with the worst errors that an adjoint finds."""
    count = Count("tubes: place, speed, reserve")
    for _ in range(number):
        longest = float(rng.uniform(0.02, 0.15))
        shortest = float(rng.uniform(0.2, 0.95)) * longest
        drag, bound = float(rng.choice([0.0, 0.5, 2.0])), float(rng.uniform(0.01, 0.3))
        errors = rng.choice([0.0, 0.02], 2).tolist()
        motion = PointMotion(2, 20.0, drag, bound, longest, shortest, *errors)
        tracked = motion.tracking
        pull = tracked.gains[0] * errors[0] + abs(tracked.gains[1]) * errors[1]
        gaps = draw_gaps(motion, str(rng.choice(["long", "short", "random"])), rng)
        until = float(rng.choice([0.0, 0.5, 1.0])) * longest
        worst = worst_error(motion, gaps, until, np.array([1.0, 0.0]))
        fastest = worst_error(motion, gaps, until, np.array([0.0, 1.0]))
        most = worst_error(motion, gaps, 0.0, np.array(tracked.gains)) + pull
        bounds = tracked.tube - worst, tracked.speed_tube - fastest, tracked.reserve - most
        count.add(np.array(bounds))
    return count


def try_runs(number: int) -> list[Count]:
    """Compare gaps that were used in closed loop with the true ones, and distances with R."""
    used, apart = Count("gaps used, by sets and shares"), Count("distances less R")
    for seed in range(number):
        drag, law = (0.0, 0.6)[seed // 2 % 2], (rush, keep_right(3.0))[seed // 4 % 2]
        motion: Motion = PointMotion(2, 4.0, drag, 0.0, longest=0.05, shortest=0.02)
        if seed % 2:
            motion = box_motion(2, 3.0, 0.0, 0.0, 0.05, 0.02)
        claims: list[float] = []
        end = cross(
            4,
            Radio(0.5, every=4, relays=True),
            seed,
            motion=motion,
            law=law,
            circle=3.5,
            duration=5.0,
            observe=partial(compare, motion, claims),
        )
        used.add(np.array(claims))
        apart.add(np.array([end.least]))
    return [used, apart]


def compare(
    motion: Motion,
    claims: list[float],
    _t: float,
    i: int,
    members: list[Member],
    result: OwnPartsInput,
) -> None:
    """Add by how much each gap that an agent used is below the true one."""
    for l, claim in result.gaps.items():
        claims.append(gap(members[i].x, members[l].x, motion, motion, RADIUS) - claim)


if __name__ == "__main__":
    main()
