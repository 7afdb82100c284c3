"""h of an agent and what stands still, an obstacle or a limit."""

import casadi as ca

from phalanx.theory.expressions.asked import ask_expression
from phalanx.theory.safety.function import Body, SafeSetFunction
from phalanx.theory.safety.limits import Boundary
from phalanx.theory.safety.obstacles import Obstacle

Static = Obstacle | Boundary


def static_h(function: SafeSetFunction, a: Body, static: Static, parameters: ca.SX) -> ca.SX:
    """h of a normal agent, scalar; of the symbols, too, that an obstacle may be made of.

    Raises:
        MistakenMethodError: the function or the limit failed, or returned something else.
    """
    if isinstance(static, Boundary):
        return ask_expression(static.limit, "alone", [()], a, symbols=[a.x])
    return ask_expression(function, "to_obstacle", [()], a, static, symbols=[a.x, parameters])
