"""Malformed scenarios and recordings: each is read, or refused in one line."""

import random
import tempfile
import tomllib
from collections.abc import Callable
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import msgspec
from mcap.reader import make_reader
from mcap.writer import Writer

import phalanx
from phalanx.guarantee.check import check
from phalanx.scenario.load import load, read_table, set_field, shipped, validate
from phalanx.scenario.model import ScenarioError
from phalanx.schema.user_code import code_trusted
from phalanx.swarm.swarm import build_swarm
from tests.hostile.mutation import of_bytes, of_numbers, of_tree


@cache
def _texts() -> tuple[str, ...]:
    return tuple(file.read_text(encoding="utf-8") for file in shipped().values())


def try_scenario(draw: random.Random, folder: Path) -> str:
    """Read a spoilt scenario; raise unless the result is a scenario or an error of one line."""
    text = draw.choice(_texts())
    source: Any
    if draw.random() < 0.3:
        source = str(folder / "spoilt.toml")
        Path(source).write_bytes(of_bytes(text.encode(), draw))
    else:
        source = of_tree(tomllib.loads(text), draw, draw.choice((1, 1, 2, 3)))
    with code_trusted(False):
        try:
            if not isinstance(source, dict | str):
                return "no table"
            build_swarm(load(source))
        except ScenarioError as error:
            return "refused" if str(error) else "refused without a word"
        return "accepted"


_PAIRS = {"safety.composition": "pairs", "safety.information": "split", "safety.eta": 0.0}
_CAR = {"type": "unicycle", "speed": 1.0, "turn_rate": 2.0}
_CARS = {
    **{f"agents.{n}.dynamics": _CAR for n in (0, 1)},
    "agents.0.start": [[0.0, 0.0, 0.0]],
    "agents.1.start": [[0.0, -1.7, 0.5]],
    "agents.1.spread": [0.1, 0.1, 0.0],
}
_AHEAD = {"type": "heading-aware", "radius": 1.0, "kappa": 0.3}
_BOX = {"center": [1.0, 2.0], "size": [1.0, 1.0], "clearance": 0.5}
_POLYGON = {"corners": [[2.0, 2.0], [4.0, 2.0], [3.0, 4.0]], "clearance": 0.5}
_FENCE = {"type": "fence", "center": [0.0, 0.0], "radius": 9.0}
_SMALL: tuple[tuple[str, dict[str, Any]], ...] = (
    ("one-on-one", {**_PAIRS, "agents.0.disturbance": {"bound": 0.1}}),
    ("one-on-one", {**_PAIRS, "safety.margin": "integrated", "agents.0.sensing": 5.0}),
    ("one-on-one", {**_PAIRS, "safety.margin": "local", "safety.function.type": "distance"}),
    ("one-on-one", {**_CARS, "agents.0.controller": {"type": "cbf-qp"}}),
    ("one-on-one", {**_CARS, "safety.function": _AHEAD}),
    ("one-on-one", {"safety.information": "unknown", "agents.0.goal": [[1.0, 1.0]]}),
    ("pinned", {"safety.information": "worst-case", "network": {"loss": 0.1, "delay": 0.01}}),
    ("pinned", {"obstacles.0": _BOX}),
    ("pinned", {"obstacles.0": _POLYGON, "limits": [_FENCE]}),
    ("stale-inputs", {}),
    ("disturbance-gap", {"workspace": {v: [-1.0, 1.0] for v in ("vx", "vy", "vz")}}),
)  # fmt: skip
"""Scenarios whose check takes less than a second, and their fields by path."""


@cache
def _small() -> tuple[dict[str, Any], ...]:
    tables = tuple(read_table(name) for name, _ in _SMALL)
    for table, (name, fields) in zip(tables, _SMALL, strict=True):
        for path, value in fields.items():
            set_field(table, path, value)
        assert validate(table, name)
    return tables


def try_check(draw: random.Random, folder: Path) -> str:
    """Check a spoilt scenario; raise unless the result is a report or an error of one line."""
    spoil = draw.choice((of_tree, of_numbers))
    table = spoil(draw.choice(_small()), draw, draw.choice((1, 1, 2, 3)))
    # A user's report rests on 2000 states; the same code decides on 50.
    with (
        patch("phalanx.guarantee.check._SAMPLES", 50),
        patch("phalanx.guarantee.check._BOUNDARY_STATES", 5),
    ):
        try:
            report = check(load(table, trust=False))
        except ScenarioError as error:
            return "refused" if str(error) else "refused without a word"
        return "accepted" if report.answer and repr(report) else "no answer"


@cache
def recorded() -> bytes:
    """A short run as it was recorded."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = phalanx.load("one-on-one", ["duration=0.2"])
        run = phalanx.run(scenario, engine="in-process", out=folder)
        return (run.folder / "recording.mcap").read_bytes()


def spoilt_records(whole: bytes, draw: random.Random) -> bytes:
    """A recording that is whole as a file, with records or attachments that are not."""
    reader, out = make_reader(BytesIO(whole)), BytesIO()
    writer = Writer(out)
    writer.start()
    spoil = draw.choice(["scenario.json", "summary.json", "/state", "/step", "/log"])
    for attached in reader.iter_attachments():
        data = attached.data
        if attached.name == spoil:
            data = _spoilt_json(data, draw)
        writer.add_attachment(0, 0, attached.name, "application/json", data)
    channels: dict[str, int] = {}
    spoilt_once = False
    for _, channel, message in reader.iter_messages():
        if channel.topic not in channels:
            channels[channel.topic] = writer.register_channel(channel.topic, "json", 0)
        data = message.data
        if channel.topic == spoil and (not spoilt_once or draw.random() < 0.1):
            data, spoilt_once = _spoilt_json(data, draw), True
        writer.add_message(channels[channel.topic], message.log_time, data, message.log_time)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def _spoilt_json(data: bytes, draw: random.Random) -> bytes:
    if draw.random() < 0.2:
        return of_bytes(data, draw)
    tree = of_tree(msgspec.json.decode(data), draw, draw.choice((1, 1, 2)))
    return msgspec.json.encode(tree)


def try_recording(draw: random.Random, folder: Path) -> str:
    """Read a spoilt recording; raise unless the result is a run or an error of one line."""
    path = folder / "spoilt.mcap"
    spoil = of_bytes if draw.random() < 0.4 else spoilt_records
    path.write_bytes(spoil(recorded(), draw))
    try:
        run = phalanx.open(path)
        for table in (run.states, run.h, run.inputs, run.links, run.events, run.metrics):
            assert table is not None
    except phalanx.UnreadableRecordingError as error:
        return "refused" if str(error) else "refused without a word"
    assert run._repr_html_()
    return "cut short" if run.recording.damage else "read"


TRIALS: dict[str, Callable[[random.Random, Path], str]] = {
    "scenarios": try_scenario,
    "checks": try_check,
    "recordings": try_recording,
}
