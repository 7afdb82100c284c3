"""A swarm in plain Python that knows itself by radio: motions, radio, and a law to cross."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from phalanx.knowledge.held import moved
from phalanx.knowledge.motion import Motion
from phalanx.knowledge.own_parts import OwnParts
from phalanx.knowledge.sets import HeardState

RADIUS = 1.0
STEP = 0.005
"""Longest time between two looks at the distances [s]."""


@dataclass
class Radio:
    """Broadcasts of each n-th sample, lost or delayed by a draw; some times they all are lost."""

    loss: float = 0.0
    delay: float = 0.05
    every: int = 1
    relays: bool = False
    partition: tuple[float, float] = (-1.0, -1.0)


@dataclass
class Member:
    """One agent: its true state, what it holds, and what it has heard."""

    x: np.ndarray
    goal: np.ndarray
    parts: OwnParts
    motion: Motion
    u: np.ndarray
    next_sample: float
    samples: int = 0
    heard: dict[int, HeardState] = field(default_factory=dict)


@dataclass
class Crossing:
    """Distances and times of a crossing."""

    least: float
    """Least distance of two agents, less R [m]."""
    arrived: int
    ended: float
    """Time of the end: all have arrived, or it is over [s]."""
    braked: float
    """Share of samples."""


def keep_right(speed: float) -> Callable:
    """A law that goes to a goal, keeps right of the peers that it believes ahead, and backs off."""

    def law(x, goal, centres):
        p, v = x[:2], x[2:]
        way = goal - p
        far = max(np.hypot(*way), 1e-9)
        wished = way / far * min(speed, 0.8 * far)
        for centre in centres:
            apart = p - centre[:2]
            distance = max(np.hypot(*apart), 1e-9)
            near = max(0.0, 1.0 - (distance - RADIUS) / 4.0)
            n = apart / distance
            ahead = max(0.0, -(n @ way) / far)
            wished = wished + speed * near * ahead * np.array([n[1], -n[0]]) * -1.0
            wished = wished + 0.6 * speed * max(0.0, 1.0 - (distance - RADIUS) / 1.5) * n
        size = np.hypot(*wished)
        return 2.5 * (wished * min(1.0, speed / max(size, 1e-9)) - v)

    return law


def rush(x, goal, centres):
    """A law that goes for the nearest peer, at full acceleration."""
    axes = len(goal)
    ways = [centre[:axes] - x[:axes] for centre in centres]
    return 4.0 * np.sign(min(ways, key=np.linalg.norm))


def cross(
    count: int,
    radio: Radio,
    seed: int,
    *,
    motion: Motion,
    law: Callable | None = None,
    circle: float = 6.0,
    kappa: float = 3.5,
    duration: float = 40.0,
    push: Callable | None = None,
    measure: Callable | None = None,
    observe: Callable | None = None,
    **options,
) -> Crossing:
    """Let agents on a circle swap places with those across; in space not all at one height.

    Args:
        push: (member's state, number, time) -> φ of the rates, shape (2 axes,), for one step.
        measure: what an agent takes its true state for.
        observe: called at each sample with (time, number, members, input).
    """
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    places = circle * np.column_stack([np.cos(angles), np.sin(angles), np.sin(2.0 * angles)])
    axes, law, members = motion.axes, law or keep_right(3.0), []
    for i, place in enumerate(places[:, :axes]):
        others = {l: motion for l in range(count) if l != i}
        x = np.concatenate([place, np.zeros(axes)])
        parts = OwnParts(motion, others, RADIUS, kappa, start=x, **options)
        first = float(rng.uniform(0.0, motion.longest))
        members.append(Member(x, -place, parts, motion, np.zeros(axes), first))
    starts = [HeardState(0.0, m.x, m.x, 0.0, np.zeros(axes)) for m in members]
    for i, member in enumerate(members):
        member.heard = {l: start for l, start in enumerate(starts) if l != i}
    messages: list[tuple[float, int, dict[int, HeardState]]] = []
    least, t, brakes, samples = np.inf, 0.0, 0, 0
    while t < duration:
        due = min(range(count), key=lambda i: members[i].next_sample)
        until = members[due].next_sample
        while t < until:
            step = min(STEP, until - t)
            for i, member in enumerate(members):
                phi = np.zeros(2 * axes) if push is None else push(member, i, t)
                factors = motion.held(np.array([step]))
                member.x = moved(member.x, member.u + phi[axes:], factors)
                member.x[:axes] += step * phi[:axes]
            t = until if step < STEP else t + step
            p = np.array([member.x[:axes] for member in members])
            apart = np.linalg.norm(p[:, None] - p[None], axis=2)
            least = min(least, (apart + 1e9 * np.eye(count)).min() - RADIUS)
        member = members[due]
        for arrival in [m for m in messages if m[0] <= t]:
            messages.remove(arrival)
            for l, state in arrival[2].items():
                for_all = members[arrival[1]].heard
                if l != arrival[1] and state.t > for_all[l].t:
                    for_all[l] = state
        centres = []
        for state in member.heard.values():
            factors = motion.held(np.array([t - state.t]))
            centres.append(moved(state.x, np.zeros(axes), factors))
        x = member.x if measure is None else measure(member.x)
        wish = law(x, member.goal, centres)
        result = member.parts(t, x, member.heard, wish)
        member.u = result.u
        if observe is not None:
            observe(t, due, members, result)
        brakes, samples = brakes + result.braked, samples + 1
        own = HeardState(t, x.copy(), member.parts.reference, t, result.u)
        if member.samples % radio.every == 0:
            said = {**member.heard, due: own} if radio.relays else {due: own}
            cut = radio.partition[0] <= t < radio.partition[1]
            for i in range(count):
                if i != due and not cut and rng.random() >= radio.loss:
                    messages.append((t + float(rng.uniform(0.5, 1.0)) * radio.delay, i, said))
        member.samples += 1
        member.next_sample = t + float(rng.uniform(motion.shortest, motion.longest))
        arrived = sum(np.linalg.norm(m.x[:axes] - m.goal) < 0.3 for m in members)
        if arrived == count:
            break
    return Crossing(least, arrived, t, brakes / max(samples, 1))
