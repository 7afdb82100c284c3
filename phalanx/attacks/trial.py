"""One evaluation of a search, in any process: an admissible start is run, and measured.

A start next to another agent is no attack.
"""

from collections.abc import Mapping

import msgspec
import numpy as np

from phalanx.attacks.robustness import evaluate_rows
from phalanx.guarantee.start import longest_certificate
from phalanx.scenario.attack import Attack
from phalanx.studies.identity import Identity, digest_of_scenario
from phalanx.studies.row import REFUSED, Row, json_text, row_of
from phalanx.studies.work import Job
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm

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
    row = row_of(identity, job.overrides, evaluation.summary, evaluation.recording, rows.swarm)
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
