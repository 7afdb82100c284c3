"""The public names for code of one's own: listed, documented, and all that is needed."""

import ast
import doctest
import inspect
import itertools
import sys

import casadi as ca
import numpy as np
import pytest

import phalanx.extend
from phalanx.schema.built_in import BUILT_IN

SOURCE = ast.parse(inspect.getsource(phalanx.extend))
NAMES = phalanx.extend.__all__
LONGEST_EXAMPLE = 30
HOMES = {
    alias.name: sys.modules[node.module]
    for node in SOURCE.body
    if isinstance(node, ast.ImportFrom) and node.module
    for alias in node.names
}
# What a scenario's field makes by name, and no code of one's own.
_BY_NAME_ONLY = {
    *("PaperMargin", "CorrectedMargin", "Crazyflies", "Mujoco", "Ros2"),
    *("Information", "Paper", "InFlight", "Split", "WorstCase", "Unknown"),
}


def test_its_names_are_those_that_it_imports():
    assert len(NAMES) == len(set(NAMES))
    assert set(HOMES) == set(NAMES)


def test_every_kind_that_a_scenario_names_and_every_class_of_it_is_public():
    kinds = {kind.__name__ for kind in BUILT_IN}
    classes = {home.partition(":")[2] for homes in BUILT_IN.values() for home in homes.values()}
    assert (kinds | classes) - _BY_NAME_ONLY <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_documented(name):
    value = getattr(phalanx.extend, name)
    if not (inspect.isclass(value) or inspect.isfunction(value)):
        assert name in documented_values(HOMES[name])
        return
    assert value.__doc__
    assert not value.__doc__.startswith(f"{name}(")  # which a dataclass has by itself
    if getattr(value, "_is_protocol", False):
        methods = [m for n, m in vars(value).items() if not n.startswith("_")]
        assert methods
        assert all(inspect.getdoc(m) for m in methods)
    require_example(name, value.__doc__)


def require_example(name, docstring):
    """Fail unless a docstring has a short example that prints what it says."""
    names = {n: getattr(phalanx.extend, n) for n in NAMES} | {"ca": ca, "np": np}
    test = doctest.DocTestParser().get_doctest(docstring, names, name, None, 0)
    assert 0 < sum((e.source + e.want).count("\n") for e in test.examples) <= LONGEST_EXAMPLE
    printed = []
    assert doctest.DocTestRunner().run(test, out=printed.append).failed == 0, "".join(printed)


def documented_values(module) -> set[str]:
    """The values of a module with a docstring below them."""
    body = ast.parse(inspect.getsource(module)).body
    names = set()
    for value, below in itertools.pairwise(body):
        targets = value.targets if isinstance(value, ast.Assign) else [getattr(value, "target", 0)]
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return names
