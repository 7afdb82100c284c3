"""Contradictions: a stated state that its sender cannot have reached from an earlier one.

Per axis, under inputs |u| <= Û, the ends of p' = v, v' = u - βv after a time T are a convex set.
Its border are inputs that switch once, at some s, from Û to -Û or back. A push at s moves an end
along (k, d), k = (1 - e^{-β(T-s)}) / β, d = e^{-β(T-s)}, to which (d, -k) is normal. So, with p
and v the end less that without input, and r(t) the way after a time under an input of 1::

    |d p - k v| <= Û (d (r(s) - r(T - s)) + k²)

Each s gives a necessary condition, so that the honest are never convicted; all of them together are
sufficient. A disturbance φ adds to Û, and T ‖φ‖ to p. Where inputs are velocities, p has no other
bounds than T Û. Errors of both states, and of their times, are allowed for.
"""

import numpy as np

from phalanx.knowledge.held import Held, halves, moved
from phalanx.knowledge.motion import Motion
from phalanx.knowledge.sets import HeardState
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length

_SWITCHES = np.arange(9)[:, None] / 8.0
"""Times s, as shares of T."""
_CLOSE = 1e-6
"""Allowed for rounding and integration, relative to a state's size."""


def contradiction(
    motion: Motion, older: HeardState, newer: HeardState, stamp_error: float = 0.0
) -> float:
    """Return by how much a peer's newer state contradicts its older one [m]; at most 0: by nothing.

    motion: the peer's, with the errors of the states that it measures.
    """
    tracking, size = motion.tracking, 1.0 + float(length(newer.z))
    off_reference = tracking.size(newer.x - newer.z) - tracking.radius - _CLOSE * size
    states = older.x[None], newer.x[None], np.array([newer.t - older.t])
    return max(off_reference, float(unreached(motion, *states, 2.0 * stamp_error)[0]))


def unreached(motion: Motion, older: Array, newer: Array, time: Array, late: float = 0.0) -> Array:
    """Return how far newer states are from what older ones lead to [m], shape (n,); at most 0: not.

    Args:
        motion: of all, with the errors of their states.
        older: states (p, v), shape (n, 2 axes).
        newer: likewise, a time later.
        time: shape (n,) [s].
        late: bound on the error of a time [s].
    """
    axes, push, time = motion.axes, motion.push, np.maximum(0.0, time)[:, None, None]
    # Where inputs are velocities, none of them has to switch.
    first = motion.held(time * (_SWITCHES[::8] if motion.jumps else _SWITCHES))
    decay, speed, reach = (factor[:, ::-1] for factor in first)  # those of T - s
    whole = Held(*(factor[:, -1:] for factor in first))
    p, v = halves(newer[:, None] - moved(older[:, None], np.zeros(axes), whole))
    fastest = push if motion.jumps else np.abs(newer[:, axes:]).max(axis=1)[:, None, None]
    # Without an input it was faster before: drag slows it.
    fastest = (fastest + motion.speed_error + late * push) / motion.held(np.array(late)).decay
    p_error = 2.0 * motion.position_error + whole.speed * motion.speed_error + late * fastest
    p_error = p_error + (time + late) * motion.disturbance
    v_error = motion.speed_error + late * (push + motion.drag * fastest)
    pushed = push * np.abs(decay * (first.reach - reach) + speed * speed)
    outside = np.abs(decay * p - speed * v) - pushed - decay * p_error - speed * v_error
    most: Array = outside.max(axis=(1, 2)) - _CLOSE * (1.0 + length(newer))
    return most
