"""Every example does what its first line says, when it is run from another folder."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
MOST_LINES = 60
SAYS = {
    "commands.py": "agent 2 killed",
    "first_run.py": "h_tot",
    "own_law.py": "guaranteed - largest h -",
    "plot.py": "worst pair",
    "step_by_step.py": "the same bits: True",
    "study.py": "worst h_tot",
    "train_attacker.py": "trained: largest h",
    "verify.py": "bit-identical",
}
"""What each prints at least."""
SHORT = {"train_attacker.py": ["1"]}
"""Arguments that make one short."""
WITH_A_TEST_OF_ITS_OWN = {"follow_broadcasts.py", "study_on_slurm.py"}


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
    command = [sys.executable, EXAMPLES / name, *SHORT.get(name, [])]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert SAYS[name] in done.stdout
    assert "Traceback" not in done.stderr
