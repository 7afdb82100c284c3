"""Swarms in space: views from above and from the side, and legends that stay short."""

from pathlib import Path

import pytest

from phalanx.recording.read import read
from phalanx.report import figures, space
from phalanx.report.measures import (
    Motion,
)
from phalanx.report.write import notes, plates, write_report
from phalanx.swarm.swarm import build_swarm
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space


def test_one_normal_agent_alone_with_an_obstacle_in_space(tmp_path: Path) -> None:
    obstacles = [{"center": [5.0, 2.0, 1.0], "clearance": 1.0}]
    scenario = swarm_in_space(1, 0, {"obstacles": obstacles})
    report = write_report(record(tmp_path, scenario, drift(scenario), summary_of(scenario)))
    names = {image.stem for image in (report.parent / "figures").iterdir()}
    assert names == {"h_tot", "paths", "distances", "inputs-n0", "certified", "solve-times"}


@pytest.mark.filterwarnings("error")
def test_many_agents_in_space_keep_the_legends_short(tmp_path: Path) -> None:
    scenario = swarm_in_space(16, 3, {})
    records = drift(scenario, states=20, steps=6)
    recording = read(record(tmp_path, scenario, records, summary_of(scenario)))
    (note,) = notes(recording)
    assert note.startswith("Inputs are drawn for 12 of 16 normal agents")
    assert sum(p.name.startswith("inputs-") for p in plates(recording, [])) == 12
    swarm = build_swarm(scenario)
    motion = Motion(recording, swarm)
    above, side = space.paths(recording, motion).axes
    assert (above.get_ylabel(), side.get_ylabel()) == ("y [m]", "z [m]")
    for axes in space.distances(recording, swarm, motion).axes:
        assert len(axes.get_legend().get_texts()) == 12
    received = figures.ages(recording)
    assert received is not None
    assert len(received.axes) == 12
    received.draw_without_rendering()  # warns if the legends leave the panels no room
