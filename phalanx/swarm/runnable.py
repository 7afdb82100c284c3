"""Evaluation of dynamics, rows, laws and rules at x(0), so that mistakes end a run at once.

Also compilation of the functions that agents share, before the first sample.
"""

import math
import shutil
from collections.abc import Sequence

from phalanx.network.link import RuleError
from phalanx.scenario.model import Scenario, ScenarioError
from phalanx.schema.registry import part_of_agent
from phalanx.schema.user_code import names_user_code
from phalanx.swarm.mistakes import require_dynamics, require_h, require_margin
from phalanx.swarm.own_controller import own_controller
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm, build_swarm, compiled_fields
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.cache import scenario_functions
from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx.theory.laws.law import CheckedInput, View
from phalanx.theory.margins.margin import RowPart
from phalanx.theory.models.dynamics import Bounded

_AHEAD = 0.1
"""Time for which `travel` is evaluated [s]."""


def require_runnable(swarm: Swarm) -> SafetyRows:
    """Build the rows of a run and evaluate dynamics, h, rows and laws at x(0).

    Raises:
        ScenarioError: margin or composition do not fit the expressions; or a user's class returned
            values that are not finite or of the wrong shape, raised, or does not return.
    """
    with endless_loops(swarm.time.timeout):
        rows = build_rows(swarm)
        _evaluate_start(rows)
        return rows


def shared_rows(scenario: Scenario) -> SafetyRows:
    """Return the rows of a run, with functions compiled for an earlier one if they are the same.

    Raises as require_runnable does.
    """
    if names_user_code(scenario.model_dump(mode="json")):  # its objects may keep a state
        return require_runnable(build_swarm(scenario))
    functions = scenario_functions(compiled_fields(scenario))
    return require_runnable(build_swarm(scenario, functions))


def _evaluate_start(rows: SafetyRows) -> None:
    swarm = rows.swarm
    i, x, name = swarm.normal[0], swarm.start(), swarm.scenario.name
    first = sorted(l for l, _ in swarm.ends)
    try:
        for l in first:
            dynamics, starts = swarm.members[l].dynamics, _starts(swarm, l, x)
            require_dynamics(dynamics, starts, "the start ")
            if isinstance(dynamics, Bounded):
                for start in starts:
                    dynamics.travel(start, _AHEAD, 0.0)
        require_h(swarm, x, "at the start")
        # Not all agents: in a large swarm no agent evaluates so many at once.
        in_sight = sorted({*swarm.seen(i, x), *[l for ends in swarm.ends for l in ends]})
        if swarm.safety.pairwise:
            rows.seen_by(i).pair_terms(i)(x, in_sight)
            for l in set(first) & set(swarm.normal):
                require_margin(rows, l, x, swarm.seen(l, x), " at the start")
        else:
            terms = rows.seen_by(i).terms(i)(x, in_sight)
            terms.psi, terms.margin  # noqa: B018
        states = dict(enumerate(x[part] for part in swarm.safe_set.parts))
        for l in range(len(swarm.members)):
            goal = swarm.goal(l)
            goal(0.0, states), goal.end()
        for l in first:
            _require_law(rows, l, x)
        _require_rules(swarm, x)
    except (MistakenMethodError, RuleError) as error:
        raise ScenarioError(f"{name}: {error}") from error
    except ScenarioError:
        raise  # a ValueError too
    except ValueError as error:
        raise ScenarioError(f"{name}: safety: {error}") from error


def _starts(swarm: Swarm, l: int, x: Array) -> list[Array]:
    """Return the states of the agents in agent l's group, from the stacked state x."""
    parts = zip(swarm.groups, swarm.safe_set.parts, strict=True)
    return [x[part] for group, part in parts if group is swarm.groups[l]]


def _require_rules(swarm: Swarm, x: Array) -> None:
    """Treat a first message by each user's rule. Raises RuleError."""
    points = swarm.positions(x)
    for sender, receiver, link in swarm.links.users_rules():
        ends = [points[swarm.names.index(name)] for name in (sender, receiver)]
        link.fate(0, 0.0, math.dist(*ends))


def _require_law(rows: SafetyRows, i: int, x: Array) -> None:
    """Compute agent i's first input by a new law and controller, since they may have a state.

    Of one with a radio its filter is built.
    """
    rows = rows.seen_by(i)
    view, u_nom = first_nominal(rows, i, x)
    group = rows.swarm.groups[i]
    if group.program and shutil.which(group.program[0]) is None:
        raise ScenarioError(f"no program to run: {group.program[0]} for {rows.swarm.names[i]}")
    # A program is not asked before the run: it may move a robot.
    controller = None if group.program else own_controller(rows, i, lambda *_: 0.0)
    if controller is not None:
        controller(view, u_nom, x, tuple(view.x), 0.0, {})
    if rows.swarm.peers(i):
        part_of_agent("agents.radio")(rows, i)
    if rows.swarm.safety.committed and not rows.swarm.members[i].adversary:
        part_of_agent("safety.keep")(rows.swarm, i)


def first_nominal(rows: SafetyRows, i: int, x: Array) -> tuple[View, Array]:
    """Return what agent i's law sees at x(0), and the input that a new law makes of it."""
    swarm, in_sight = rows.swarm, rows.swarm.seen(i, x)
    states = {l: x[swarm.safe_set.parts[l]] for l in in_sight}
    normal = [l for l in swarm.normal if l in states]
    terms, goal = rows.terms(i)(x, in_sight), swarm.goal(i)(0.0, states)
    view = View(i, states, normal, goal, terms, 0.0)
    return view, CheckedInput(swarm.law(i), swarm.members[i])(view)


_MOST_IN_SIGHT = 40
"""Largest number of others in sight for which an agent's rows are evaluated beforehand."""


def compile_rows(rows: SafetyRows) -> None:
    """Compile the rows of all agents, which forked processes inherit."""
    swarm = rows.swarm
    swarm.broadcasters  # noqa: B018
    ends = sorted({l for both in swarm.ends for l in both})
    for i in ends:
        rows.seen_by(i).terms(i)
        if swarm.safety.pairwise and i in swarm.normal:
            _compile_pairs(rows.seen_by(i), i, ends)
    for first, _ in swarm.ends:
        _evaluate_rows(rows.seen_by(first), first)
    swarm.links, swarm.programs, swarm.digest  # noqa: B018


def _compile_pairs(rows: SafetyRows, i: int, ends: Sequence[int]) -> None:
    swarm = rows.swarm
    obstacles = range(len(swarm.members), len(swarm.members) + len(swarm.pairs.obstacles))
    for other in (*ends, *obstacles):
        for part in RowPart if other in swarm.normal else (RowPart.WHOLE,):
            if other != i:
                rows.row_function(i, rows.margin(i), other, part)


def _evaluate_rows(rows: SafetyRows, i: int) -> None:
    """Evaluate agent i's rows with 0, 1, 2, ... others in sight: each number allocates memory."""
    swarm, x = rows.swarm, rows.swarm.start()
    terms = rows.terms(i)
    pair_terms = rows.pair_terms(i) if swarm.safety.pairwise and i in swarm.normal else None
    others = [l for l in range(len(swarm.members)) if l != i]
    limited, most = swarm.sensing(i) is not None, min(len(others), _MOST_IN_SIGHT)
    for count in range(most + 1) if limited else (len(others),):
        in_sight = sorted((i, *others[:count]))
        if pair_terms is not None:
            pair_terms(x, in_sight, swarm.sharing)
        elif not swarm.safety.pairwise:
            values = terms(x, in_sight)
            values.psi, values.margin  # noqa: B018
