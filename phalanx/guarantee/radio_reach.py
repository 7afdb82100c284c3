"""Radio before a run: at what distances it can decide anything, and how old knowledge will be.

Numbers are for two peers that meet head-on, each at the largest speed that starts, goals and laws
show; of kinds of pairs the largest count.
"""

from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.motion import Motion, stacked
from phalanx.knowledge.sets import HeardState, enclosures
from phalanx.network.link import Link
from phalanx.swarm.points import agent_point
from phalanx.swarm.radio import gain
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.exact import length
from phalanx.theory.safety.function import Distance, Separation

_TIMES = 200
"""Times at which goals and ages are taken."""


class RadioReach(NamedTuple):
    """Distances and ages of two peers that meet."""

    speed: float
    """Sum of both [m/s]."""
    radius: float
    """r*: beyond it no own part binds, so that radio changes nothing [m]."""
    age: float
    """Half of the time the newest broadcast is older, without relays [s]."""
    slack: float
    """What rows add for the time between samples and for the tubes, on both sides [m]."""
    sensor: float
    """Own sensors of peers to this distance make every lie harmless [m]."""
    rest: float
    """Two that want to pass one another stand at most so far apart, with what is `age` old [m]."""
    rest_by_age: float
    """The part of it that is for the age [m]."""

    @property
    def ratio(self) -> float:
        """Λ: the way that peers close in meanwhile, in slacks."""
        return self.speed * self.age / self.slack

    def __str__(self) -> str:
        return (
            f"Radio: peers that meet close in by {self.speed * self.age:.3g} m while half of what "
            f"they know grows older than {self.age:.3g} s, for which their rows have "
            f"{self.slack:.3g} m: Λ = {self.ratio:.3g}. In trials an agent that takes the newest "
            "state for the present one was never violated below 2, and nearly always above 4. "
            f"Beyond r* = {self.radius:.3g} m radio changes nothing. Own sensors of peers up to "
            f"{self.sensor:.3g} m would make every lie about states harmless. Two that want to "
            f"pass one another stop at most {self.rest:.3g} m apart, {self.rest_by_age:.2g} m of "
            "it for the age of what they know."
        )


def radio_reach(swarm: Swarm) -> RadioReach | None:
    """Return the numbers of a swarm by radio; None of others, and where no speed is known."""
    groups = [pair for pair in swarm.ends if swarm.peers(pair[0])]
    speeds = dict.fromkeys(swarm.group_numbers, 0.0)
    for i in swarm.normal if groups else ():
        number = swarm.group_numbers[i]
        speeds[number] = max(speeds[number], _speed(swarm, i))
    pairs = [(a, b) for (a, _), (_, b) in combinations_with_replacement(groups, 2) if a != b]
    reaches = [_reach(swarm, a, b, speeds) for a, b in pairs]
    reaches = [reach for reach in reaches if reach.speed > 0.0]
    return max(reaches, key=lambda reach: reach.ratio, default=None)


def _reach(swarm: Swarm, i: int, l: int, speeds: dict[int, float]) -> RadioReach:
    function = swarm.safety.safe_set_function
    assert isinstance(function, Distance | Separation)  # the filter has refused others
    both = [(agent_point(swarm, j).motion, speeds[swarm.group_numbers[j]]) for j in (i, l)]
    age, (own, other) = _median_age(swarm, l, i), (motion for motion, _ in both)
    rest_by_age = _growth(other, age)
    closing, stopping = sum(v for _, v in both), sum(m.tube + m.stopping(v) for m, v in both)
    return RadioReach(
        closing,
        function.radius + stopping + closing / gain(swarm, (i, *swarm.peers(i))),
        age,
        sum(motion.longest * v + motion.tube for motion, v in both),
        function.radius + stopping + closing * max(motion.longest for motion, _ in both),
        function.radius + own.tube + other.tube + rest_by_age,
        rest_by_age,
    )


def _growth(motion: Motion, age: float) -> float:
    """Return how far a peer that was at rest reaches an age later, and stops from there [m]."""
    still = np.zeros(2 * motion.axes)
    state = HeardState(0.0, still, still, 0.0, still[: motion.axes])
    boxes = enclosures([state], np.array([age]), stacked([motion]))
    return float(boxes.high[0, 0]) + motion.stopping(float(boxes.speed()[0]))


def _speed(swarm: Swarm, i: int) -> float:
    """Return the largest speed of agent i that its start, goal or law shows [m/s]."""
    x, parts = swarm.start(), swarm.safe_set.parts
    states = {l: x[part] for l, part in enumerate(parts)}
    goal, times = swarm.goal(i), np.linspace(0.0, swarm.scenario.duration, _TIMES)
    law = getattr(swarm.groups[i].law_object(), "speed", 0.0)
    speed = float(length(agent_point(swarm, i).of(states[i])[swarm.groups[i].axes :]))
    moving = max(float(length(goal(t, states).velocity)) for t in times.tolist())
    return max(speed, moving, law if isinstance(law, float | int) else 0.0)


def _median_age(swarm: Swarm, sender: int, receiver: int) -> float:
    """Return the median age of a link's newest broadcast over the run [s]."""
    broadcaster, names = swarm.broadcasters[swarm.names[sender]], swarm.names
    period = broadcaster.every * swarm.groups[sender].clock.period
    model = swarm.links.model(names[sender], names[receiver])
    link = Link(swarm.seeds, names[sender], names[receiver], model)
    arrived = [(0.0, 0.0)]
    for k in range(1, int(swarm.scenario.duration / period) + 1):
        delay = link.fate(k, k * period, 0.0, k * period).delay
        if delay is not None:
            arrived.append((k * period + delay, k * period))
    at, sent = np.array(sorted(arrived)).T
    times = np.linspace(0.0, swarm.scenario.duration, _TIMES)
    newest = np.maximum.accumulate(sent)[np.searchsorted(at, times, "right") - 1]
    return float(np.median(times - newest))
