"""The design's table of who may import whom, read off the syntax of every file."""

import ast
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROGRAMS = ("agent", "plant", "viewer")

# Own packages that each may import, besides itself. What is not listed may import nothing own.
OWN: Mapping[str, set[str]] = {
    "phalanx.theory": set(),
    "phalanx.randomness": set(),
    "phalanx.clock": {"phalanx.randomness"},
    "phalanx.scenario": {"phalanx.theory", "phalanx.randomness", "phalanx.clock"},
    "phalanx.wire": {"phalanx.scenario", "phalanx.theory", "phalanx.randomness"},
    "phalanx": {"phalanx"},
    **{program: {"phalanx"} for program in PROGRAMS},
}
THEORY_MAY_USE = {"numpy", "casadi", "osqp", "scipy", "annotated_types"}
ONLY_IN_WIRE = {"zenoh"}


def imported(tree: ast.AST, module: str) -> Iterator[str]:
    """Every module that a syntax tree imports, at any depth, as an absolute name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join([*module.split(".")[: -node.level], *filter(None, [node.module])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


def package_of(module: str) -> str:
    """The entry of the table that governs a module: the longest that is its prefix."""
    parts = module.split(".")
    names = (".".join(parts[:n]) for n in range(len(parts), 0, -1))
    return next((name for name in names if name in OWN), parts[0])


def offences(source: str, module: str) -> list[str]:
    """What a module with this source imports against the table."""
    home = package_of(module)
    found = []
    for name in imported(ast.parse(source), module):
        top = name.split(".")[0]
        if top in ("phalanx", *PROGRAMS):
            target = package_of(name)
            own_branch = target == home
            allowed = any(target == a or target.startswith(f"{a}.") for a in OWN[home])
            if name.split(".")[:2] == ["phalanx", "__version__"]:
                continue
            if not own_branch and not allowed:
                found.append(f"{module} may not import {name}")
        elif top in ONLY_IN_WIRE and home != "phalanx.wire":
            found.append(f"{module} may not import {name}: only phalanx.wire does")
        elif home == "phalanx.theory" and top not in THEORY_MAY_USE | sys.stdlib_module_names:
            found.append(f"{module} may not import {name}: theory is numpy, CasADi and OSQP alone")
    return found


def modules() -> list[tuple[str, Path]]:
    """Every module of the project, by dotted name."""
    files = [f for top in ("phalanx", *PROGRAMS) for f in sorted((ROOT / top).rglob("*.py"))]
    named = [(".".join(f.relative_to(ROOT).with_suffix("").parts), f) for f in files]
    return [(name.removesuffix(".__init__"), file) for name, file in named]


def test_no_module_imports_what_the_table_forbids():
    found = modules()
    assert {package_of(name) for name, _ in found} == set(OWN), "the table and the folders differ"
    wrong = [o for name, file in found for o in offences(file.read_text("utf-8"), name)]
    assert wrong == []


def test_no_two_modules_import_one_another_even_by_way_of_others():
    names = {name for name, _ in modules()}
    graph = {
        name: {
            own
            for target in imported(ast.parse(file.read_text("utf-8")), name)
            if (own := target if target in names else target.rpartition(".")[0]) in names
            and own not in (name, "phalanx")
        }
        for name, file in modules()
    }
    assert cycle(graph) is None
    assert sum(map(len, graph.values())) > 50


def cycle(graph: Mapping[str, set[str]]) -> list[str] | None:
    """A cycle of a graph, if there is one."""
    done: set[str] = set()

    def visit(node: str, path: list[str]) -> list[str] | None:
        if node in path:
            return [*path[path.index(node) :], node]
        if node in done:
            return None
        for target in sorted(graph.get(node, ())):
            if found := visit(target, [*path, node]):
                return found
        done.add(node)
        return None

    return next((found for node in sorted(graph) if (found := visit(node, []))), None)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("agent.step", "import plant"),
        ("agent.step", "from plant.world import World"),
        ("plant.main", "from agent import step"),
        ("viewer.live", "import agent.main as program"),
        ("phalanx.launch", "from plant.main import run"),
        ("phalanx.theory.psi", "from phalanx.scenario.model import Scenario"),
        ("phalanx.theory.psi", "from phalanx.randomness import Draws"),
        ("phalanx.theory.psi", "import pydantic"),
        ("phalanx.theory.psi", "from ..wire import keys"),
        ("phalanx.theory.qp", "def f():\n    import zenoh"),
        ("phalanx.scenario.model", "from phalanx.wire.messages import Input"),
        ("phalanx.scenario.model", "from phalanx import launch"),
        ("phalanx.wire.links", "from phalanx.recording.read import read"),
        ("phalanx.randomness", "import phalanx.clock"),
        ("phalanx.recording.read", "import zenoh"),
        ("agent.main", "if True:\n    from zenoh import Session"),
        ("phalanx.cli", "import viewer"),
    ],
)
def test_a_forbidden_import_is_found_wherever_it_stands(module, source):
    assert len(offences(source, module)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("agent.step", "from phalanx.theory.qp import NearestInput\nimport numpy"),
        ("phalanx.theory.qp", "import osqp\nfrom scipy import sparse\nfrom .row import Row"),
        ("phalanx.wire.session", "import zenoh"),
        ("phalanx.scenario.swarm", "from phalanx.clock import SamplingClock"),
        ("phalanx.launch", "from phalanx.wire.keys import Keys"),
    ],
)
def test_an_allowed_import_is_not_an_offence(module, source):
    assert offences(source, module) == []


def test_a_cycle_is_found():
    assert cycle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) == ["a", "b", "c", "a"]
    assert cycle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) is None
