"""Certify a recorded run: no pair could leave its safe set between the recorded states either.

An agent i applies an input u_i at t_k, in the true state x(t_k), and holds it. For one of its pairs
let R_w = L_f h + L_g h u_i + L_g h w be the rate of h while the other agent applies w, and B a box
that the pair does not leave for T: a Picard enclosure, u_i held, the other agent's input anywhere
in its U, every φ anywhere in its ball. Then for 0 <= t <= T

    h(t_k + t) <= h + t (max_w R_w + D) + ½ t² g,

h and R_w at x(t_k), with D = sup_B Σ_l ‖∂h/∂x_l‖ φ_l^max for the disturbances, and g the
supremum over B, every w and every motion of dR_w/dt with w fixed, or 0 if that is larger. Proof: h'
is at most R_w + D for the w of that instant, and no R_w grows faster than g. The bound is convex in
t: where it is not above 0 at both ends, it is not above 0 between. If no input appears in h'
(q > 1), L_g h = 0 and the same bound serves.

This certificate ends when agent i's next input takes effect, or where the bound reaches 0. A run is
certified if the certificates of the normal agents of every pair leave no instant uncovered. Assumed
are the dynamics and the disturbance bounds; a recording that is no motion of them is refused.

Pairs of the same groups, or of a group with the same obstacle, have the same h and are bounded
together, a few thousand at a time.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from types import MappingProxyType

import numpy as np

from phalanx.scenario.model import Scenario
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.safety.composition import ComposedSet, Member, compose
from phalanx_certify.checker.bounds import PairBound
from phalanx_certify.checker.coverage import (
    Coverage,
    Inputs,
    StateRecord,
    StepRecord,
    inputs_of,
    track,
)
from phalanx_certify.checker.intervals import UncertifiableError
from phalanx_certify.checker.motions import GroupMotion, MotionCheck, require_digits

_AT_ONCE = 2048
"""Bounds evaluated in one call: few enough that their intervals stay in a CPU cache."""


@dataclass(frozen=True)
class Gap:
    """Time from which a pair has no certificate [s]."""

    t: float
    pair: str


@dataclass(frozen=True)
class Certification:
    """The certificates of a run; true if they cover all of it."""

    samples: int
    """Inputs that normal agents applied."""
    certified: int
    """Number of those whose certificates, of all pairs, last until the next input."""
    horizon: float
    """The shortest time that a certificate lasts without a further input [s]; searched up to eight
    times the longest planned time between inputs. 0 if there is none."""
    gap: Gap | None
    """The first uncovered instant."""

    def __bool__(self) -> bool:
        return self.gap is None


def certify(
    scenario: Scenario,
    states: Sequence[StateRecord],
    steps: Sequence[StepRecord],
    progress: Callable[[float], None] = lambda share: None,
    turned: Mapping[str, float] = MappingProxyType({}),
) -> Certification:
    """Certify a run from its scenario and its records.

    Args:
        scenario: of the run.
        states: one at every event.
        steps: inputs that took effect.
        progress: called with the share that is done, 0 to 1.
        turned: by normal agent that became an adversary, the time of that [s]. From then on its
            pairs without a normal agent need no certificate.

    Raises:
        UncertifiableError: records that contradict the scenario.
        UndecidedError: an operation without an interval rule, a U that varies with the state, a
            motion without bounds, or inputs applied in states that are not recorded.
    """
    run = _Run(scenario, states, steps, turned)
    # Unknown bounds are infinite or NaN.
    with np.errstate(all="ignore"):
        done = 0
        for size in chain(run.require_motions(), run.bound()):
            done += size
            progress(done / run.size)
    return run.certification()


_Kind = tuple[int, int | None, int | None]
"""Pairs with the same h: the group of the first, and that of the second, or the index of an
obstacle or a limit, as Pair has it."""


class _Run:
    """A scenario's agents, their recorded motions, and the certificates of these."""

    def __init__(
        self,
        scenario: Scenario,
        states: Sequence[StateRecord],
        steps: Sequence[StepRecord],
        turned: Mapping[str, float],
    ) -> None:
        self._duration, safety = scenario.duration, scenario.safety
        self._group = [g for g, group in enumerate(scenario.agents) for _ in group.names]
        self._motions = [GroupMotion(group, scenario.time.latency) for group in scenario.agents]
        members = [
            Member(name, group.dynamics_object(), group.role == "adversary")
            for name, group, _ in scenario.roster()
        ]
        swarm = compose(members, scenario.static, safety.safe_set_function, safety.rho)
        self._swarm, self._parts = swarm, swarm.parts
        self._times, self._x = track(states, swarm.x.numel())
        self._held = inputs_of(members, self._times, steps)
        self._inputs = Inputs(self._times, self._held)
        # Time until which each member is normal.
        normal = np.array([-np.inf if m.adversary else turned.get(m.name, np.inf) for m in members])
        self._counted = self._inputs.t < np.repeat(normal, self._inputs.count)
        self._coverage = Coverage(self._inputs, self._counted)
        pairs = swarm.pairs
        count = len(members)
        self._ends: Index = np.array([(a, b if b < count else a) for a, b in pairs])
        """Members of each pair, shape (p, 2); a pair with an obstacle has its agent twice."""
        self._shared: Mask = np.array([b < count and not members[b].adversary for _, b in pairs])
        """Pairs of two normal agents, shape (p,)."""
        self._until = normal[self._ends].max(axis=1)
        """Time until which each pair must be certified [s], shape (p,)."""
        bounds = self._inputs.count[self._ends]
        self.size = int(bounds[:, 0].sum() + bounds[self._shared, 1].sum())
        """Number of bounds and of state transitions to check."""
        self.size += len(members) * max(len(self._times) - 1, 0)

    def require_motions(self) -> Iterator[int]:
        """Check that states follow one another; yield the number checked.

        Raises UncertifiableError where they do not, and UndecidedError where that is not known.
        """
        require_digits(self._times, self._x)
        checks = [MotionCheck(motion) for motion in self._motions]
        for member, part, g, held in zip(
            self._swarm.members, self._parts, self._group, self._held, strict=True
        ):
            admitted = self._motions[g].admits(held.u)
            if not admitted.all():
                t = held.t[np.argmin(admitted)]
                raise UncertifiableError(
                    f"agent {member.name} applied an input that it does not have, at t = {t:.6f} s"
                )
            force = np.searchsorted(held.t, self._times[:-1], side="right") - 1
            for begin in range(0, len(force), _AT_ONCE):
                some = slice(begin, begin + _AT_ONCE)
                more = slice(begin, begin + _AT_ONCE + 1)
                t, u = self._times[more], held.u[:, force[some]]
                checks[g].require(member.name, t, self._x[part, more], u)
                yield u.shape[1]

    def bound(self) -> Iterator[int]:
        """Bound h of all pairs after every input; yield the number of bounds."""
        for kind, pairs in self._kinds().items():
            alone = self._swarm.alone(pairs[0])
            motions = [self._motions[g] for g in kind[:2] if g is not None]
            bound = PairBound(alone, motions)
            for side in range(2 if self._shared[pairs[0]] else 1):
                agents = self._ends[pairs, side]
                for which, k in self._inputs.of(agents, _AT_ONCE):
                    x, u = self._states(pairs[which], k, alone), self._inputs.u[:, k]
                    inputs = u[: len(alone.members[side].dynamics.inputs)]
                    horizons = bound.horizons(side, x, inputs)
                    self._coverage.add(side, pairs[which], k, horizons)
                    yield len(k)

    def certification(self) -> Certification:
        """Return the result of all bounds."""
        counted = self._counted
        first = self._coverage.first_uncovered(self._shared, self._until)
        begin, end = float(self._times[0]), float(self._times[-1])
        if begin > 0.0:
            first = (0.0, 0)
        elif first is None and end < self._duration:
            first = (end, 0)
        gap = None
        if first is not None:
            gap = Gap(first[0], self._swarm.label(self._swarm.pairs[first[1]]))
        return Certification(
            samples=int(counted.sum()),
            certified=int(self._coverage.lasting[counted].sum()),
            horizon=max(0.0, self._coverage.horizon),
            gap=gap,
        )

    def _kinds(self) -> dict[_Kind, Index]:
        """The pairs of each kind."""
        kinds: defaultdict[_Kind, list[int]] = defaultdict(list)
        for number, (a, b) in enumerate(self._swarm.pairs):
            static = b >= len(self._swarm.members)
            other = None if static else self._group[b]
            kinds[self._group[a], other, b if static else None].append(number)
        return {kind: np.array(pairs) for kind, pairs in kinds.items()}

    def _states(self, pairs: Index, k: Index, alone: ComposedSet) -> Array:
        """States of the members of pairs when inputs k took effect, shape (n, s)."""
        begins = np.array([part.start for part in self._parts])[self._ends[pairs]]
        rows = [
            begins[:, side] + np.arange(len(member.dynamics.states))[:, None]
            for side, member in enumerate(alone.members)
        ]
        states: Array = self._x[np.concatenate(rows), self._inputs.state[k]]
        return states
