"""Proofs that no agent gets away from an adversary that is faster than it, under any rule."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from phalanx.knowledge.motion import Motion
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.promise.capture import capture
from phalanx.promise.reach import Reach
from phalanx.swarm.committed import holds_place, largest, reach_of
from phalanx.swarm.points import MovedByVelocity, built_point
from phalanx.swarm.swarm import DEFECT, Swarm
from phalanx.theory.models.integrators import DoubleIntegrator
from phalanx.theory.safety.function import Distance, Separation


class Impossible(NamedTuple):
    """Impossibilities from x(0), with the numbers that show them."""

    exit: str = ""
    """A sentence; empty where agents can leave, or nothing is known of it."""
    times: Mapping[str, float] = {}
    """By pair the time by which it can be unsafe, whatever its normal agent does [s]."""
    because: str = ""
    """Why, for the first of them."""

    @property
    def sentences(self) -> list[str]:
        """All of it in words."""
        words = [self.exit] if self.exit else []
        if self.times:
            pair = min(self.times, key=lambda pair: self.times[pair])
            others = f", and {len(self.times) - 1} more later" if len(self.times) > 1 else ""
            latest = math.ceil(1e3 * self.times[pair]) / 1e3
            words.append(
                f"Impossible for ever, under any filter: {pair} can be unsafe by {latest:.3f} s"
                f"{others}: {self.because}."
            )
        return words


def impossible(swarm: Swarm) -> Impossible:
    """Return what no rule can promise; of the first normal agent, whether it can leave.

    Of pairs of whose dynamics nothing is known it says nothing.
    """
    function, x = swarm.safety.safe_set_function, swarm.start()
    members, parts, names = swarm.members, swarm.safe_set.parts, swarm.names
    times, reasons = dict[str, float](), dict[str, str]()
    for pair in swarm.safe_set.pairs:
        i, l = pair[:2] if pair[0] in swarm.normal else pair[1::-1]
        if max(i, l) >= len(members) or not members[l].adversary:
            continue
        if not isinstance(function, Distance | Separation):
            break
        phi = swarm.groups[i].disturbance.bound + swarm.groups[l].disturbance.bound
        able = capture(members[i].dynamics, members[l].dynamics, phi)
        if able is None or able.closing <= 0.0:
            continue
        label = swarm.safe_set.label(pair)
        times[label] = able.time(x[parts[i]], x[parts[l]], function.radius)
        enough = f", of more than {able.outrun:.3g} in sum" * (able.outrun > 0.0)
        reasons[label] = (
            f"whatever {names[i]} does, {names[l]} closes at {able.closing:.3g} m/s or more, with "
            f"the disturbances of both{enough}"
        )
    first = min(times, key=lambda pair: times[pair], default="")
    return Impossible(_no_exit(swarm, swarm.normal[0]), times, reasons.get(first, ""))


def _no_exit(swarm: Swarm, i: int) -> str:
    """Return that an adversary is faster than agent i can leave, each with its disturbance.

    It is empty where none is, and for dynamics whose speeds have no bound.
    """
    models = {l: m.dynamics for l, m in enumerate(swarm.members) if m.adversary or l == i}
    if len(models) == 1 or not all(
        isinstance(model, MovedByVelocity) or (isinstance(model, DoubleIntegrator) and model.drag)
        for model in models.values()
    ):
        return ""
    bound_of_i = swarm.groups[i].disturbance.bound
    speeds = {l: _chasing(swarm, l, swarm.groups[l].disturbance.bound) for l in models if l != i}
    l, motion = max(speeds, key=lambda l: speeds[l]), built_point(swarm, i, DEFECT).motion
    if _leaves(motion, speeds[l]):
        return ""

    def outruns(bound: float) -> bool:
        pushed = built_point(swarm, i, bound - bound_of_i + DEFECT).motion
        return _leaves(pushed, _chasing(swarm, l, bound))

    leaving, bound = largest(speeds[l], partial(_leaves, motion)), largest(bound_of_i, outruns)
    enough = f"at most {bound:.3g} for both would do" if bound > 0.0 else "no bound would do"
    return (
        f"Impossible by exit: {swarm.names[l]} makes {speeds[l]:.3g} m/s with its disturbance, "
        f"{swarm.names[i]} {leaving:.3g} m/s straight on against its own; {enough}."
    )


def _chasing(swarm: Swarm, l: int, bound: float) -> float:
    """The fastest that a member is for ever, with a bound on its disturbance [m/s]."""
    reach = Reach(reach_of(swarm, l).dynamics, bound + DEFECT)
    return reach.for_ever(0.0 * swarm.start()[swarm.safe_set.parts[l]])[1]


def _leaves(motion: Motion, speed: float) -> bool:
    """Return whether an agent can leave for ever at a speed, in the direction that suits it."""
    if isinstance(motion, VelocityMotion):
        # Straight on, one that turns does not drive sideways.
        turns = motion.turning > 0.0
        fastest = float(motion.velocities.corners[:, 0].max()) if turns else motion.fastest
        return fastest - motion.disturbance > speed
    # Drag takes the same of each component; what is left has to hold the motion against φ.
    acceleration = motion.acceleration - motion.drag * speed / math.sqrt(motion.axes)
    return holds_place(replace(motion, acceleration=acceleration))
