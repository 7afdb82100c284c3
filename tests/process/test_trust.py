"""Opening a file never runs the code that it names, unless one asks for that."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import phalanx

MODULE = """
from pathlib import Path
from phalanx.extend import TrackVelocity

Path("it-ran").touch()

class Mine(TrackVelocity):
    pass
"""
NAMES_CODE = "agents.0.law.type=mine:Mine"
READERS = (
    "report",
    "verify",
    *(
        pytest.param(command, marks=pytest.mark.nightly)
        for command in ("certify", "view", "export --png picture.png")
    ),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder with a module, a scenario that names it, and a recording of that."""
    here = tmp_path_factory.mktemp("elsewhere")
    (here / "mine.py").write_text(MODULE)
    table = phalanx.load("one-on-one", {"duration": 0.2}).model_dump_json(by_alias=True)
    named = table.replace('"type":"track-velocity"', '"type":"mine:Mine"')
    assert named != table
    program = (
        f"import json, phalanx; phalanx.run(phalanx.load(json.loads({named!r})), "
        "engine='in-process', out='runs')"
    )
    subprocess.run([sys.executable, "-c", program], cwd=here, check=True)
    (here / "it-ran").unlink()
    return here


def opened(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    name, *options = command.split()
    arguments = [name, "runs/one-on-one-1", *options]
    return subprocess.run(
        [sys.executable, "-m", "phalanx", *arguments], cwd=folder, capture_output=True, text=True
    )


@pytest.mark.parametrize("command", READERS)
def test_a_recording_that_names_code_is_refused_in_one_line(command: str, folder: Path) -> None:
    ended = opened(command, folder)
    assert ended.returncode == 3
    assert "mine:Mine" in ended.stderr
    assert "--trust" in ended.stderr
    lines = [line for line in ended.stderr.splitlines() if " INFO " not in line]
    assert len([line for line in lines if line != "exporting: reading the recording"]) == 1
    assert not (folder / "it-ran").exists()


@pytest.mark.parametrize(
    "command",
    ["check one-on-one", "keys made --scenario one-on-one", "router --run r --scenario one-on-one"],
)
def test_a_scenario_that_names_code_is_refused_and_runs_none_of_it(
    command: str, folder: Path
) -> None:
    before = set(folder.iterdir())
    ended = subprocess.run(
        [*(sys.executable, "-m", "phalanx"), *command.split(), "--set", NAMES_CODE],
        cwd=folder, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert ended.returncode == 64
    assert "mine:Mine" in ended.stderr
    assert "--trust" in ended.stderr
    assert set(folder.iterdir()) == before


def test_keys_of_a_scenario_that_is_trusted_are_made(folder: Path, tmp_path: Path) -> None:
    command = ["keys", str(tmp_path / "keys"), "--scenario", "one-on-one", "--set", NAMES_CODE]
    phalanx = [sys.executable, "-m", "phalanx"]
    subprocess.run([*phalanx, *command, "--trust"], cwd=folder, check=True)
    assert (tmp_path / "keys" / "1" / "tls.key").exists()
    (folder / "it-ran").unlink()


@pytest.mark.nightly
def test_with_trust_it_is_imported(folder: Path) -> None:
    ended = opened("report --trust", folder)
    assert ended.returncode == 0, ended.stderr
    assert (folder / "it-ran").exists()
    (folder / "it-ran").unlink()


PEEKING = """
import os
from pathlib import Path
from phalanx.extend import TrackVelocity

class Mine(TrackVelocity):
    def input(self, *arguments):
        with open("seen", "a") as seen:
            print(dict(os.environ), Path("/proc/self/cmdline").read_text(), file=seen)
        return super().input(*arguments)
"""


def test_the_law_of_a_run_does_not_see_its_secrets(tmp_path: Path) -> None:
    (tmp_path / "peek.py").write_text(PEEKING)
    options = ["--set", "agents.0.law.type=peek:Mine", "--set", "duration=0.1", "--no-report"]
    ended = subprocess.run(
        [sys.executable, "-m", "phalanx", "run", "one-on-one", *options],
        cwd=tmp_path,
        env={**os.environ, "PHALANX_SECRET": "hush-1", "PHALANX_COMMAND_SECRET": "hush-2"},
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stderr
    assert "hush" not in (tmp_path / "seen").read_text()


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording in a folder where the module that it names is not; where it was it is deleted."""
    written, elsewhere = tmp_path_factory.mktemp("written"), tmp_path_factory.mktemp("moved")
    (written / "far_law.py").write_text(MODULE.replace("class", "import far_gain\nclass"))
    (written / "far_gain.py").write_text("GAIN = 1\n")
    options = ["--set", "agents.0.law.type=far_law:Mine", "--set", "duration=0.2", "--out", "runs"]
    command = [sys.executable, "-m", "phalanx", "run", "one-on-one", *options]
    subprocess.run(command, cwd=written, check=True, capture_output=True)
    (written / "runs").rename(elsewhere / "runs")
    for module in ("far_law.py", "far_gain.py"):
        (written / module).unlink()
    return elsewhere


def test_elsewhere_a_recording_without_trust_runs_nothing_and_says_what_it_brought(
    moved: Path,
) -> None:
    ended = opened("report", moved)
    assert ended.returncode == 3
    assert len(ended.stderr.splitlines()) == 1
    assert "--trust" in ended.stderr
    assert "recorded with it: far_law.py, far_gain.py" in ended.stderr
    assert not (moved / "it-ran").exists()


@pytest.mark.nightly
@pytest.mark.parametrize(
    "command", ["report", "verify", "verify --engine in-process", "certify", "export --csv csv"]
)
def test_elsewhere_a_trusted_recording_brings_its_modules(
    command: str, moved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(os.environ, "TMPDIR", str(tmp_path))
    ended = opened(f"{command} --trust", moved)
    assert ended.returncode == 0, ended.stderr
    assert "imported from the recording: far_law.py, far_gain.py" in ended.stderr
    assert ("bit-identical" in ended.stdout) == command.startswith("verify")
    assert (moved / "it-ran").exists()
    assert list(tmp_path.glob("phalanx-modules-*")) == []
    (moved / "it-ran").unlink()


def test_a_module_found_here_that_differs_is_not_the_one_that_is_used(moved: Path) -> None:
    other = moved / "far_law.py"
    other.write_text("raise SystemExit('the wrong one')\n")
    ended = opened("verify --engine in-process --trust", moved)
    other.unlink()
    assert ended.returncode == 0, ended.stderr
    assert "imported from the recording: far_law.py, far_gain.py" in ended.stderr
