"""Own programs of agents in runs of processes: both protocols, kills, restarts, other programs."""

import copy
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phalanx
from phalanx.extend import Array, ControlledAgent, ControllerView
from phalanx.scenario.load import read_table
from phalanx.scenario.model import Scenario, ScenarioError
from tests.process.runs import on_both_engines

EXAMPLES = Path(__file__).parents[2] / "examples" / "programs"
ROBOT = {"program": [sys.executable, str(EXAMPLES / "robot_zenoh.py"), "-8", "0"]}
ROBOT |= {"protocol": "zenoh", "keeps": "own-parts"}
OF_OTHERS = [
    {"kind": "kill", "agents": ["3"], "at": 0.5},
    {"kind": "hijack", "agents": ["6"], "at": 0.6},
]
ITS_OWN = [{"kind": "hijack", "agents": ["1"], "at": 0.7}]
BY_ZENOH = {"program": [sys.executable, str(EXAMPLES / "cart_zenoh.py"), "20", "0"]}
BY_ZENOH |= {"protocol": "zenoh", "keeps": "halves"}


@dataclass
class Straight:
    """The law of examples/programs/cart_zenoh.py as a controller."""

    def prepare(self, agent: ControlledAgent) -> None:
        """Need nothing."""

    def input(self, view: ControllerView) -> Array:
        """Return the rates of both wheels, each at most the largest."""
        from examples.programs.cart import wheels

        goal = {"position": [20.0, 0.0], "velocity": [0.0, 0.0]}
        rates = wheels(view.x[view.i].tolist(), goal)
        return np.array([min(max(rate, -25.0), 25.0) for rate in rates])


@dataclass
class LastHeard:
    """The law of examples/programs/robot_zenoh.py as a controller."""

    def prepare(self, agent: ControlledAgent) -> None:
        """Need nothing."""

    def input(self, view: ControllerView) -> Array:
        """Return the acceleration, each component at most the largest."""
        from examples.programs.robot import acceleration

        peers = {l: {"x": view.x[l].tolist()} for l in sorted(view.received)}
        goal = {"position": view.goal.position.tolist()}
        wish = acceleration({"x": view.x[view.i].tolist(), "goal": goal, "peers": peers})
        return np.array([min(max(a, -4.0), 4.0) for a in wish])


def radio(faults: list[dict[str, Any]], **of_group: Any) -> Scenario:
    """The robots by radio, of which the first has a group of its own, and a partition."""
    table = read_table("radio", {"duration": 1.4})
    first, others = copy.deepcopy(table["agents"][0]), table["agents"][0]
    names = [str(n + 1) for n in range(others.pop("count"))]
    del first["count"]
    for field, values in {"names": names, **{f: others[f] for f in ("start", "goal")}}.items():
        first[field], others[field] = values[:1], values[1:]
    first["radio"] |= {"belief": "newest"}
    table["agents"].insert(0, first | of_group)
    table["faults"] = [table["faults"][0] | {"at": 0.8, "for": 0.5}, *faults]
    return phalanx.load(table)


def warehouse(**of_group: Any) -> Scenario:
    """The warehouse, in which the last cart has a group of its own and is restarted."""
    faults = [
        {"kind": "restart", "agents": ["cart-3"], "at": 0.1, "for": 0.05},
        {"kind": "hijack", "agents": ["cart-1"], "at": 0.12},
        {"kind": "kill", "agents": ["cart-2"], "at": 0.2},
    ]
    table = read_table("warehouse", {"duration": 0.3, "faults": faults})
    last = copy.deepcopy(table["agents"][0]) | {"names": ["cart-3"], "slots": [3], **of_group}
    table["agents"][0] |= {"names": ["cart-1", "cart-2"], "slots": [0, 1]}
    table["agents"].insert(1, last)
    return phalanx.load(table)


@pytest.mark.swarm
@pytest.mark.nightly
def test_a_program_by_zenoh_gives_the_bits_of_the_same_controller_inside() -> None:
    outside = phalanx.run(warehouse(**BY_ZENOH)).summary
    inside = phalanx.run(
        warehouse(controller={"type": f"{__name__}:Straight"}), engine="in-process"
    ).summary
    assert outside.trajectory == inside.trajectory
    assert outside.rejected == {}
    assert outside.outcome == "safe"


@pytest.mark.swarm
@pytest.mark.nightly
def test_a_program_that_is_asked_gives_the_same_run_in_both_engines() -> None:
    first, _ = on_both_engines(warehouse(program=[sys.executable, str(EXAMPLES / "cart.py")]))
    assert first.verdict == "safe"  # it was away for longer than a period


@pytest.mark.swarm
@pytest.mark.nightly
@pytest.mark.parametrize("more", [[], ITS_OWN], ids=["of others", "its own"])
def test_a_program_by_zenoh_knows_its_peers_by_radio(more: list[dict[str, Any]]) -> None:
    controller = {"type": f"{__name__}:LastHeard"}
    inside = phalanx.run(radio(OF_OTHERS + more, controller=controller), engine="in-process")
    outside = phalanx.run(radio(OF_OTHERS + more, **ROBOT), engine="processes")
    assert outside.summary.trajectory == inside.summary.trajectory
    assert outside.summary.trust == inside.summary.trust
    assert outside.summary.rejected == {}
    assert outside.verdict == "safe"
    assert list(outside.inputs["origin"]) == list(inside.inputs["origin"])
    assert all(fault.count for fault in outside.summary.faults)


@pytest.mark.slow
def test_a_program_by_zenoh_needs_a_process() -> None:
    with pytest.raises(ScenarioError, match=r"cart-3 speaks zenoh, a process alone: take engine"):
        phalanx.run(warehouse(**BY_ZENOH), engine="in-process")


HANGS = """
import json, sys, time
for k, line in enumerate(sys.stdin):
    time.sleep(60.0 * (k > 20))
    print(json.dumps({"u": json.loads(line)["u_nom"]}), flush=True)
"""


@pytest.mark.swarm
def test_in_real_time_the_last_line_names_the_program_that_hung() -> None:
    clock = {"latency": 0.005, "timeout": 2.0}
    table = read_table("one-on-one", {"duration": 4.0, "time": clock})
    table["agents"][0]["program"] = [sys.executable, "-c", HANGS]
    (lost,) = phalanx.run(phalanx.load(table), real_time=1.0).summary.lost
    assert lost.startswith("agent 1 at t = ")
    assert "expected to answer within 1 s for agent 1, got nothing" in lost
