"""The robustness of a run: a signed number for each pair, below zero if the pair was unsafe.

A verdict tells a search nothing of how close a run came; h alone is far below zero while all agents
are far apart. So the number first counts what is left of a pair's certificate, then h:

- below 0: the pair was unsafe; minus its largest h;
- 0 to 1: safe, but for some time without a certificate; how far h stayed below 0;
- 1 to 9: under a certificate throughout; 1 + the least time that was left of it, in τ, + the same.

h is in multiples of the pair's scale, so that pairs of different kinds can be compared.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import msgspec
import numpy as np
from phalanx_studies.row import REFUSED, Identity, Row, digest_of_scenario, json_text, row_of
from phalanx_studies.work import Job

from phalanx.guarantee.certificate import MULTIPLES
from phalanx.guarantee.start import longest_certificate
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.native.loop.fastest import finish
from phalanx.recording.columns import Track
from phalanx.scenario.attack import Attack
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import shared_rows
from phalanx.swarm.swarm import Swarm

_LONGEST = MULTIPLES[0] - 1.0
"""Least time that remains of the certificate of a distant pair, in τ."""


@dataclass(frozen=True)
class Evaluation:
    """A run without files, and how close it came to a violation."""

    swarm: Swarm
    summary: Summary
    track: Track
    """Its states and inputs."""
    pairs: Mapping[str, float]
    """Robustness of each pair, by its label."""
    engine: str
    """The engine that made it."""

    @property
    def least(self) -> float:
        """The robustness of the run: that of its weakest pair."""
        return min(self.pairs.values(), default=np.inf)


def evaluate(scenario: Scenario, scales: Mapping[str, float] | None = None) -> Evaluation:
    """Run a resolved scenario to its verdict, and measure its robustness.

    scales: of h of each pair, by label, as scales_of returns them for the scenario that a search
    began with; by default those of this scenario.

    Raises:
        ScenarioError: the scenario cannot be run.
        MistakenMethodError: a user's class does not do what it must.
    """
    return evaluate_rows(shared_rows(scenario), scales)


def evaluate_rows(rows: SafetyRows, scales: Mapping[str, float] | None = None) -> Evaluation:
    """Do the same with rows that are built already."""
    swarm, scales = rows.swarm, scales or scales_of(rows.swarm)
    summary, track, least, engine = finish(rows)
    if summary.outcome is Outcome.STOPPED:
        raise KeyboardInterrupt  # the plant reacted to it
    # Between two states an unsafe h is in the summary's violations, to the integration step.
    highest = {label: float(h.max()) for label, h in swarm.h_of_pairs(track.states.x).items()}
    remaining = dict(zip(highest, least.tolist(), strict=True))
    for violation in summary.violations:
        highest[violation.pair] = max(highest[violation.pair], violation.worst)
    counted = {violation.pair for violation in summary.violations}
    for violation in summary.excluded:  # no normal agent is left in it
        if violation.pair not in counted:
            del highest[violation.pair]
    tau = swarm.longest_horizon
    pairs = {l: robustness(h / scales[l], remaining[l] / tau) for l, h in highest.items()}
    return Evaluation(swarm, summary, track, pairs, engine)


def robustness(h: float, remaining: float) -> float:
    """Return a pair's robustness.

    Args:
        h: its largest value, in multiples of its scale.
        remaining: the least time that was left of its certificate, in τ.
    """
    if not h <= 0.0:
        return -h
    below = -h / (1.0 - h)
    return below if remaining < 0.0 else 1.0 + min(remaining, _LONGEST) + below


def scales_of(swarm: Swarm) -> dict[str, float]:
    """Return the scale of each pair's h, by label: the least |h| at x(0) of pairs of its kind."""
    at_start = swarm.h_of_pairs(swarm.start()[None])
    size = np.array([abs(float(h[0])) for h in at_start.values()])
    kinds = swarm.pairs.kinds_of(swarm.pairs.every)
    least = {kind: float(size[kinds == kind].min()) for kind in set(kinds.tolist())}
    return {label: least[kind] or 1.0 for label, kind in zip(at_start, kinds.tolist(), strict=True)}


_INADMISSIBLE = 100.0
"""Cost of a start that is not admissible, to which its shortfall is added."""
START = "start"
"""Label, instead of a pair's, of a run that did not begin."""


def robustness_of(row: Row) -> dict[str, float]:
    """Return the robustness of each pair of a row, by label."""
    if not row.robustness:
        return {START: 2.0 * _INADMISSIBLE}
    return msgspec.json.decode(row.robustness, type=dict[str, float])


def measured(
    attack: Attack, scales: Mapping[str, float], job: Job, identity: Identity, rows: SafetyRows
) -> Row:
    """Return the row of a run, with its robustness; scales: of h of each pair, by label."""
    identity = identity._replace(scenario=digest_of_scenario(rows.swarm.scenario))
    short, reason = shortfall(rows.swarm, attack)
    if short > 0.0:
        return Row(
            identity=identity, overrides=job.overrides, outcome=REFUSED, reason=reason,
            robustness=json_text({START: _INADMISSIBLE + short}),
        )  # fmt: skip
    evaluation = evaluate_rows(rows, scales)
    row = row_of(
        identity, job.overrides, evaluation.summary, evaluation.track, rows.swarm, evaluation.engine
    )
    return msgspec.structs.replace(row, robustness=json_text(evaluation.pairs))


def shortfall(swarm: Swarm, attack: Attack) -> tuple[float, str]:
    """Return by how much the start of a run is not admissible, and the reason; 0 if it is.

    In τ for a certificate that is too short, in m for a distance.
    """
    x = swarm.start()
    distance, pair = nearest(swarm)
    if distance < attack.apart:
        reason = f"{pair} start {distance:.3g} m apart, expected {attack.apart:g} m"
        return attack.apart - distance, reason
    for i in swarm.normal:
        for_tau = longest_certificate(swarm, i, x) / swarm.horizon(i)
        if for_tau < attack.certified:
            reason = (
                f"agent {swarm.names[i]} starts with a certificate of {for_tau:.3g} τ, "
                f"expected {attack.certified:g} τ"
            )
            return attack.certified - for_tau, reason
    return 0.0, ""


def nearest(swarm: Swarm) -> tuple[float, str]:
    """Return the least distance of a normal agent from an adversary at x(0) [m], and their names.

    Infinite without adversaries.
    """
    x = swarm.start()
    adversaries = [j for j, member in enumerate(swarm.members) if member.adversary]
    distances = (
        (swarm.distance(x, i, j), f"{swarm.names[i]} and {swarm.names[j]}")
        for i in swarm.normal
        for j in adversaries
    )
    return min(distances, default=(np.inf, ""))
