"""phalanx verify: bit-identical, or where it first differs."""

import contextlib
import os
import signal
import struct
from dataclasses import replace
from pathlib import Path

import msgspec
import psutil
import pytest

from phalanx.recording.read import Recording, read
from phalanx.recording.write import RecordingWriter
from tests.process.runs import wait_for
from tests.process.swarm.processes import Run

pytestmark = pytest.mark.swarm


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Recording:
    run = Run(tmp_path_factory.mktemp("verify"), "run", "unicycles", "--set", "duration=0.5")
    assert run.finish()[0] == 0
    return read(run.folder)


def test_a_recording_verifies_against_a_second_run(phalanx, recorded):
    status, output = phalanx("verify", str(recorded.path)).finish()
    assert status == 0
    assert "bit-identical: " in output


def test_one_flipped_bit_of_a_recorded_input_is_found_at_its_step_and_agent(
    phalanx, recorded, tmp_path
):
    at = next(n for n, s in enumerate(recorded.steps) if s.agent == "3" and s.k == 17)
    steps = [msgspec.structs.replace(step) for step in recorded.steps]
    steps[at].u = (with_last_bit_flipped(steps[at].u[0]), steps[at].u[1])
    copy = rewritten(recorded, steps, tmp_path / "flipped.mcap")
    status, output = phalanx("verify", str(copy), "--engine", "in-process").finish()
    assert status == 1
    assert f"differs: step {at}, agent 3, k = 17, t = {steps[at].t:.6f} s: u.nu" in output
    assert "(1 steps of float64 apart)" in output


@pytest.fixture
def long(recorded, tmp_path) -> Path:
    """A recording of a run that takes long to run again."""
    found = replace(recorded, scenario=recorded.scenario.model_copy(update={"duration": 500.0}))
    return rewritten(found, found.steps, tmp_path / "long.mcap")


@pytest.mark.parametrize("engine", ["processes", "in-process"])
@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.nightly)]
)
def test_one_that_is_stopped_is_said_to_be(phalanx, long, engine: str, number: signal.Signals):
    run = phalanx("verify", str(long), "--engine", engine)
    wait_for(lambda: len(run.programs()) == 6 or (engine == "in-process" and writes(run)))
    os.killpg(run.process.pid, number)
    status, output = run.finish()
    assert (status, output.splitlines()[-1]) == (130, "stopped")
    run.wait_until_gone()


def writes(run: Run) -> bool:
    """Return whether the run has begun to record."""
    with contextlib.suppress(psutil.Error):
        files = psutil.Process(run.process.pid).open_files()
        return any("recording.mcap" in file.path for file in files)
    return False


@pytest.mark.nightly
def test_one_that_breaks_alone_when_it_is_run_again_is_no_difference(phalanx, long):
    run = phalanx("verify", str(long))
    wait_for(lambda: "phx-agent-2" in run.programs())
    run.programs()["phx-agent-2"].kill()
    status, output = run.finish()
    assert status == 3
    assert "run again, it broke: " in output
    assert "differs" not in output


def with_last_bit_flipped(value: float) -> float:
    (bits,) = struct.unpack("<Q", struct.pack("<d", value))
    (flipped,) = struct.unpack("<d", struct.pack("<Q", bits ^ 1))
    return flipped


def rewritten(recorded: Recording, steps: list, path: Path) -> Path:
    """The recording with other steps, written as a run writes it."""
    with RecordingWriter(path, recorded.scenario, "copy") as writer:
        for record in sorted([*recorded.states, *steps], key=lambda r: r.t):
            writer.write(record)
        writer.finish(recorded.summary)
    return path
