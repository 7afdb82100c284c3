"""The rule of commitments over real processes: engines agree to the bit, and on what was kept."""

import pytest

from phalanx.scenario.load import load
from tests.process.runs import on_both_engines

pytestmark = pytest.mark.swarm


def test_processes_keep_the_rule_to_the_same_bits_as_one_process():
    none = {"agents.0.controller": {"type": "none"}, "safety.keep": "hold"}
    starts = [[2.0, 0.0, 3.1], [-2.0, 0.5, 0.0], [0.5, 3.0, -1.6], [0.0, -3.0, 1.6]]
    meeting = load("crossing", none | {"agents.0.start": starts, "duration": 2.5})
    first, second = on_both_engines(meeting)
    assert first.summary.origins["fallback"] > 0
    assert first.summary.promise == second.summary.promise
    assert first.summary.promise.kept
