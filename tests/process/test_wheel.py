"""What is installed: a wheel that works beside files named like our programs, and brings it all."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
COLLIDING = ("agent.py", "plant.py", "viewer.py", "scenarios.py", "launcher.py")

pytestmark = pytest.mark.swarm


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel's contents in a folder of their own."""
    folder = tmp_path_factory.mktemp("installed")
    wheels = tmp_path_factory.mktemp("wheels")
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", wheels, ROOT], check=True)
    (wheel,) = wheels.glob("*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--target", folder, wheel], check=True)
    return folder


@pytest.fixture
def elsewhere(installed: Path, tmp_path: Path) -> dict:
    """Options of a process whose working folder has files named like our programs."""
    for name in COLLIDING:
        (tmp_path / name).write_text("raise ImportError('a user's own file was imported')")
    (tmp_path / "scenarios").mkdir()
    return {
        "cwd": tmp_path,
        "env": {**os.environ, "PYTHONPATH": str(installed)},
        "capture_output": True,
        "text": True,
        "timeout": 170,
    }


def test_the_command_runs_beside_files_named_like_its_programs(elsewhere: dict) -> None:
    command = ["run", "unicycles", "--set", "duration=0.5"]
    done = subprocess.run([sys.executable, "-m", "phalanx", *command], **elsewhere)
    assert done.returncode == 0, done.stderr
    assert "guaranteed:" in done.stdout
    assert (elsewhere["cwd"] / "runs" / "unicycles-1" / "report.html").is_file()


def test_readme_snippet_runs_from_the_wheel(installed: Path, elsewhere: dict) -> None:
    text = (ROOT / "README.md").read_text()
    snippet = text.split("```python\n")[1].split("```")[0]
    script = elsewhere["cwd"] / "snippet.py"
    script.write_text(f"{snippet}\nprint(phalanx.__file__)\n")
    done = subprocess.run([sys.executable, script], **elsewhere)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().splitlines()[-1] == str(installed / "phalanx" / "__init__.py")


def test_an_export_is_made_by_what_the_wheel_brings(elsewhere: dict) -> None:
    phalanx = [sys.executable, "-m", "phalanx"]
    run = [*phalanx, "run", "pinned", "--engine", "in-process", "--no-report"]
    assert subprocess.run(run, **elsewhere).returncode == 2
    export = [*phalanx, "export", "runs/pinned-1", "--png", "pinned.png", "--html", "pinned.html"]
    done = subprocess.run(export, **elsewhere)
    assert done.returncode == 0, done.stderr
    assert (elsewhere["cwd"] / "pinned.png").stat().st_size > 5_000
    assert (elsewhere["cwd"] / "pinned.html").stat().st_size > 50_000
