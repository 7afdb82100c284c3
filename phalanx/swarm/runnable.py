"""Evaluation of dynamics, rows, laws and rules at x(0), so that mistakes end a run at once.

Dynamics, h and its derivatives must be finite there, and in a run wherever a step or the plant gets
no number. Also compilation of the functions that agents share, before the first sample.
"""

import math
from collections.abc import Sequence
from functools import partial

import casadi as ca
import numpy as np

from phalanx.network.link import RuleError
from phalanx.scenario.load import ScenarioError
from phalanx.scenario.model import Scenario
from phalanx.schema.user_code import names_user_code
from phalanx.swarm.own_controller import own_controller
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm, build_swarm, compiled_fields
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.cache import cached_for, scenario_functions
from phalanx.theory.expressions.user_methods import MistakenMethodError, first_numbers, is_built_in
from phalanx.theory.laws.law import CheckedInput, View
from phalanx.theory.margins.integrated import RowPart
from phalanx.theory.models.dynamics import Bounded, Dynamics
from phalanx.theory.models.polytope import EmptyPolytopeError, polytope
from phalanx.theory.safety.composition import Pair

_AHEAD = 0.1
"""Time for which `travel` is evaluated [s]."""
_TOGETHER = 1024
"""Pairs evaluated at once: CasADi keeps the memory, and every forked process inherits it."""


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
    """Compute agent i's first input by a new law and controller, since they may have a state."""
    rows = rows.seen_by(i)
    view, u_nom = first_nominal(rows, i, x)
    controller = own_controller(rows, i, lambda *_: 0.0)
    if controller is not None:
        controller(view, u_nom, x, tuple(view.x), 0.0, {})


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


def mistake_at(
    rows: SafetyRows, i: int, x: Array, in_sight: Sequence[int]
) -> MistakenMethodError | None:
    """Return the mistake in an expression that agent i needs at the stacked state x, shape (n̄,).

    None if there is no mistake. seen: agents whose states are known.
    """
    swarm = rows.swarm
    try:
        for l in in_sight:
            require_dynamics(swarm.members[l].dynamics, [x[swarm.safe_set.parts[l]]])
        for number, pair in enumerate(swarm.safe_set.pairs):
            if i in pair and {l for l in pair if l < len(swarm.members)} <= set(in_sight):
                _require_chain(rows, number, x)
        if i in swarm.normal:
            require_margin(rows, i, x, in_sight)
    except MistakenMethodError as mistake:
        return mistake
    return None


def require_dynamics(dynamics: Dynamics, states: Sequence[Array], where: str = "") -> None:
    """Raise MistakenMethodError unless finite at these states, shapes (n,).

    The input polytope is checked at the first. where: the states' name in the message, "the start".
    """
    evaluate, constant = cached_for([dynamics], "methods", partial(_methods, dynamics))
    for x in states:
        for method, value in zip(_METHODS, evaluate(x), strict=False):
            _require_finite(dynamics, method, x, np.array(value), where)
    A, b = map(np.array, evaluate(states[0])[-2:])
    for side in (A, b):
        _require_finite(dynamics, "input_polytope", states[0], side, where)
    if not constant:  # else it was checked when the scenario was read
        _require_polytope(dynamics, states[0], A, b, where)


_METHODS = ("drift", "actuation", "position")


def _methods(dynamics: Dynamics) -> tuple[ca.Function, bool]:
    """x -> the results of all methods, with A and b of U last; and whether U is constant."""
    x = ca.SX.sym("x", len(dynamics.states))
    values = [getattr(dynamics, method)(x) for method in _METHODS]
    sides = [ca.SX(side) for side in dynamics.input_polytope(x)]
    outputs = [ca.densify(ca.SX(value)) for value in (*values, *sides)]
    return ca.Function("f", [x], outputs), all(side.is_constant() for side in sides)


def _require_polytope(dynamics: Dynamics, x: Array, A: Array, b: Array, where: str) -> None:
    try:
        polytope(A, b[:, 0])
    except EmptyPolytopeError as error:
        expected = f"a compact set that is not empty at {where}x = {first_numbers(x)}"
        raise MistakenMethodError(dynamics, "input_polytope", expected, str(error)) from error


def _require_finite(dynamics: Dynamics, method: str, x: Array, value: Array, where: str) -> None:
    if not np.isfinite(value).all():
        expected = f"finite numbers at {where}x = {first_numbers(x)}"
        raise MistakenMethodError(dynamics, method, expected, first_numbers(value))


def require_h(swarm: Swarm, x: Array, where: str) -> None:
    """Raise MistakenMethodError unless every pair's h is finite at the stacked x, shape (n̄,)."""
    pairs = swarm.pairs.every
    for few in np.array_split(pairs, 1 + len(pairs) // _TOGETHER):
        chosen = swarm.pairs.choose(few)
        h = chosen.h(x)
        for k in np.flatnonzero(~np.isfinite(h))[:1]:
            pair = Pair(*chosen.pairs[k].tolist())
            raise _infinite(swarm, pair, f"a finite h of {{}} {where}", f"{h[k]:g}")


def _require_chain(rows: SafetyRows, number: int, x: Array) -> None:
    """Raise MistakenMethodError unless a pair's h and the derivatives in its row are finite."""
    composed, chain = rows.swarm.safe_set, rows.pair_chain(number)
    pair = composed.pairs[number]
    values = ca.vertcat(*chain.psi, *chain.drift.nz, *[ca.vec(g) for g in chain.actuation])
    state = np.concatenate([x[composed.parts[l]] for l in pair if l < len(composed.members)])
    numbers = np.array(ca.Function("f", [chain.set.x], [ca.densify(values)])(state)).ravel()
    if not np.isfinite(numbers).all():
        got = "an h without finite derivatives" if np.isfinite(numbers[0]) else f"{numbers[0]:g}"
        raise _infinite(rows.swarm, pair, "a finite h of {}, and finite derivatives", got)


def require_margin(
    rows: SafetyRows, i: int, x: Array, in_sight: Sequence[int], where: str = ""
) -> None:
    """A user's, of normal agent i's rows with those seen. Raises MistakenMethodError.

    where: the state in words, " at the start".
    """
    swarm, margin = rows.swarm, rows.swarm.safety.margin_kind
    if is_built_in(margin):
        return
    terms = rows.pair_terms(i)(x, in_sight, swarm.sharing)
    for k in np.flatnonzero(~np.isfinite(terms.margin))[:1]:
        other = terms.others[k]
        beside = "an obstacle or a limit" if other is None else swarm.names[other]
        expected = f"a finite margin of {swarm.names[i]} and {beside}{where}"
        raise MistakenMethodError(margin, "at_sample", expected, "no finite number")


def _infinite(swarm: Swarm, pair: Pair, expected: str, got: str) -> MistakenMethodError:
    """expected: a format with a field for the names of the pair."""
    composed = swarm.safe_set
    both = f"{composed.labels[pair.a]} and {composed.labels[pair.b]}"
    return MistakenMethodError(*composed.method_of(pair), expected.format(both), got)
