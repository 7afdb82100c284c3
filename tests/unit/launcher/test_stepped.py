"""A run in steps has the bits of a run in one go, and is on record however its program ends."""

import functools
import gc
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phalanx
from phalanx import Command, CommandPolicy, Outcome, SteppedRun
from phalanx.launcher import simulation
from phalanx.launcher.simulation import DirectAgents
from phalanx.messages.kinds import Broadcast
from phalanx.recording.records import State
from phalanx.recording.write import RecordingWriter
from tests.unit.swarms import rows_of_scenario

SOON = {"duration": 0.2, "network.loss": 0.3, "network.delay": 0.004}
LATER = {**SOON, "duration": 1.0}
"""So many instants that some are judged and written before the end."""


def begin(**more: object) -> SteppedRun:
    return phalanx.start(phalanx.load("unicycles", {**SOON, **more}))


def in_one_go(run: SteppedRun) -> str:
    """The trajectory of phalanx.run with the same commands."""
    commands = CommandPolicy(schedule=run.commands)
    return phalanx.run(run.scenario, engine="in-process", commands=commands).summary.trajectory


@pytest.mark.slow
def test_stepped_or_in_strides_it_has_the_bits_of_a_run():
    stepped, strides = begin(), begin()
    times = list(stepped)
    for t in (0.03, 0.03, 0.1, 0.2):
        strides.until(t)
        assert strides.t == max(x for x in [*times, 0.2] if x <= t)
    assert stepped.over
    assert not stepped.step()
    a, b = stepped.end(), strides.end()
    assert a.verdict is b.verdict is Outcome.GUARANTEED
    assert a.summary.trajectory == b.summary.trajectory == in_one_go(stepped)
    assert times == [t for t in a.states["t"].to_list() if t < 0.2]
    assert a.summary.wall_time > 0.0


def test_an_agent_that_starts_again_has_received_nothing_yet():
    agents = DirectAgents(rows_of_scenario("unicycles"), lambda _: None)
    agents.steps[2].inbox.put(1, Broadcast(k=0, t_apply=0.0, u=(1.0, 0.0)))
    agents.steps[2].inbox.advance({1: (0, 0)}, 0.01)
    assert agents.steps[2].inbox.received
    other = agents.steps[0]
    agents.restart(2, 0.02)
    assert not agents.steps[2].inbox.received
    assert agents.steps[0] is other


@pytest.mark.slow
def test_commanded_it_has_the_bits_of_a_run_with_these_commands():
    run, other = begin(), begin()
    for stepped_run in (run, other):
        stepped_run.until(0.05)
        stepped_run.command("loss", value=0.8)
        stepped_run.command("kill", "2", at=0.1)
        stepped_run.until(0.12)
    assert other.command("restart", "2").t > 0.12
    for stepped_run in (run, other):
        stepped_run.until()
    hashes = [stepped_run.end().summary.trajectory for stepped_run in (run, other)]
    assert hashes[0] != hashes[1]
    assert hashes == [in_one_go(stepped_run) for stepped_run in (run, other)]
    assert phalanx.verify(other.end(), engine="in-process")


@pytest.mark.slow
def test_it_shows_what_its_tables_have():
    with begin(duration=0.05) as run:
        assert run.t == 0.0
        assert all((u == 0.0).all() for u in run.inputs.values())
        instants = [(t, run.states, run.h, run.inputs) for t in run]
    finished = run.end()
    for row, h_row, (t, states, h, _) in zip(
        finished.states.iter_rows(named=True),
        finished.h.iter_rows(named=True),
        instants,
        strict=False,
    ):
        assert row["t"] == t
        assert [row["1.x"], row["1.y"], row["1.theta"]] == states["1"].tolist()
        assert {label: h_row[label] for label in h} == h
    last = finished.inputs.filter(agent="1").row(-1, named=True)
    assert [v for n, v in last.items() if n.startswith("u.")] == instants[-1][3]["1"].tolist()


@pytest.mark.slow
def test_what_it_hands_out_is_a_copy():
    run = begin()
    run.until(0.02)
    run.states["1"][:] = np.nan
    run.inputs["1"][:] = np.nan
    run.until()
    assert run.end().verdict is Outcome.GUARANTEED


@pytest.mark.slow
def test_ended_early_it_is_stopped_and_can_be_verified(monkeypatch: pytest.MonkeyPatch):
    run, closed = begin(), list[bool]()
    world = run._simulation.clock.world
    monkeypatch.setattr(world.integration, "close", lambda: closed.append(True))
    run.until(0.1)
    finished = run.end()
    assert closed == [True]
    assert finished.verdict is Outcome.STOPPED
    assert finished.summary.reason == "ended by its program"
    assert finished.summary.t == run.t <= 0.1
    assert run.end().summary is finished.summary
    assert phalanx.verify(finished, engine="in-process")
    with pytest.raises(ValueError, match="the run is over"):
        run.command("turn", "1")


@pytest.mark.slow
def test_an_error_of_its_program_ends_it_and_goes_on(tmp_path: Path):
    scenario = phalanx.load("unicycles", SOON)
    with pytest.raises(KeyError), phalanx.start(scenario, out=tmp_path) as run:  # noqa: PT012
        run.until(0.1)
        run.states["nobody"]
    reopened = phalanx.open(run.folder)
    assert reopened.verdict is Outcome.STOPPED
    assert reopened.summary.reason == "ended by KeyError: 'nobody'"
    assert reopened.states["t"].max() == run.t


def pressing(call: Callable[..., Any]) -> Callable[..., Any]:
    """The same call, in the middle of which Ctrl-C is pressed."""

    def pressed(*arguments: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return call(*arguments)

    return pressed


@pytest.mark.slow
@pytest.mark.parametrize("call", ["clock._reach", "clock._sample", "_recording.write"])
def test_ctrl_c_in_a_step_ends_it_and_is_raised(
    call: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr(simulation, "LARGE_BATCH", 1)  # it writes after each instant
    run = phalanx.start(phalanx.load("unicycles", LATER), out=tmp_path)
    run.until(0.05)
    *path, name = call.split(".")
    of = functools.reduce(getattr, path, run._simulation)
    monkeypatch.setattr(of, name, pressing(getattr(of, name)))
    with pytest.raises(KeyboardInterrupt):
        run.until()
    assert run.over
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    reopened = phalanx.open(run.folder)
    assert reopened.summary.reason == "stopped by the user"
    assert phalanx.verify(reopened, engine="in-process")


@pytest.mark.slow
def test_ctrl_c_of_a_whole_run_in_a_program_of_ones_own_tears_nothing(
    monkeypatch: pytest.MonkeyPatch,
):
    pressed = False

    def write(self: RecordingWriter, *records: State) -> None:
        nonlocal pressed
        if not pressed and any(record.t > 0.1 for record in records):
            pressed = True
            signal.raise_signal(signal.SIGINT)
        written(self, *records)

    written = RecordingWriter.write
    monkeypatch.setattr(RecordingWriter, "write", write)
    monkeypatch.setattr(simulation, "LARGE_BATCH", 1)
    run = phalanx.run(phalanx.load("unicycles", LATER), engine="in-process")
    assert run.verdict is Outcome.STOPPED
    assert phalanx.verify(run, engine="in-process")


@pytest.mark.slow
def test_an_error_of_ours_is_raised_and_never_taken_for_the_end(monkeypatch: pytest.MonkeyPatch):
    run = begin()
    monkeypatch.setattr(run._simulation.clock.world, "advance", lambda _: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run.until()
    assert run.end().summary.outcome is Outcome.BROKEN
    assert run.end().summary.reason == "ZeroDivisionError: division by zero"


@pytest.mark.slow
def test_forgotten_it_is_on_record(tmp_path: Path):
    run = phalanx.start(phalanx.load("unicycles", SOON), out=tmp_path)
    run.until(0.1)
    folder, t = run.folder, run.t
    del run
    gc.collect()
    reopened = phalanx.open(folder)
    assert reopened.summary.reason == "its program left it"
    assert reopened.states["t"].max() == t


@pytest.mark.slow
def test_commands_that_cannot_be_given_are_refused_in_a_line():
    run = begin()
    run.until(0.1)
    for arguments, message in (
        (("warp",), "kind: expected one of pause, "),
        (("kill", "9"), "agent: expected one of 1, 2, 3, "),
        (("loss", "", 2.0), "value: expected 0 to 1, got 2.0"),
        (("pause",), "kind: 'pause' changes the pace only"),
    ):
        with pytest.raises(ValueError, match=message):
            run.command(*arguments)
    for t in (0.1, 0.2):
        with pytest.raises(ValueError, match="at: expected a time from the next instant"):
            run.command("kill", "1", at=t)
    assert run.commands == ()
    nobody = CommandPolicy(schedule=(Command(0.1, "kill", "9"),))
    for begun in (phalanx.start, functools.partial(phalanx.run, engine="in-process")):
        with pytest.raises(ValueError, match="agent: expected one of 1, 2, 3, "):
            begun(run.scenario, commands=nobody)
    with pytest.raises(ValueError, match="has no hub"):
        phalanx.start(run.scenario, commands=CommandPolicy(secret=b"s"))


@pytest.mark.slow
def test_a_run_that_cannot_begin_leaves_its_recording_closed(monkeypatch: pytest.MonkeyPatch):
    closed = []

    class Watched(RecordingWriter):
        def __exit__(self, *error: Any) -> None:
            closed.append(True)
            super().__exit__(*error)

    def fails(*_: object, **__: object) -> None:
        raise OSError("no plant")

    monkeypatch.setattr(simulation, "RecordingWriter", Watched)
    monkeypatch.setattr(simulation, "PlantRun", fails)
    with pytest.raises(OSError, match="no plant"):
        begin()
    assert closed == [True]
