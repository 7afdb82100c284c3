"""The check of a scenario before any run: q, S_I, constants, margins, Theorem 3, certificates."""

import math
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np

from phalanx.guarantee.check_report import BoundaryCondition, CheckReport
from phalanx.guarantee.findings import Unknown, findings
from phalanx.guarantee.formula import (
    Region,
    boundary,
    formula,
    random_states,
    states_inside,
    workspace,
    worst_pair,
)
from phalanx.guarantee.impossible import impossible
from phalanx.guarantee.kept_distance import kept_distances
from phalanx.guarantee.promise import grades
from phalanx.guarantee.proof_gaps import proof_gaps
from phalanx.guarantee.radio_reach import radio_reach
from phalanx.guarantee.start import (
    ProvenRows,
    certified_start,
    effort_at_start,
    largest_gap,
    promised,
    rigorous,
    rows_at_start,
    with_safety,
)
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario, ScenarioError
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.rows.decision import NotANumberError
from phalanx.theory.rows.row import joint_sum

_SAMPLES = 2000
_BOUNDARY_STATES = 200
_MOST_PAIRS = 500
"""With more, h_tot as one expression and the states of Theorem 3 take minutes."""


@np.errstate(all="ignore")  # what is not finite is said in words
def check(
    scenario: Scenario | str | Path,
    *,
    trust: bool = True,
    progress: Callable[[str], None] = lambda part: None,
) -> CheckReport:
    """Check a scenario, as run takes it, without running it.

    trust: as load takes it; progress is called with the name of each part.

    Raises ScenarioError if the safe set cannot be built, as when relative degrees are mixed.
    """
    if not isinstance(scenario, Scenario):
        scenario = load(scenario, trust=trust)
    swarm = build_swarm(scenario)
    progress("rows")
    rows, x, box = require_runnable(swarm), swarm.start(), _workspace(swarm)
    unknown = [box] if isinstance(box, Unknown) else []
    of_all = of_pair = condition = None
    proven: dict[int, ProvenRows] = {}
    try:
        if not isinstance(box, Unknown):
            condition = _boundary_condition(rows, x, *box)
            progress("margins")
            states = random_states(scenario.seed, "inside", *box, _SAMPLES)
            region = Region(*box, states_inside(rows.invariants(), x, states))
            of_all, of_pair = formula(rows, rows.chain, region), worst_pair(rows, region)
        provable = rigorous(swarm)
        proven = {i: ProvenRows(provable, i, x) for i in swarm.normal}
    except ValueError as error:
        unknown.append(Unknown("finite constants", f"No margin can be computed: {error}."))
    progress("certificates")
    certified, promise = certified_start(swarm), promised(swarm)
    progress("inputs at the start")
    model, computed = swarm.safety.information_model, swarm.safety.computes_margin
    normal = {i: swarm.names[i] for i in swarm.normal}
    psi = rows.invariants()(x).reshape(-1, rows.relative_degree)
    report = CheckReport(
        relative_degree=rows.relative_degree,
        psi_at_start=tuple(psi.max(axis=0).tolist()),
        eta_paper={name: None if computed else rows.margin(i).eta for i, name in normal.items()},
        formula=of_all,
        pair_formula=of_pair,
        eta_local={normal[i]: proof.margin(swarm.horizon(i)) for i, proof in proven.items()},
        rows_at_start=rows_at_start(rows),
        boundary=condition,
        horizon=swarm.longest_horizon,
        largest_gap=largest_gap(list(proven.values())) if proven else None,
        largest_delay=model.longest_delay if len(normal) > 1 else math.inf,
        gaps=proof_gaps(swarm),
        certified=certified,
        promised=promise,
        grades=grades(swarm),
        impossible=impossible(swarm),
        kept_distance=kept_distances(rows),
        radio=radio_reach(swarm),
    )
    efforts = None if model.reads_roles else _efforts(rows)
    report.findings.extend(findings(swarm, report, unknown, efforts))
    return report


def _workspace(swarm: Swarm) -> tuple[Array, Array] | Unknown:
    """Return the box of states over which constants are computed, or why they are not."""
    if len(swarm.safe_set.pairs) > _MOST_PAIRS:
        return Unknown(
            "fewer agents",
            "The constants of the paper's formula and Theorem 3 are not computed for more than "
            f"{_MOST_PAIRS} pairs, since they take minutes; here are {len(swarm.safe_set.pairs)}. "
            "Check fewer agents at the same density.",
        )
    box = workspace(swarm)
    if isinstance(box, tuple):
        return box
    return Unknown(
        "set [workspace]",
        "The constants of the paper's formula and Theorem 3 are unknown: give bounds for "
        f"{', '.join(box)} in [workspace], for example {box[0]} = [-3.0, 3.0].",
    )


def _efforts(rows: SafetyRows) -> tuple[float, float]:
    """Return the mean ‖u - u_nom‖ at x(0), and that with halves of pairs and declared roles."""
    shared = with_safety(rows.swarm, composition="pairs", information="split")
    try:
        return effort_at_start(rows), effort_at_start(shared)
    except NotANumberError as error:
        raise ScenarioError(f"{rows.swarm.scenario.name}: at the start {error}") from error


def _boundary_condition(
    rows: SafetyRows, x: Array, low: Array, high: Array
) -> BoundaryCondition | None:
    """Evaluate Σ γ_min + Σ γ_max + α + η at states on the boundary of S_I."""
    inside = rows.invariants()
    if (inside(x) > 0).any():
        return None
    # Margins that are computed in the run count as 0.
    evaluate = rows.terms_of_all(max(rows.margin(i).eta for i in rows.swarm.normal))
    states = random_states(rows.swarm.seed, "boundary", low, high, 10 * _SAMPLES)
    outside = islice((y for y in states if not (inside(y) <= 0).all()), _BOUNDARY_STATES)
    totals = [joint_sum(evaluate(boundary(inside, x, y)), rows.swarm.normal) for y in outside]
    return BoundaryCondition(len(totals), max(totals)) if totals else None
