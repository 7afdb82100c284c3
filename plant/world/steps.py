"""How the way to an event is divided into integration steps, the same for whoever goes it."""

import math
from typing import NamedTuple

STEPS_AT_ONCE = 4


class Stretch(NamedTuple):
    """A few integration steps of one length, on one line of the disturbances."""

    steps: int
    dt: float
    """Of each step [s]."""
    end: float
    """[s]"""


def next_stretch(t: float, until: float, knot: float, longest: float) -> Stretch:
    """From t [s] towards `until`, to the next knot of a disturbance at most.

    No step is longer than `longest` [s].
    """
    stop = min(until, knot)
    count = min(math.ceil((stop - t) / longest), STEPS_AT_ONCE)
    stop = min(stop, t + count * longest)
    return Stretch(count, (stop - t) / count, stop)
