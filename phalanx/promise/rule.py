"""The rule of commitments: apply an input only if the fallback after it is clear of all others.

*Theorem.* At t = 0 the tubes T of all normal agents, with zero input to their first samples, are R
apart, and clear of obstacles. Then, if all keep the rule, they stay so for ever, for all seeds,
laws, filters, losses, delays and orders of samples, and all disturbances within bounds.
*Proof.* Between samples a tube only shrinks. An agent i that applies an input has its new tube
clear of W_j(x_j) of each other j, which contains what j is committed to, whatever that is. An agent
that does not, keeps a part of the tube that it had. Of two that sample together, the W of each
contains all that the other may choose. No step needs the solution of a program. ∎

*Passively*: T is also R from A_o, of every other member o, until i's reference is at rest. So i
hits no other while it moves by itself, whatever attacks; once it stands another may come. Where
the fallback is to leave, with a velocity w that all share, W is what it is in the moving frame, and
T is R from what slower members can reach for ever: pairs with these are safe for ever.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.promise.capsules import Capsules, Statics
from phalanx.promise.exit import Chasers, swept
from phalanx.promise.hold import Fallback, Reference, continued, started, tracked
from phalanx.theory.arrays import Array
from phalanx.theory.safety.obstacles import Obstacle


class Room(NamedTuple):
    """The distance that a tube has to spare, below 0 where it is too near [m]."""

    peers: Array
    """From W of each other normal agent, for ever."""
    members: Array
    """From A of each other member, until the agent stands."""
    obstacles: Array

    @property
    def least(self) -> float:
        """The smallest [m]; infinite if there is no other."""
        return float(np.concatenate(self).min(initial=np.inf))


class Commitment:
    """One agent's rule: what it follows, and the fallback that it has in hand."""

    reference: Reference | None
    """The fallback that it follows; None after an input of its filter."""

    def __init__(
        self,
        fallback: Fallback,
        radius: float,
        obstacles: Sequence[Obstacle],
        velocity: Array | None = None,
    ) -> None:
        """Follow nothing yet.

        Args:
            fallback: in the frame that moves with the velocity.
            radius: R, the required distance of output points [m].
            obstacles: of the fallback *exit* spheres alone.
            velocity: w of *exit*, shape (axes,) [m/s]; None for *hold*.
        """
        self.fallback, self._radius, self.obstacles = fallback, radius, Statics(obstacles)
        self._velocity = velocity
        self.reference = None
        self._next: Reference | None = None
        """The fallback's at the last sample."""

    def fallback_input(self, t: float, x: Array) -> Array:
        """Return the fallback's input at a sample, of the point x = (p, v); shape (axes,).

        For *exit* v and input are those in its frame.
        """
        motion, reference = self.fallback.motion, self.reference
        if reference is None:
            self._next = started(motion, t, x)
            return self._next.u
        self._next = continued(motion, reference, t, self._velocity)
        return tracked(motion, self._next, x)

    @property
    def begins(self) -> bool:
        """True if a fallback would begin whose input is the same in its frame as at rest."""
        return self.reference is None and self._velocity is None

    def room(self, x: Array, u: Array, peers: Capsules, members: Capsules | Chasers) -> Room:
        """Return the room of the tube after the input u, shape (axes,).

        Args:
            x: the sampled point.
            u: the input to judge.
            peers: W of each other normal agent.
            members: A of each other member, within `rest_time(x, u)` of the fallback; for *exit*
                those that keep no rule, for ever.
        """
        tube, velocity = self.fallback.tube(x, u), self._velocity
        if isinstance(members, Chasers):
            assert velocity is not None
            gaps, way = members.gaps(tube, velocity), swept(tube, velocity)
        else:
            gaps, way = tube.gaps(members, self._radius), tube
        peers_gaps = tube.gaps(peers, self._radius)
        return Room(peers_gaps - self._radius, gaps - self._radius, self.obstacles.gaps(way))

    def follow(self, accepted: bool) -> None:
        """Go on with the input that was accepted, or with the fallback of the last sample."""
        self.reference = None if accepted else self._next
