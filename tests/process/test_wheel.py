"""The wheel: complete, and working in a folder with files named like our programs."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from phalanx import __version__

ROOT = Path(__file__).parents[2]
EXTENSION = ROOT / "examples" / "extension"
COLLIDING = ("agent.py", "plant.py", "viewer.py", "scenarios.py", "launcher.py")

REPOSITORY = "https://example.org/owner/phalanx"
RELEASED = {"PHALANX_REPOSITORY": REPOSITORY}

_LONGEST = 900
"""Of one command on a busy machine [s]: the README's snippet runs a whole simulation."""

pytestmark = [pytest.mark.swarm, pytest.mark.nightly, pytest.mark.timeout(_LONGEST + 60)]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel's contents in a folder of their own."""
    return install(ROOT, tmp_path_factory)


@pytest.fixture(scope="module")
def extension(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel's contents of the example of an extension, likewise."""
    copy = tmp_path_factory.mktemp("source") / "extension"
    return install(shutil.copytree(EXTENSION, copy), tmp_path_factory)


def install(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a wheel and install it in a folder of its own."""
    folder = tmp_path_factory.mktemp("installed")
    wheels = tmp_path_factory.mktemp("wheels")
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", wheels, source], check=True)
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
        "timeout": _LONGEST,
    }


def phalanx(options: dict, *words: object, status: int = 0) -> subprocess.CompletedProcess[str]:
    """Run a command, which ends with this status."""
    ended = subprocess.run([sys.executable, "-m", "phalanx", *map(str, words)], **options)
    assert ended.returncode == status, ended.stderr
    return ended


def test_the_command_runs_next_to_files_named_like_its_programs(elsewhere: dict) -> None:
    done = phalanx(elsewhere, "run", "unicycles", "--set", "duration=0.5")
    assert "guaranteed:" in done.stdout
    assert (elsewhere["cwd"] / "runs" / "unicycles-1" / "report.html").is_file()


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel and the sdist of a release."""
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "hatchling", "build", "--directory", folder]
    subprocess.run(build, cwd=ROOT, env={**os.environ, **RELEASED}, check=True)
    return folder


def test_the_sdist_builds_the_same_wheel(built: Path, tmp_path: Path) -> None:
    (sdist,), (wheel,) = built.glob("*.tar.gz"), built.glob("*.whl")
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run(
        [*pip, "--wheel-dir", tmp_path, sdist], env={**os.environ, **RELEASED}, check=True
    )
    assert (tmp_path / wheel.name).read_bytes() == wheel.read_bytes()
    assert sdist.name == f"phalanx_swarm-{__version__}.tar.gz"


def test_links_of_the_description_lead_to_files_of_the_tag(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("/METADATA"))
        metadata = archive.read(name).decode()
    description = metadata.partition("\n\n")[2]
    links = re.findall(r'\]\(([^)\s]+)\)|src="([^"]+)"', description)
    targets = ["".join(pair) for pair in links]
    assert all(target.startswith("https://") for target in targets)
    tag = f"v{__version__}/"
    own = [target.partition(tag)[2] for target in targets if target.startswith(REPOSITORY)]
    assert "docs/images/radio.webp" in own
    assert len(own) > 10
    assert [path for path in own if not (ROOT / path).is_file()] == []


def test_readme_snippet_runs_from_the_wheel(installed: Path, elsewhere: dict) -> None:
    text = (ROOT / "README.md").read_text()
    snippet = text.split("```python\n")[1].split("```")[0]
    script = elsewhere["cwd"] / "snippet.py"
    script.write_text(f"{snippet}\nprint(phalanx.__file__)\n")
    process = subprocess.run([sys.executable, script], **elsewhere)
    assert process.returncode == 0, process.stderr
    assert process.stdout.strip().splitlines()[-1] == str(installed / "phalanx" / "__init__.py")


def test_an_export_is_made_by_what_the_wheel_brings(elsewhere: dict) -> None:
    phalanx(elsewhere, "run", "pinned", "--engine", "in-process", "--no-report", status=2)
    phalanx(elsewhere, "export", "runs/pinned-1", "--html", "pinned.html")
    assert (elsewhere["cwd"] / "pinned.html").stat().st_size > 50_000


@pytest.mark.parametrize("engine", ["in-process", "processes"])
def test_a_scenario_of_an_extension_runs_to_its_verdict_and_its_command_reads_the_run(
    extension: Path, elsewhere: dict, engine: str
) -> None:
    elsewhere["env"]["PYTHONPATH"] += f"{os.pathsep}{extension}"
    run = ("run", EXTENSION / "harbour.toml", "--engine", engine, "--no-report")
    assert "guaranteed:" in phalanx(elsewhere, *run).stdout
    other = {"in-process": "processes", "processes": "in-process"}[engine]
    phalanx(elsewhere, "verify", "runs/harbour-1", "--engine", other, "--trust")
    process = phalanx(elsewhere, "closest", "runs/harbour-1", "--trust")
    assert "east-west came closest: its largest h is -" in process.stdout
    refused = phalanx(elsewhere, "closest", "runs/harbour-1", status=3).stderr
    assert "harbour:" in refused
    assert "--trust" in refused
    assert len(refused.splitlines()) == 1


def test_a_check_of_an_extensions_scenario_claims_no_proof_of_its_margin(
    extension: Path, elsewhere: dict
) -> None:
    elsewhere["env"]["PYTHONPATH"] += f"{os.pathsep}{extension}"
    done = phalanx(elsewhere, "check", EXTENSION / "harbour.toml", "--trust")
    assert "nothing proves that the margin harbour:Wake is a bound" in " ".join(done.stdout.split())
