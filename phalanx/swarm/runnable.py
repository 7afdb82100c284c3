"""Everything evaluated once at x(0), so that a mistake is said before any process starts."""

import math

from phalanx.arrays import Array
from phalanx.network.link import RuleError
from phalanx.scenario.load import ScenarioError
from phalanx.swarm.finite import require_dynamics, require_h
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.expressions.asked import MistakenMethodError
from phalanx.theory.laws.law import View
from phalanx.theory.laws.nominal import NominalInput
from phalanx.theory.models.dynamics import Bounded, travelled

_SOON = 0.1
"""How far ahead `travel` is asked for [s]."""


def require_runnable(swarm: Swarm) -> SafetyRows:
    """Build the rows of a run and evaluate dynamics, h, rows and laws at x(0).

    Raises:
        ScenarioError: the scenario's margin or composition cannot take its expressions; or a class
            returned what is not finite or of the wrong shape, failed, or does not return.
    """
    with endless_loops(swarm.scenario.time.timeout):
        return _runnable(swarm)


def _runnable(swarm: Swarm) -> SafetyRows:
    rows, i, x, name = build_rows(swarm), swarm.normal[0], swarm.start(), swarm.scenario.name
    first = sorted(l for l, _ in swarm.ends)
    try:
        for l in first:
            dynamics, starts = swarm.members[l].dynamics, _starts(swarm, l, x)
            require_dynamics(dynamics, starts, "the start ")
            if isinstance(dynamics, Bounded):
                for start in starts:
                    travelled(dynamics, start, _SOON, 0.0)
        require_h(swarm, x, "at the start")
        # Not all: of a large swarm no agent evaluates so many at once.
        seen = sorted({*swarm.seen(i, x), *[l for ends in swarm.ends for l in ends]})
        if rows.pairwise:
            rows.pair_terms(i)(x, seen)
        else:
            terms = rows.terms(i)(x, seen)
            terms.psi, terms.margin  # noqa: B018
        for l in first:
            _require_law(rows, l, x)
        _require_rules(swarm, x)
    except (MistakenMethodError, RuleError) as error:
        raise ScenarioError(f"{name}: {error}") from error
    except ScenarioError:
        raise  # a ValueError too
    except ValueError as error:
        raise ScenarioError(f"{name}: safety: {error}") from error
    return rows


def _starts(swarm: Swarm, l: int, x: Array) -> list[Array]:
    """x(0) of each agent of agent l's group, out of the stacked one."""
    parts = zip(swarm.groups, swarm.safe_set.parts, strict=True)
    return [x[part] for group, part in parts if group is swarm.groups[l]]


def _require_rules(swarm: Swarm, x: Array) -> None:
    """Of a user's own: the treatment of a first message. Raises RuleError."""
    points = swarm.positions(x)
    for sender, receiver, link in swarm.links.users_rules():
        ends = [points[swarm.names.index(name)] for name in (sender, receiver)]
        link.fate(0, 0.0, math.dist(*ends))


def _require_law(rows: SafetyRows, i: int, x: Array) -> None:
    """Agent i's first input; of a law of its own, since a law may remember what it was asked."""
    swarm = rows.swarm
    law, seen = swarm.law(i), swarm.seen(i, x)
    terms = rows.terms(i)(x, seen)
    states = {l: x[swarm.safe_set.parts[l]] for l in seen}
    normal = [l for l in swarm.normal if l in states]
    view = View(i, states, normal, swarm.goal(i)(0.0, states[i]), terms)
    NominalInput(law, swarm.members[i])(view)
