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
        for command in ("certify", "view", "export --csv tables")
    ),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder with a module, a scenario that names it, and a recording of that."""
    here = tmp_path_factory.mktemp("elsewhere")
    (here / "mine.py").write_text(MODULE)
    table = phalanx.load("one-on-one", {"duration": 0.2}).model_dump_json(by_alias=True)
    renamed = table.replace('"type":"track-velocity"', '"type":"mine:Mine"')
    assert renamed != table
    program = (
        f"import json, phalanx; phalanx.run(phalanx.load(json.loads({renamed!r})), "
        "engine='in-process', out='runs')"
    )
    subprocess.run([sys.executable, "-c", program], cwd=here, check=True)
    (here / "it-ran").unlink()
    return here


def command(folder: Path, words: str, status: int, **environment: str) -> str:
    """Return all that a command in a folder printed, which ended with this status."""
    ended = subprocess.run(
        [sys.executable, "-m", "phalanx", *words.split()],
        cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert ended.returncode == status, ended.stderr
    return ended.stderr + ended.stdout


def opened(words: str, folder: Path, status: int) -> str:
    """Return all that a command printed of the recording in a folder."""
    name, *options = words.split()
    return command(folder, " ".join([name, "runs/one-on-one-1", *options]), status)


@pytest.mark.parametrize("reader", READERS)
def test_a_recording_that_names_code_is_refused_in_one_line(reader: str, folder: Path) -> None:
    printed = opened(reader, folder, 3)
    assert "mine:Mine" in printed
    assert "--trust" in printed
    lines = [line for line in printed.splitlines() if " INFO " not in line]
    assert len([line for line in lines if line != "exporting: reading the recording"]) == 1
    assert not (folder / "it-ran").exists()


@pytest.mark.parametrize(
    "words",
    ["check one-on-one", "keys made --scenario one-on-one", "router --run r --scenario one-on-one"],
)
def test_a_scenario_that_names_code_is_refused_and_runs_none_of_it(
    words: str, folder: Path
) -> None:
    before = set(folder.iterdir())
    printed = command(folder, f"{words} --set {NAMES_CODE}", 64)
    assert "mine:Mine" in printed
    assert "--trust" in printed
    assert set(folder.iterdir()) == before


def test_keys_of_a_scenario_that_is_trusted_are_made(folder: Path, tmp_path: Path) -> None:
    keys = f"keys {tmp_path}/keys --scenario one-on-one --set {NAMES_CODE} --trust"
    command(folder, keys, 0)
    assert (tmp_path / "keys" / "1" / "tls.key").exists()
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
    secrets = {"PHALANX_SECRET": "hush-1", "PHALANX_COMMAND_SECRET": "hush-2"}
    peeking = "run one-on-one --set agents.0.law.type=peek:Mine --set duration=0.1 --no-report"
    command(tmp_path, peeking, 0, **secrets)
    assert "hush" not in (tmp_path / "seen").read_text()


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording in a folder where the module that it names is not; where it was it is deleted."""
    written, elsewhere = tmp_path_factory.mktemp("written"), tmp_path_factory.mktemp("moved")
    (written / "far_law.py").write_text(MODULE.replace("class", "import far_gain\nclass"))
    (written / "far_gain.py").write_text("GAIN = 1\n")
    options = "--set agents.0.law.type=far_law:Mine --set duration=0.2 --out runs"
    command(written, f"run one-on-one {options}", 0)
    (written / "runs").rename(elsewhere / "runs")
    for module in ("far_law.py", "far_gain.py"):
        (written / module).unlink()
    return elsewhere


def test_elsewhere_a_recording_without_trust_runs_nothing_and_says_what_it_brought(
    moved: Path,
) -> None:
    printed = opened("report", moved, 3)
    assert len(printed.splitlines()) == 1
    assert "--trust" in printed
    assert "recorded with it: far_law.py, far_gain.py" in printed
    assert not (moved / "it-ran").exists()


def test_a_module_found_here_that_differs_is_not_the_one_that_is_used(moved: Path) -> None:
    other = moved / "far_law.py"
    other.write_text("raise SystemExit('the wrong one')\n")
    printed = opened("verify --engine in-process --trust", moved, 0)
    other.unlink()
    assert "imported from the recording: far_law.py, far_gain.py" in printed
