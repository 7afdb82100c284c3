"""One evaluation of a search, in any process: an admissible start is run, and measured."""

from collections.abc import Mapping

import msgspec

from phalanx.attacks.admissible import shortfall
from phalanx.attacks.robustness import evaluate_rows
from phalanx.scenario.attack import Attack
from phalanx.studies.identity import Identity, digest_of_scenario
from phalanx.studies.row import REFUSED, Row, json_text, row_of
from phalanx.studies.work import Job
from phalanx.swarm.rows import SafetyRows

_INADMISSIBLE = 100.0
"""Cost of a start that is not admissible, to which its shortfall is added."""
START = "start"
"""In the place of a pair: a run that did not begin."""


def robustness_of(row: Row) -> dict[str, float]:
    """Return the robustness of each pair of a row, by label."""
    if not row.robustness:
        return {START: 2.0 * _INADMISSIBLE}
    found: dict[str, float] = msgspec.json.decode(row.robustness)
    return found


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
