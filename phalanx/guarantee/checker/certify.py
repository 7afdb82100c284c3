"""Certify a recorded run: that no pair could leave its safe set, whatever happened in between.

An agent i applies an input u_i at t_k, in the true state x(t_k), and holds it. For one of its pairs
let R_w = L_f h + L_g h u_i + L_g h w be the rate of h while the other agent applies w, and B a box
that the pair does not leave for T: a Picard enclosure, u_i held, the other agent's input anywhere
in its U, every φ anywhere in its ball. Then for 0 <= t <= T

    h(t_k + t) <= h + t (max_w R_w + D) + ½ t² g,

h and R_w at x(t_k), with D = sup_B Σ_l ‖∂h/∂x_l‖ φ_l^max for what disturbances do to h, and g the
supremum over B, every w and every motion of dR_w/dt with w fixed, or 0 if that is more. Proof: h'
is at most R_w + D for the w of that instant, and no R_w grows faster than g. The bound is convex in
t: where it is not above 0 at both ends, it is not above 0 between. If no input appears in h'
(q > 1), L_g h = 0 and the same bound serves.

This certificate ends when agent i's next input takes effect, or where the bound reaches 0. A run is
certified if the certificates of the normal agents of every pair leave no instant uncovered. Assumed
are the dynamics and the disturbance bounds; a recording that is no motion of them is refused.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phalanx.guarantee.checker.bounds import AgentCertificates, PairBound, horizons_of
from phalanx.guarantee.checker.motions import (
    AgentMotion,
    StateRecord,
    StepRecord,
    inputs_of,
    track,
)
from phalanx.scenario.model import Scenario
from phalanx.theory.safety.composition import Member, compose

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gap:
    """From when on [s] a pair has no certificate."""

    t: float
    pair: str


@dataclass(frozen=True)
class Certification:
    """What the certificates of a run come to; true if they cover it."""

    samples: int
    """Inputs that normal agents applied."""
    certified: int
    """Those whose certificates, of all pairs, last until the next input."""
    horizon: float
    """The shortest time that any certificate lasts if nothing more is heard [s]; looked for up to
    four times the longest planned time between inputs. 0 where there is none."""
    gap: Gap | None
    """The first instant that is not covered."""

    def __bool__(self) -> bool:
        return self.gap is None


def certify(
    scenario: Scenario,
    states: Sequence[StateRecord],
    steps: Sequence[StepRecord],
    progress: Callable[[float], None] = lambda share: None,
) -> Certification:
    """Certify a run from its scenario and its records; progress is told the share that is done.

    Raises:
        UncertifiableError: an operation without an interval rule, a U that varies with the state,
            or records that contradict the scenario.
    """
    roster = list(scenario.roster())
    members = [Member(n, g.dynamics_object(), g.role == "adversary") for n, g, _ in roster]
    normal = [i for i, member in enumerate(members) if not member.adversary]
    safety, latency = scenario.safety, scenario.time.latency
    swarm = compose(members, scenario.static, safety.safe_set_function(), safety.rho)
    agents = [
        AgentMotion(member, part, group, latency)
        for member, part, (_, group, _) in zip(members, swarm.parts, roster, strict=True)
    ]
    pairs = [PairBound(swarm, p, agents) for p in range(len(swarm.pairs))]
    # Infinity and NaN are what bounds say that they do not know.
    with np.errstate(all="ignore"):
        times, x = track(states, swarm.x.numel())
        inputs = [inputs_of(member, times, steps) for member in members]
        for agent, held in zip(agents, inputs, strict=True):
            agent.require_motion(times, x[agent.part], held)
        certificates = []
        for done, i in enumerate(normal):
            sampled = x[:, np.searchsorted(times, inputs[i].t)]
            own = [pair for pair in pairs if i in pair.members]
            horizons = horizons_of(i, sampled, inputs[i].u, agents, own)
            certificates.append(AgentCertificates(own, inputs[i], horizons))
            progress((done + 1) / len(normal))
    return _conclude(certificates, pairs, scenario.duration)


def _conclude(
    found: Sequence[AgentCertificates], pairs: Sequence[PairBound], duration: float
) -> Certification:
    gaps = []
    for pair in pairs:
        spans = [each.spans(pair) for each in found if pair in each.pairs]
        begin, end = (np.concatenate(side) for side in zip(*spans, strict=True))
        gaps += [Gap(float(t), pair.label) for t in _uncovered(begin, end, duration)]
    lasting = [each.lasting for each in found]
    return Certification(
        samples=sum(each.size for each in lasting),
        certified=sum(int(each.sum()) for each in lasting),
        horizon=max(0.0, min(float(each.horizons.min(initial=np.inf)) for each in found)),
        gap=min(gaps, key=lambda gap: gap.t, default=None),
    )


def _uncovered(begin: Array, end: Array, until: float) -> Array:
    """The first instant of [0, until] in none of the intervals, shape (1,), or none, shape (0,)."""
    some = end >= begin
    order = np.argsort(begin[some], kind="stable")
    next_begin = np.append(begin[some][order], until)
    covered = np.maximum.accumulate(np.insert(end[some][order], 0, 0.0))
    return covered[next_begin > covered][:1]
