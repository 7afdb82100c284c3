"""Swarms in space."""

from pathlib import Path

import pytest

from phalanx.report.write import write_report
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space


@pytest.mark.nightly
@pytest.mark.slow
def test_one_normal_agent_alone_with_an_obstacle_in_space(tmp_path: Path) -> None:
    obstacles = [{"center": [5.0, 2.0, 1.0], "clearance": 1.0}]
    scenario = swarm_in_space(1, 0, {"obstacles": obstacles})
    report = write_report(record(tmp_path, scenario, drift(scenario), summary_of(scenario)))
    names = {image.stem for image in (report.parent / "figures").iterdir()}
    assert names == {
        "h_tot",
        "paths",
        "distances",
        "inputs-n0",
        "certified",
        "solve-times",
    }
