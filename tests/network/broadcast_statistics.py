"""Loss and delay of a recorded run's broadcasts, and the age of the inputs used."""

import itertools
from dataclasses import dataclass

import numpy as np

from phalanx.recording.read import Recording


@dataclass(frozen=True)
class Statistics:
    """Loss and delay of broadcasts, and the age of the inputs used."""

    sent: int
    loss: float
    delay: tuple[float, float]
    """Median and 99th percentile [s]."""
    age: tuple[float, float]
    """The same, of the received inputs that rows used [s]."""


def statistics(recording: Recording, begin: float = 0.0, end: float = np.inf) -> Statistics:
    """Evaluate the broadcasts from `begin` to `end` [s]."""
    broadcasts = {(s.agent, s.k) for s in recording.steps if begin <= s.t < end}
    came = {
        (sender, step.agent, k): delay
        for step in recording.steps
        for sender, k, delay in step.fates
        if (sender, k) in broadcasts and delay >= 0.0
    }
    links = {(sender, step.agent) for step in recording.steps for sender, *_ in step.fates}
    put = sum(name == sender for name, _ in broadcasts for sender, _ in links)
    ages = [age for s in recording.steps if begin <= s.t < end for _, age in s.ages]
    return Statistics(put, 1.0 - len(came) / put, _middle(list(came.values())), _middle(ages))


def _middle(values: list[float]) -> tuple[float, float]:
    return tuple(np.percentile(values, [50, 99]).tolist()) if values else (np.nan, np.nan)


def longest_silence(recording: Recording) -> tuple[float, float]:
    """The longest time for which no actuator got an input: from when to when [s]."""
    times = sorted(step.t_apply for step in recording.steps)
    return max(itertools.pairwise(times), key=lambda gap: gap[1] - gap[0])
