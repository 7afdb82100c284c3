"""The plots, the film and the exported recording show what agents knew of one another by radio."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from phalanx_viewer.export.write import run
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.main import _effects
from phalanx_viewer.plots.plots import Plot, content
from phalanx_viewer.scene.colours import FRESH, OLD, age_colour
from phalanx_viewer.scene.ghosts import belief_shapes

import phalanx

FEW = {
    "duration": 1.2,
    "agents.0.count": 3,
    "agents.0.start": [[3.0, 0.2, -1.0, 0.0], [-3.0, 0.0, 1.0, 0.0], [0.0, 4.0, 0.0, 0.0]],
    "agents.0.goal": [[-6.0, 0.0], [6.0, 0.0], [0.0, 6.0]],
    "network.loss": 0.4,
    "faults": [],
}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> phalanx.Run:
    scenario = phalanx.load("radio", FEW)
    return phalanx.run(scenario, engine="in-process", out=tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def replay(recorded) -> Replay:
    return Replay(recorded.recording)


def plots(replay: Replay, chosen: int) -> dict[str, Plot]:
    shown = content(replay, [chosen], seekable=True)
    return {plot.title: plot for plot in shown.plots}


@pytest.mark.slow
def test_the_bold_age_is_that_of_the_oldest_state(recorded, replay):
    *single, oldest = plots(replay, 0)["Age of peers' states"].curves
    assert [curve.role for curve in single] == ["", ""]
    steps = [step for step in recorded.recording.steps if step.agent == "1"]
    assert len(steps) == len(oldest.t)
    reported = [step.oldest_input for step in steps[-8:]]
    np.testing.assert_allclose(oldest.y[-8:], reported, rtol=1e-3)


def test_v_is_above_h_by_the_ways_to_stop_and_below_0(recorded, replay):
    v, h = (plots(replay, 0)[f"{name} of the worst pairs{by}"].curves
            for name, by in (("V", " by radio"), ("h", "")))  # fmt: skip
    assert v[-1].role == "chosen"
    assert [curve.name for curve in v][-1] == "1-2"
    (of_pair,) = [curve for curve in h if curve.name == "1-2"]
    start, tau, ways = recorded.recording.x[0], 0.05, 0.0
    for speed in np.linalg.norm(start.reshape(3, 4)[:2, 2:], axis=1):
        ways += speed**2 / 8.0 + tau * speed
    assert v[-1].y[0] == pytest.approx(of_pair.y[0] + ways, rel=1e-3)
    assert max(v[-1].y) < 0.0


def test_the_diagram_has_the_states_that_others_brought(replay):
    diagrams = [plots(replay, i)["Late, lost, false; backup, silence"].zoom for i in range(3)]
    relayed = [(i, b) for i, d in enumerate(diagrams) for b in d.broadcasts if b[4] == "relayed"]
    assert relayed
    assert all(b[2] == i != b[0] and b[1] < b[3] for i, b in relayed)
    assert diagrams[0].end - diagrams[0].begin > 0.5, "two broadcasts of each"


def test_a_set_has_the_colour_of_its_age_and_its_size(replay):
    believed = replay.radio.at(0, 1.0)
    for belief, shape in zip(believed, belief_shapes(believed), strict=True):
        assert shape.colour == age_colour(belief.age)
        sides = belief.corners[1] - belief.corners[0]
        np.testing.assert_allclose(shape.size[:2], np.maximum(sides, 0.02))
    assert (age_colour(0.0), age_colour(5.0)) == (FRESH, OLD)


def test_the_exported_recording_has_sets_and_ages(recorded, replay, tmp_path: Path):
    path = tmp_path / "shown.mcap"
    run(recorded.recording, mcap=path)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = [(c.topic, m) for _, c, _, m in reader.iter_decoded_messages()]
    scenes = [m for topic, m in decoded if topic == "/agents/1/beliefs"]
    assert 10 <= len(scenes) <= 13
    last = scenes[-1].entities[0]
    believed = replay.radio.at(0, last.timestamp.ToNanoseconds() * 1e-9 + 1e-9)
    sizes = [shape.size[0] for shape in belief_shapes(believed)]
    assert [cube.size.x for cube in last.cubes] == pytest.approx(sizes)
    ages = [m for topic, m in decoded if topic == "/agents/1/ages"]
    assert ages[-1].n_2 == pytest.approx(replay.radio.ages(0)[1].y[-1])
    assert not ages[-1].HasField("n_1")


@pytest.mark.slow
def test_no_text_of_a_run_ends_the_element_of_its_page(recorded, tmp_path: Path):
    recording, text = recorded.recording, "</script><b>"
    summary = msgspec.structs.replace(recording.summary, reason=text)
    (page,) = run(replace(recording, summary=summary), html=tmp_path / "run.html")
    assert text not in page.read_text("utf-8")
    assert r"\u003c/script>\u003cb>" in page.read_text("utf-8")


@pytest.mark.slow
def test_the_network_effect_is_plotted_once_it_was_computed(recorded):
    replay = Replay(recorded.recording)
    assert "Network effect" not in plots(replay, 0)
    replay.effects = _effects(replay.model)
    (of_agent,) = plots(replay, 0)["Network effect"].curves
    effect = recorded.network_effect.filter(agent="1")["effect"]
    assert max(of_agent.y) == pytest.approx(100.0 * effect.max(), rel=1e-3)
    assert 0.0 < max(of_agent.y) <= 100.0
