"""The fate of every broadcast: in time, late or lost."""

from bisect import bisect_right
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from phalanx.recording.read import Recording, steps_by_agent

IN_TIME, LATE, LOST = FATES = ("in time", "late", "lost")


class Broadcast(NamedTuple):
    """One broadcast on one link."""

    sender: int
    receiver: int
    sent: float
    """[s]"""
    arrival: float
    """[s]; equal to `sent` if it was lost."""
    fate: str
    """IN_TIME for the receiver's next step after it was sent, LATE or LOST."""
    false: bool = False
    """Whether its content was false."""


def broadcasts(recording: Recording) -> Iterator[Broadcast]:
    """Yield every broadcast whose fate a receiver decided, and whose sender's step is recorded."""
    names = [name for name, _, _ in recording.scenario.roster()]
    index = {name: i for i, name in enumerate(names)}
    # A broadcast is put when its input takes effect; delays count from there.
    latency = recording.scenario.time.latency
    sent = {(step.agent, step.k): step.t + latency for step in recording.steps}
    of_agents = steps_by_agent(recording).items()
    # In lists: for a single number bisect takes a fifth of NumPy's time.
    samples = {name: [*(s.t for s in steps), np.inf] for name, steps in of_agents}
    for step in recording.steps:
        false = {(sender, k) for sender, k, *_ in step.false}
        for sender, k, delay in step.fates:
            if (t := sent.get((sender, k))) is None:
                continue
            due = samples[step.agent]
            next_step = due[bisect_right(due, t)]
            fate = LOST if delay < 0.0 else LATE if t + delay > next_step else IN_TIME
            arrival = t + max(delay, 0.0)
            lied = (sender, k) in false
            yield Broadcast(index[sender], index[step.agent], t, arrival, fate, lied)
