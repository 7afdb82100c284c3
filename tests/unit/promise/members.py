"""Agents in plain Python that keep the rule of commitments among disturbances and attackers."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from phalanx.knowledge.held import moved
from phalanx.knowledge.motion import Motion
from phalanx.promise.capsules import Capsules, balls, joined
from phalanx.promise.hold import hold
from phalanx.promise.rule import Commitment

RADIUS = 1.0
STEP = 0.004
"""Longest time between two looks at the distances [s]."""


@dataclass
class Member:
    """One agent: its true state (p, v), and what it holds."""

    x: np.ndarray
    motion: Motion
    commitment: Commitment
    u: np.ndarray = field(init=False)
    turned: float = 0.0
    """Angle by which a held velocity has turned [rad]."""
    next_sample: float = 0.0
    wishes: int = 0
    samples: int = 0

    def __post_init__(self):
        self.u = np.zeros(self.motion.axes)

    @property
    def p(self) -> np.ndarray:
        return self.x[: self.motion.axes]

    def move(self, time: float, phi: np.ndarray, turn: float) -> None:
        """Move on; phi: φ of the rates, (2 axes,); turn: share of the fastest turn."""
        motion, axes = self.motion, self.motion.axes
        u = self.u
        if motion.jumps and motion.turning > 0.0:
            rate = turn * motion.turning
            angle = self.turned + 0.5 * rate * time
            c, s = np.cos(angle), np.sin(angle)
            u = np.array([c * u[0] - s * u[1], s * u[0] + c * u[1]])
            self.turned += rate * time
        push = np.zeros(axes) if motion.jumps else phi[axes:]
        self.x = moved(self.x, u + push, motion.held(np.array([time])))
        self.x[:axes] += time * phi[:axes]


def member(motion: Motion, x, obstacles=()) -> Member:
    """An agent at rest, or at the state (p, v)."""
    state = np.zeros(2 * motion.axes)
    state[: len(x)] = x
    return Member(state, motion, Commitment(hold(motion), RADIUS, obstacles))


def none(axes: int) -> Capsules:
    return joined([], axes)


def towards(target: np.ndarray, of: Member) -> np.ndarray:
    """The largest input in a direction, of a box of inputs."""
    way = target - of.p
    bound = of.motion.inputs.b.min() if of.motion.jumps else of.motion.acceleration
    return bound * way / max(np.abs(way).max(), 1e-9)


def run(
    members: list[Member],
    duration: float,
    rng: np.random.Generator,
    wish: Callable,
    push: Callable,
    attackers: Callable | None = None,
    look: Callable | None = None,
) -> float:
    """Run a swarm; return the least distance of two members, less R [m].

    Args:
        wish: (member, members) -> the filter's input.
        push: (member, members, t) -> unit vectors of φ (2 axes,), and a share of the fastest turn.
        attackers: (member, time) -> A of those that keep no rule.
        look: called after each step with the time.
    """
    t, least = 0.0, np.inf
    for m in members:
        m.next_sample = float(rng.uniform(0.0, m.motion.longest))
    while t < duration:
        due = min(members, key=lambda m: m.next_sample)
        while t < due.next_sample:
            step = min(STEP, due.next_sample - t)
            for m in members:
                phi, turn = push(m, members, t)
                m.move(step, m.motion.disturbance * phi, turn)
            t = due.next_sample if step < STEP else t + step
            p = np.array([m.p for m in members])
            distances = np.linalg.norm(p[:, None] - p[None], axis=2) + 1e9 * np.eye(len(p))
            least = min(least, distances.min() - RADIUS)
            if look is not None:
                look(t)
        keep(due, members, t, wish(due, members), attackers)
        due.next_sample = t + float(rng.uniform(due.motion.shortest, due.motion.longest))
    return float(least)


def keep(due: Member, members: list[Member], t: float, u: np.ndarray, attackers=None) -> None:
    """Let a member apply u, or its fallback's input."""
    axes, commitment, x = due.motion.axes, due.commitment, due.x.copy()
    back = commitment.fallback_input(t, x)
    others = [m.commitment.fallback.expected(m.x[None]) for m in members if m is not due]
    reach = attackers(due, commitment.fallback.rest_time(x, u)) if attackers else none(axes)
    accepted = commitment.room(x, u, joined(others, axes), reach).least >= 0.0
    commitment.follow(accepted)
    due.u, due.turned = (u if accepted else back), 0.0
    due.wishes, due.samples = due.wishes + accepted, due.samples + 1


def disc(p, radius: float) -> Capsules:
    return balls(np.array([p], dtype=float), np.array([radius]))
