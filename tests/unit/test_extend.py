"""The public names for code of one's own: pinned, documented, and all that is needed."""

import ast
import inspect
import itertools
import sys

import pytest

import phalanx.extend
from phalanx.schema.built_in import BUILT_IN

SOURCE = ast.parse(inspect.getsource(phalanx.extend))
NAMES = """
    Dynamics Bounded Measured box_polytope SingleIntegrator DoubleIntegrator TripleIntegrator
    Unicycle DynamicUnicycle DifferentialDrive Quadrotor IdentifiedQuadrotor
    World WorldAgent WorldStates
    SafeSetFunction Body Separation Distance HeadingAware Obstacle Sphere Wall Box Polygon
    Limit Drawable Fence Band
    ClassK Linear Power Margin PairRow Chain LocalMargin IntegratedMargin
    Law TeamLaw View Goal Member Track TrackVelocity Chase Pursue WorstCase
    WorstLookahead Script
    Reference Sight Motion FixedPoint Waypoints PathAtSpeed Follow
    Controller ControllerView ControlledAgent Received PairTerms Polytope Rows NearestInput
    least_violation Nominal BarrierQP LyapunovBarrierQP Escape
    Rule Message Treatment Copy DELIVER DROP DUPLICATE CORRUPT delay
    CompiledFunction dot length added portable_value
    Array echo echo_error
"""
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


def test_its_names_are_these():
    assert phalanx.extend.__all__ == NAMES.split()
    assert set(HOMES) == set(NAMES.split())


def test_every_kind_that_a_scenario_names_and_every_class_of_it_is_public():
    kinds = {kind.__name__ for kind in BUILT_IN}
    classes = {home.partition(":")[2] for homes in BUILT_IN.values() for home in homes.values()}
    assert (kinds | classes) - _BY_NAME_ONLY <= set(NAMES.split())


@pytest.mark.parametrize("name", NAMES.split())
def test_every_name_is_documented(name):
    found = getattr(phalanx.extend, name)
    if not (inspect.isclass(found) or inspect.isfunction(found)):
        assert name in documented_values(HOMES[name])
        return
    assert found.__doc__
    assert not found.__doc__.startswith(f"{name}(")  # which a dataclass has by itself
    if getattr(found, "_is_protocol", False):
        methods = [m for n, m in vars(found).items() if not n.startswith("_")]
        assert methods
        assert all(inspect.getdoc(m) for m in methods)


def documented_values(module) -> set[str]:
    """The values of a module with a docstring below them."""
    body = ast.parse(inspect.getsource(module)).body
    found = set()
    for value, below in itertools.pairwise(body):
        targets = value.targets if isinstance(value, ast.Assign) else [getattr(value, "target", 0)]
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found
