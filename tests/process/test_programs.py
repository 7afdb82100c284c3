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


def warehouse(**of_group: Any) -> Scenario:
    """The warehouse, in which the last cart has a group of its own and is restarted."""
    restart = {"kind": "restart", "agents": ["cart-3"], "at": 0.1, "for": 0.05}
    table = read_table("warehouse", {"duration": 0.3, "faults": [restart]})
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


@pytest.mark.slow
def test_a_program_by_zenoh_needs_a_process() -> None:
    with pytest.raises(ScenarioError, match=r"cart-3 speaks zenoh, a process alone: take engine"):
        phalanx.run(warehouse(**BY_ZENOH), engine="in-process")
