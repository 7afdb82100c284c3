"""Objects of users' classes, whatever their kind: each call of a method is guarded."""

import itertools
import threading
from dataclasses import dataclass
from typing import Any

import casadi as ca
import pytest

from phalanx.network.rule import Message, Rule
from phalanx.schema.registry import construct
from phalanx.swarm.watchdog import Watchdog, endless_loops
from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx.theory.laws.goals import Reference
from phalanx.theory.laws.law import Controller, Law
from phalanx.theory.margins.margin import Margin
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.world import World
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.function import Body, Limit, SafeSetFunction

METHODS = {
    Dynamics: "drift actuation position input_polytope input_metric travel",
    ClassK: "value",
    SafeSetFunction: "between to_obstacle",
    Limit: "alone",
    Margin: "at_sample",
    Reference: "goal end",
    Law: "prepare input join",
    Controller: "prepare input",
    Rule: "treat",
    World: "begin reseed hold advance close require_robots",
}
CALLS = [(kind, method) for kind, methods in METHODS.items() for method in methods.split()]


@dataclass
class Failing:
    """A class of every kind whose methods all do the same."""

    how: Any = "raises"
    asked: int = 0
    states = inputs = ("x",)
    determinism = "bits"

    def prepare(self, *arguments):
        self.asked += 1
        if self.how == "asked":
            return ca.SX(self.asked)
        if self.how == "refuses":
            raise ValueError("it does not fit")
        if self.how == "raises":
            return 1 / 0
        while self.how == "hangs":
            pass
        return self.how

    def input(self, *arguments):
        return self.prepare(*arguments)

    drift = actuation = position = input_polytope = input_metric = travel = prepare
    value = between = to_obstacle = alone = at_sample = goal = end = join = treat = prepare
    begin = reseed = hold = advance = close = require_robots = prepare


LINE = Failing.prepare.__code__.co_firstlineno + 7
"""Of the division by zero."""


def instance(kind: type, how: Any) -> Any:
    return construct(kind, {"type": f"{__name__}:Failing", "how": how})


def mistake(call: Any, *arguments: Any) -> str:
    with pytest.raises(MistakenMethodError) as error:
        call(*arguments)
    return str(error.value)


@pytest.mark.parametrize(("kind", "method"), CALLS)
def test_a_method_that_fails_is_named_with_file_and_line(kind, method):
    message = mistake(getattr(instance(kind, "raises"), method))
    assert message.startswith(
        f"Failing.{method}: expected no error, got ZeroDivisionError: division by zero ("
    )
    assert message.endswith(f"test_guarded.py, line {LINE})")


@pytest.mark.parametrize(("kind", "method"), CALLS)
def test_a_method_that_does_not_return_is_named(kind, method):
    with endless_loops(0.02):
        said = mistake(getattr(instance(kind, "hangs"), method))
    assert "expected no error, got an endless loop, or too slow (" in said


def test_one_wait_after_another_is_no_long_one():
    waits, polls, over = [*map(str, range(50)), "the last"], itertools.count(), threading.Event()
    stalled = []

    def waiting():
        return {"1": waits[min(next(polls), 50)]}

    def stall(*what):
        stalled.append(what)
        over.set() if what[2] else None

    with Watchdog(0.02, waiting, stall):
        assert over.wait(60.0)
    assert stalled[:2] == [("1", "the last", False), ("1", "the last", True)]


@pytest.mark.parametrize(("kind", "method"), CALLS)
def test_a_refusal_by_protocol_stays_what_it_is(kind, method):
    if method in ("prepare", "join", "require_robots"):
        with pytest.raises(ValueError, match=r"^it does not fit$"):
            getattr(instance(kind, "refuses"), method)()
    else:
        assert "ValueError: it does not fit" in mistake(getattr(instance(kind, "refuses"), method))


BODY = Body(ca.SX.sym("x"), ca.SX(0))
MESSAGE = Message("a", "b", 0, 0.0, 0.0, 0.0, 0, 0.0, {})
WRONG = [
    (ClassK, "value", (ca.SX.sym("s"),), "a scalar"),
    (SafeSetFunction, "between", (BODY, BODY), "a scalar"),
    (SafeSetFunction, "to_obstacle", (BODY, None), "a scalar"),
    (Limit, "alone", (BODY,), "a scalar"),
    (Rule, "treat", (MESSAGE,), "DELIVER, DROP, or a tuple of copies that arrive after sending"),
    (Dynamics, "travel", (None, 0.0, 0.0), "a distance [m]"),
]


@pytest.mark.parametrize(("kind", "method", "arguments", "expected"), WRONG)
def test_what_it_may_not_return_is_named(kind, method, arguments, expected):
    listed = "['soon']" if kind in (Rule, Dynamics) else "a list that is no expression"
    for wrong, got in ((None, "None"), (["soon"], listed)):
        said = mistake(getattr(instance(kind, wrong), method), *arguments)
        assert said.startswith(f"Failing.{method}: expected {expected}, got {got} (")


def test_an_expression_depends_on_no_earlier_call():
    alpha, s = instance(ClassK, "asked"), ca.SX.sym("s")
    assert [float(alpha.value(s)) for _ in range(2)] == [1.0, 1.0]
    law = instance(Law, "asked")
    assert [float(law.input(None)) for _ in range(2)] == [1.0, 2.0]
