"""Every example does what its first line says, when it is run from another folder."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

import phalanx
from phalanx.wire.session import free_endpoint

EXAMPLES = Path(__file__).parents[2] / "examples"
MOST_LINES = 60
SAYS = {
    "bicycles.py": "guaranteed - largest h -",
    "commands.py": "agent 2 killed",
    "first_run.py": "h_tot",
    "own_law.py": "guaranteed - largest h -",
    "planar_quadrotors.py": "guaranteed - largest h -",
    "plot.py": "worst pair",
    "step_by_step.py": "the same bits: True",
    "study.py": "worst h",
    "verify.py": "bit-identical",
}
"""What each prints at least."""
WITH_A_TEST_OF_ITS_OWN = {"follow_run.py", "study_on_slurm.py"}


def test_there_is_a_test_for_every_example():
    assert {f.name for f in EXAMPLES.glob("*.py")} == set(SAYS) | WITH_A_TEST_OF_ITS_OWN


@pytest.mark.parametrize("example", sorted(EXAMPLES.glob("*.py")), ids=lambda f: f.name)
def test_an_example_is_a_page(example: Path) -> None:
    assert len(example.read_text().splitlines()) < MOST_LINES


@pytest.mark.nightly
def test_the_notebook_runs_cell_by_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((EXAMPLES / "what_if.ipynb").read_text("utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] for cell in cells)
    names: dict[str, Any] = {}
    for cell in cells:
        exec("".join(cell["source"]), names)
    plt.close("all")
    assert "t = 1.99854 of 6 s, running" in capsys.readouterr().out
    assert names["calm"].verdict == "guaranteed"
    assert names["broken"].verdict == "safe"
    assert (tmp_path / "broken.gif").stat().st_size < 2**20


@pytest.mark.swarm
@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", SAYS)
def test_an_example_runs(name: str, tmp_path: Path) -> None:
    assert SAYS[name] in printed(tmp_path, EXAMPLES / name)


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_an_attacker_is_trained(tmp_path: Path) -> None:
    example = EXAMPLES / "pettingzoo_env" / "train_attacker.py"
    assert "trained: largest h" in printed(tmp_path, example, "1")


def printed(folder: Path, *example: Path | str) -> str:
    """Run an example in a folder, with arguments, and return its output."""
    process = subprocess.run([sys.executable, *example], cwd=folder, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    assert "Traceback" not in process.stderr
    return process.stdout


@pytest.mark.nightly
@pytest.mark.parametrize("acting", ["attackers", "defenders"])
def test_the_environment_passes_pettingzoos_own_tests(acting: str) -> None:
    tests = pytest.importorskip("pettingzoo.test")
    from examples.pettingzoo_env.swarm_env import SwarmEnv

    def make() -> Any:
        return SwarmEnv("unicycles", acting, every=0.02, overrides={"duration": 0.06})

    tests.parallel_api_test(make(), num_cycles=5)
    tests.parallel_seed_test(make, num_cycles=5)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "library"), [("orca:Orca", "pyrvo"), ("cbfpy_barriers:CbfPy", "cbfpy")]
)
def test_a_controller_by_a_library_runs(name: str, library: str) -> None:
    pytest.importorskip(library)
    overrides = {
        "duration": 0.2,
        "time.timeout": 120.0,  # cbfpy compiles
        "safety.function.radius": 1.01,
        "agents.0.controller.type": f"examples.controllers.{name}",
    }
    run = phalanx.run(phalanx.load("unicycles", overrides), engine="in-process")
    assert run.verdict == "guaranteed"
    assert run.metrics["input_deviation_mean"][0] > 0.0


EXAMPLE = Path(__file__).parents[2] / "examples" / "follow_run.py"
RUN = ["--scenario", "stale-inputs", "--run", "r1", "--set", "duration=0.5"]


def start(*command: object) -> subprocess.Popen[str]:
    """A Python program whose output can be read."""
    words = [sys.executable, *map(str, command)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, text=True)


@pytest.mark.nightly
@pytest.mark.swarm
def test_it_prints_the_runs_frames(tmp_path, monkeypatch):
    monkeypatch.setenv("PHALANX_SECRET", "s")
    endpoint = free_endpoint()
    follower = start(EXAMPLE, endpoint, "r1")
    paced = ("--listen", endpoint, "--folder", tmp_path, "--speed", 0.5)
    plant = start("-m", "phalanx", "plant", *RUN, *paced)
    assert follower.stdout.readline() == "following run r1\n"
    names = ["1", "2"]
    agents = [start("-m", "phalanx", "agent", n, *RUN, "--connect", endpoint) for n in names]
    printed, _ = follower.communicate(timeout=60)
    assert [plant.wait(30), *[agent.wait(30) for agent in agents]] == [0, 0, 0]
    *frames, last = printed.splitlines()
    assert last == "the run is over"
    line = re.compile(r"t ([\d.]+) s  h_tot -?[\d.]+  largest h -?[\d.]+")
    times = [float(line.fullmatch(frame)[1]) for frame in frames]
    assert times == sorted(times)
    assert len(times) > 5
    assert times[-1] <= 0.5


SBATCH = """#!/bin/sh
setsid sh "$1" >>{log} 2>&1 &
echo "Submitted batch job $$"
"""
SCANCEL = """#!/bin/sh
"""


@pytest.mark.nightly
def test_the_example_for_slurm_runs_where_its_commands_are(tmp_path):
    """The commands of Slurm alone are stand-ins: they start a job's script here."""
    pytest.importorskip("dask_jobqueue")
    for name, text in {"sbatch": SBATCH.format(log=tmp_path / "log"), "scancel": SCANCEL}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    example = Path(__file__).parents[3] / "examples" / "study_on_slurm.py"
    process = subprocess.run(
        [sys.executable, example, "4", "2"],
        cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert len(phalanx.open_study(tmp_path / "studies" / "slurm").frame) == 12
