"""A run exported for other tools, read back with the official libraries."""

from collections import Counter
from functools import cache
from pathlib import Path

import polars as pl
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from phalanx_viewer.export.write import run

import phalanx
from phalanx.faults.commands import Command, CommandKind
from phalanx.messages.step_report import QUANTITIES


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> phalanx.Run:
    """Agents that a wall and an adversary press together."""
    out = tmp_path_factory.mktemp("runs")
    return phalanx.run("surrounded", engine="in-process", out=out)


@pytest.fixture(scope="module")
def exported(finished, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("exported") / "shown.mcap"
    assert run(finished.recording, mcap=path) == [path]
    return path


@cache
def messages(path: Path) -> list[tuple[str, str, float, object]]:
    """(topic, schema, time [s], message) of all that there is."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, schema.name, message.log_time * 1e-9, decoded)
            for schema, channel, message, decoded in reader.iter_decoded_messages()
        ]


def of(path: Path, topic: str) -> list[object]:
    return [decoded for name, _, _, decoded in messages(path) if name == topic]


def test_every_topic_has_the_schema_that_tools_know(exported):
    schemas = {topic: schema for topic, schema, _, _ in messages(exported)}
    assert schemas["/tf"] == "foxglove.FrameTransforms"
    assert schemas["/poses"] == "foxglove.PosesInFrame"
    assert schemas["/scene"] == "foxglove.SceneUpdate"
    assert schemas["/log"] == "foxglove.Log"
    assert schemas["/agents/1/state"] == "phalanx.SingleIntegratorState"
    assert schemas["/agents/1/step"] == "phalanx.SingleIntegratorStep"


def test_there_is_a_message_for_every_state_and_step(exported, finished):
    counts = Counter(topic for topic, *_ in messages(exported))
    states = len(finished.recording.states)
    for topic in ("/tf", "/poses", "/h", "/agents/1/state", "/agents/3/state"):
        assert counts[topic] == states
    for name in ("1", "2", "3"):
        inputs = finished.inputs.filter(pl.col("agent") == name)
        assert counts[f"/agents/{name}/step"] == len(inputs)


def test_states_inputs_and_h_are_those_of_the_recording(exported, finished):
    messages = of(exported, "/agents/1/state")
    assert [(s.x, s.y) for s in messages] == finished.states.select("1.x", "1.y").rows()
    inputs = finished.inputs.filter(pl.col("agent") == "1").sort("t")
    messages = of(exported, "/agents/1/step")
    assert [s.u_vx for s in messages] == inputs["u.vx"].to_list()
    assert [s.nominal_vy for s in messages] == inputs["nominal.vy"].to_list()
    assert [s.origin for s in messages] == inputs["origin"].to_list()
    assert [s.h_1_2 for s in of(exported, "/h")] == pytest.approx(finished.h["1-2"].to_list())


@pytest.mark.parametrize("name", QUANTITIES)
def test_every_number_of_a_step_is_in_the_table_and_exported(exported, finished, name):
    own = finished.inputs.filter(pl.col("agent") == "1").sort("t")
    steps = of(exported, "/agents/1/step")
    exported_numbers = [getattr(step, name) if step.HasField(name) else None for step in steps]
    assert exported_numbers == own[name].to_list()


def test_an_adversary_has_no_certified_time_rather_than_one_of_zero(exported):
    assert not any(step.HasField("certified") for step in of(exported, "/agents/2/step"))
    assert all(step.HasField("certified") for step in of(exported, "/agents/1/step"))


def test_each_channel_has_the_units_of_its_fields(exported):
    with exported.open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    units = {channel.topic: channel.metadata for channel in channels}
    assert units["/agents/1/state"] == {"x": "m", "y": "m"}
    assert units["/agents/1/step"]["u_vx"] == "m/s"
    assert units["/agents/1/step"]["certified"] == "s"
    assert units["/agents/1/step"]["residual"] == "m²/s"


def test_every_agent_is_drawn_once_and_moves_with_its_frame(exported, finished):
    opening = of(exported, "/scene")[0]
    entities = {entity.id: entity for entity in opening.entities}
    names = [name for name, _, _ in finished.scenario.roster()]
    assert set(names) <= entities.keys()
    assert all(entities[n].frame_id == n and entities[n].frame_locked for n in names)
    last = of(exported, "/tf")[-1]
    assert [t.child_frame_id for t in last.transforms] == names
    for transform, pose in zip(last.transforms, of(exported, "/poses")[-1].poses, strict=True):
        there, listed = transform.translation, pose.position
        assert (there.x, there.y, there.z) == (listed.x, listed.y, listed.z)
    x, y = finished.states.select("1.x", "1.y").row(-1)
    assert (last.transforms[0].translation.x, last.transforms[0].translation.y) == (x, y)


def test_a_violated_pair_is_a_red_line_while_it_lasts(exported, finished):
    assert finished.verdict is phalanx.Outcome.VIOLATED
    updates = [(t, m) for topic, _, t, m in messages(exported) if topic == "/scene"]
    red = {t for t, update in updates[1:] if any("1-2" in e.id for e in update.entities)}
    deep = finished.h.filter(pl.col("1-2") > 0)["t"].to_list()
    assert deep
    assert sorted(red) == pytest.approx(deep)


def test_the_verdict_is_the_last_line_of_the_log(exported, finished):
    last = of(exported, "/log")[-1]
    assert last.message.startswith("violated: ")
    assert last.level == last.ERROR


def test_violations_are_errors_and_faults_and_failed_assumptions_warnings(tmp_path):
    turn = Command(1.2, CommandKind.TURN, "1")
    frozen = Command(0.1, CommandKind.FREEZE, "1")
    faulty = phalanx.run(
        phalanx.load("surrounded", ["duration=1.5"]),
        engine="in-process",
        out=tmp_path,
        commands=phalanx.CommandPolicy(
            schedule=(frozen, Command(0.2, CommandKind.THAW, "1"), turn)
        ),
    )
    (path,) = run(faulty.recording, mcap=tmp_path / "shown.mcap")
    levels = {line.message: line.Level.Name(line.level) for line in of(path, "/log")}
    assert levels["agent 1 frozen"] == "WARNING"
    assert levels["agent 1 thawed"] == "INFO"
    assert levels["1-2 left the safe set"] == "ERROR"
    assert {level for text, level in levels.items() if text.startswith("failed: ")} == {"WARNING"}
    red = [t for topic, _, t, m in messages(path) if topic == "/scene" if "1-2" in str(m.entities)]
    assert 1.0 < min(red) < max(red) < 1.2, "from then on it is a pair of two that attack"
