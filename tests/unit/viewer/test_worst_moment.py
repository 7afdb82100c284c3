"""Summary, page, picture and report name one worst moment: the largest h of a pair that counts."""

from pathlib import Path

import numpy as np
import pytest
from phalanx_mcap.content import Content
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.plots.plots import content
from phalanx_viewer.scene.picture import Picture

import phalanx
from phalanx.cli.display import last_line
from phalanx.report import safety
from phalanx.report.write import key_figures
from tests.unit.tables import group, swarm_table

SPEED, AWAY = 2.0, 1.1
END = 1.2


def agent(name: str, role: str, start: list[float], **law: object) -> dict:
    speed = SPEED if role == "adversary" else 1e-3
    return group(name, role, [start], law=law, speed=speed)


def script(*inputs: tuple[float, list[float]]) -> dict[str, object]:
    return {"type": "script", "at": [t for t, _ in inputs], "inputs": [u for _, u in inputs]}


def scenario(**changes: object) -> dict:
    """Five adversaries leave agent 1's surroundings; a sixth passes it, twice, some time later."""
    around = [(np.cos(a), np.sin(a)) for a in np.linspace(0.6, 5.7, 5)]
    leaving = [
        agent(f"away-{k}", "adversary", [AWAY * x, AWAY * y], **script((0.0, [x, y])))
        for k, (x, y) in enumerate(around)
    ]
    passing = (0.0, -2.0), (0.5, 2.0), (0.65, -2.0), (0.9, 2.0)
    hunting = script(*((t, [v, 0.0]) for t, v in passing))
    agents = [
        agent("1", "normal", [0.0, 0.0], type="track-velocity"),
        *leaving,
        agent("hunter", "adversary", [1.8, 0.0], **hunting),
    ]
    return swarm_table(*agents, safety={"rho": 0.5, "eta": 0.0}, duration=END) | changes


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> phalanx.Run:
    loaded = phalanx.load(scenario())
    return phalanx.run(loaded, engine="in-process", out=tmp_path_factory.mktemp("runs"))


@pytest.mark.slow
def test_the_worst_moment_and_pair_are_the_same_everywhere(run: phalanx.Run) -> None:
    summary = run.summary
    assert summary is not None
    assert summary.largest_h_tot_at < 0.1 < 0.5 < summary.worst_at
    assert summary.largest_h_tot > summary.worst_h > 0.0
    assert summary.worst_pair == "1-hunter"
    replay = Replay(run.recording)
    assert replay.worst_at == pytest.approx(summary.worst_at, abs=0.011)
    frame = replay.frame(replay.worst_at)
    assert replay.model.label(frame.pair) == summary.worst_pair
    assert frame.worst_h == pytest.approx(summary.worst_h, abs=1e-9)
    (unsafe,) = Picture(replay.model, frame).unsafe_lines
    assert unsafe.startswith("1-hunter unsafe: ")
    (worst,) = [m for m in content(replay, [0], seekable=True).marks if m.kind == "worst"]
    assert (worst.t, worst.text) == (replay.worst_at, f"worst moment, h = {summary.worst_h:.4g}")
    assert content(replay, [0], seekable=True).pair == frame.pair
    figures = dict(key_figures(run.recording))
    assert figures["Worst h"].startswith(f"{summary.worst_h:.6g} at t = {summary.worst_at:.3f} s")
    assert figures["Largest h_tot"].startswith(f"{summary.largest_h_tot:.6g} at ")
    history = run.recording
    assert safety.worst(history) == (summary.worst_h, summary.worst_at)


@pytest.mark.slow
def test_a_recording_cut_short_has_its_worst_moment_from_its_states(run: phalanx.Run) -> None:
    whole, cut = run.recording, phalanx.open(run.folder).recording
    cut.summary = None
    moment = safety.worst(cut)
    assert moment is not None
    assert moment.h == max(state.h for state in whole.states)
    assert moment.t == Replay(cut).worst_at


@pytest.mark.slow
def test_the_recorded_h_is_that_of_all_integration_steps(run: phalanx.Run) -> None:
    recording, h = run.recording, run.h.drop("run", "scenario", "seed", "t").to_numpy()
    assert (recording.h >= h.max(axis=1) - 1e-12).all()
    assert recording.h.max() == run.summary.worst_h
    assert (recording.h <= recording.h_tot).all()


@pytest.mark.slow
def test_each_excursion_has_its_own_begin_and_end(run: phalanx.Run) -> None:
    (violation,) = run.summary.violations
    assert violation.count == 2
    exits = run.events.filter(run.events["text"].str.contains("left the safe set"))["t"].to_list()
    back = run.events.filter(run.events["text"].str.contains("is safe again"))["t"].to_list()
    assert (violation.first, violation.begin) == tuple(exits)
    assert violation.end == back[1]
    assert violation.duration == pytest.approx(back[0] - exits[0] + back[1] - exits[1])
    assert violation.times.endswith(f"to {back[1]:.3f} s, in 2 excursions")
    assert f"left the safe set, up to h = {violation.worst:.4g} where 0" in last_line(run.summary)
    assert f", for {violation.times}" in last_line(run.summary)
    replay = Replay(run.recording)
    for begin in exits:
        (line,) = Picture(replay.model, replay.frame(begin + 0.02)).unsafe_lines
        assert line.endswith(f"since t = {begin:.3f} s")
    between = Picture(replay.model, replay.frame((back[0] + exits[1]) / 2.0))
    (line,) = between.past_lines
    assert line.startswith(f"1-hunter was unsafe from t = {exits[0]:.3f} s to {back[0]:.3f} s")
    (line,) = Picture(replay.model, replay.frame(END)).past_lines
    assert line.startswith(f"1-hunter was unsafe 2 times, last from t = {exits[1]:.3f} s to ")


@pytest.mark.slow
def test_pairs_without_a_normal_agent_are_neither_the_worst_nor_an_alarm(tmp_path: Path) -> None:
    """The second passing is by two adversaries: agent 1 was hijacked in between."""
    turn = phalanx.Command(0.65, phalanx.CommandKind.TURN, "1")
    bystander = agent("2", "normal", [0.0, 9.0], type="track-velocity")
    table = scenario()
    table["agents"].append(bystander)
    commands = phalanx.CommandPolicy((turn,))
    run = phalanx.run(phalanx.load(table), engine="in-process", out=tmp_path, commands=commands)
    (violation,), (excluded,) = run.summary.violations, run.summary.excluded
    assert (violation.pair, violation.count, excluded.pair) == ("1-hunter", 1, "1-hunter")
    assert violation.end < 0.65 < excluded.first
    assert excluded.worst > run.summary.worst_h == violation.worst
    replay = Replay(run.recording)
    assert replay.worst_at < 0.65
    late = replay.frame(excluded.worst_at)
    picture = Picture(replay.model, late)
    assert late.worst_h == pytest.approx(violation.worst)
    assert [(v.count, v.begin) for v in late.violations] == [(1, violation.begin)]
    assert "1-hunter" not in replay.model.label(late.pair)
    assert (picture.unsafe_lines, picture.unsafe_ends.tolist()) == ([], [])
    assert any("1-hunter: " in line and "not counted" in line for line in picture.past_lines)
    scenes = list(Content(run.recording, replay.model).violated())
    times = [t for t, (now, _) in zip(run.recording.times, scenes, strict=True) if now]
    assert times
    assert max(times) <= violation.end
    assert [over for _, over in scenes if over] == [["1-hunter"]]
