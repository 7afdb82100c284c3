"""The check of a scenario before any run: q, S_I, constants, margins, Theorem 3, certificates."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from phalanx.guarantee.check_report import (
    BoundaryCondition,
    CheckReport,
    advice,
    longest_delay,
    proof_gaps,
    rounded,
)
from phalanx.guarantee.formula import (
    Region,
    boundary,
    drawn_states,
    formula,
    states_inside,
    workspace,
    worst_pair,
)
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
from phalanx.scenario.load import ScenarioError, load
from phalanx.scenario.model import Scenario
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

_MOST_NAMES = 8
"""Most names of agents in one sentence."""


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
    rows, x, box = require_runnable(swarm), swarm.start(), workspace(swarm)
    unknown: list[str] = []
    of_all = of_pair = boundary_condition = None
    proven: dict[int, ProvenRows] = {}
    if len(swarm.safe_set.pairs) > _MOST_PAIRS:
        unknown.append(
            "The constants of the paper's formula and Theorem 3 are not computed for more than "
            f"{_MOST_PAIRS} pairs, since they take minutes; here are {len(swarm.safe_set.pairs)}. "
            "Check fewer agents at the same density."
        )
        box = []
    elif isinstance(box, tuple):
        boundary_condition = _boundary_condition(rows, x, *box)
    else:
        missing = ", ".join(box)
        example = f"for example {box[0]} = [-3.0, 3.0]"
        unknown.append(
            "The constants of the paper's formula and Theorem 3 are unknown: give bounds for "
            f"{missing} in [workspace], {example}."
        )
    try:
        if isinstance(box, tuple):
            progress("margins")
            drawn = drawn_states(scenario.seed, "inside", *box, _SAMPLES)
            region = Region(*box, states_inside(rows.invariants(), x, drawn))
            of_all, of_pair = formula(rows, rows.chain, region), worst_pair(rows, region)
        provable = rigorous(swarm)
        proven = {i: ProvenRows(provable, i, x) for i in swarm.normal}
    except ValueError as error:
        unknown.append(f"No margin can be computed: {error}.")
    progress("certificates")
    certified, promise = certified_start(swarm), promised(swarm)
    progress("inputs at the start")
    report = CheckReport(
        relative_degree=rows.relative_degree,
        psi_at_start=_psi(rows, x),
        eta_paper=_given(rows),
        formula=of_all,
        pair_formula=of_pair,
        eta_local={swarm.names[i]: proof.margin(swarm.horizon(i)) for i, proof in proven.items()},
        rows_at_start=rows_at_start(rows),
        boundary=boundary_condition,
        horizon=max(swarm.horizon(i) for i in swarm.normal),
        largest_gap=largest_gap(list(proven.values())) if proven else None,
        largest_delay=longest_delay(swarm),
        gaps=proof_gaps(swarm),
        certified=certified,
        promised=promise,
    )
    report.words.extend(
        [
            str(report.promised),
            *_world(scenario),
            *advice(swarm, report, unknown),
            *_resting(swarm),
            *_roles(rows),
        ]
    )
    return report


def _world(scenario: Scenario) -> list[str]:
    """Return a sentence on a world of one's own, which no check knows."""
    if scenario.world is None:
        return []
    return [
        f"The robots move by {scenario.world['type']}, not by their declared dynamics. All of this "
        "holds as far as a disturbance within the declared bounds explains their motion, which "
        "the run checks."
    ]


def _roles(rows: SafetyRows) -> list[str]:
    """Return a sentence on what is taken for granted of roles, or what it costs at x(0) not to."""
    if rows.swarm.safety.information_model.reads_roles:
        return [
            "Taken for granted: agents know who is an adversary, and no other becomes one. Where "
            "any may be taken over take safety.information = 'unknown'."
        ]
    shared = with_safety(rows.swarm, composition="pairs", information="split")
    try:
        own, split = (rounded(effort_at_start(each)) for each in (rows, shared))
    except NotANumberError as error:
        raise ScenarioError(f"{rows.swarm.scenario.name}: at the start {error}") from error
    able = list(rows_at_start(rows).values())
    return [
        "No agent reads a role: each counts everyone else at worst. At the start "
        f"{sum(able)} of {len(able)} agents have an input in K_i, and inputs are {own} from "
        f"nominal ones, on average; with halves of pairs, information = 'split', {split}."
    ]


def _resting(swarm: Swarm) -> list[str]:
    """Return a sentence on normal agents that have no goal."""
    names = [swarm.names[i] for i in swarm.normal if not swarm.has_goal(i)]
    if not names:
        return []
    shown = ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
    return [f"Without goal, slots or flows: {shown}. A law that tracks keeps them at their start."]


def _psi(rows: SafetyRows, x: Array) -> tuple[float, ...]:
    """Return the largest ψ_0, ..., ψ_{q-1} of all rows at a state, shape (n̄,)."""
    each = rows.invariants()(x).reshape(-1, rows.relative_degree)
    return tuple(each.max(axis=0).tolist())


def _boundary_condition(
    rows: SafetyRows, x: Array, low: Array, high: Array
) -> BoundaryCondition | None:
    """Evaluate Σ γ_min + Σ γ_max + α + η at states on the boundary of S_I."""
    inside = rows.invariants()
    if (inside(x) > 0).any():
        return None
    evaluate = rows.terms_of_all(_largest_margin(rows))
    worst, states = -math.inf, 0
    seed = rows.swarm.seed
    for y in drawn_states(seed, "boundary", low, high, 10 * _SAMPLES):
        if states == _BOUNDARY_STATES:
            break
        if (inside(y) <= 0).all():
            continue
        total = joint_sum(evaluate(boundary(inside, x, y)), rows.swarm.normal)
        worst, states = max(worst, total), states + 1
    return BoundaryCondition(states, worst) if states else None


def _largest_margin(rows: SafetyRows) -> float:
    """Return the largest margin of the normal agents' rows for h_tot; 0 if computed in the run."""
    return max(rows.margin(i).eta for i in rows.swarm.normal)


def _given(rows: SafetyRows) -> dict[str, float | None]:
    computed = rows.swarm.safety.computes_margin
    return {
        rows.swarm.names[i]: None if computed else rows.margin(i).eta for i in rows.swarm.normal
    }
