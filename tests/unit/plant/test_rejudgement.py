"""A recording is judged again by the same judge: the same summary, from its inputs alone."""

import dataclasses
from pathlib import Path

import pytest
from msgspec.structs import replace
from phalanx_plant.clock.real_time import Timekeeping
from phalanx_plant.rejudgement import judge_again

import phalanx
from phalanx.faults.commands import Command, CommandKind, CommandPolicy
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.engine import RunOptions, execute
from phalanx.recording.read import Recording, UnreadableRecordingError, read


def recorded(
    name: str, folder: Path, *commands: Command, **overrides: object
) -> tuple[Recording, Summary]:
    options = RunOptions("in-process", commands=CommandPolicy(schedule=commands))
    execute(phalanx.load(name, overrides), folder, options)
    recording = read(folder)
    assert recording.summary is not None
    return recording, recording.summary


def decided_by_recording(summary: Summary) -> Summary:
    return replace(summary, wall_time=0.0, rejected={})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "outcome"),
    [
        pytest.param("crossing", Outcome.GUARANTEED, marks=pytest.mark.nightly),
        ("attacks/paper-margin", Outcome.VIOLATED),
        ("faults/actuator", Outcome.SAFE),
        ("faults/kill", Outcome.SAFE),
        ("faults/lie-replay", Outcome.GUARANTEED),
        ("faults/restart", Outcome.SAFE),
        ("faults/turn", Outcome.GUARANTEED),
    ],
)
def test_a_recording_has_the_same_summary_again(name, outcome, tmp_path: Path):
    recording, summary = recorded(name, tmp_path)
    again = judge_again(recording)
    assert again.outcome is outcome
    assert decided_by_recording(again) == decided_by_recording(summary)


@pytest.mark.slow
def test_so_has_one_with_commands_and_convictions(tmp_path: Path):
    frozen = Command(0.1, CommandKind.FREEZE, "1"), Command(0.2, CommandKind.THAW, "1")
    watched = {"duration": 0.5, "safety.watch": True}
    recording, summary = recorded("faults/lie-input", tmp_path, *frozen, **watched)
    assert summary.trust.convictions
    assert decided_by_recording(judge_again(recording)) == decided_by_recording(summary)


def test_other_inputs_or_no_verdict_are_refused(tmp_path: Path):
    recording, summary = recorded("one-on-one", tmp_path, duration=0.1)
    assert phalanx.open(tmp_path).judge_again().trajectory == summary.trajectory
    forged = [replace(step, u=tuple(0.5 * v for v in step.u)) for step in recording.steps]
    for other, why in (
        ({"steps": forged}, "another trajectory"),
        ({"steps": recording.steps[1:]}, "another trajectory"),
        ({"summary": None}, "its end"),
        ({"summary": replace(summary, outcome=Outcome.STOPPED)}, "its end"),
        ({"summary": replace(summary, punctuality=Timekeeping([]).summary)}, "real time"),
    ):
        with pytest.raises(UnreadableRecordingError, match=why):
            judge_again(dataclasses.replace(recording, **other))
