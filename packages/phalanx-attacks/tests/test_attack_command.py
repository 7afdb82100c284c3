"""`phalanx attack` in real processes: killed or with other workers, it ends with the same."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

import phalanx
from phalanx.scenario.load import scenario_text
from tests.process.runs import wait_for

from .weak_swarm import weak

pytestmark = pytest.mark.nightly

OPTIONS = ("--budget", "12", "--fresh", "1", "--batch", "6")


def command(folder: Path, workers: int) -> list[str]:
    words = ("attack", folder.parent / "weak.toml", *OPTIONS, "--out", folder)
    return [sys.executable, "-m", "phalanx", *map(str, words), "--workers", str(workers)]


def finds(folder: Path) -> list[tuple[str, str]]:
    """Return the name of each find, and the hash in its comment."""
    finds = []
    for path in sorted((folder / "found").glob("*.toml")):
        hashed = re.search(r"^# Trajectory: (\w+)$", path.read_text(), re.MULTILINE)
        finds.append((path.name, hashed[1]))
    return finds


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A whole search with one worker."""
    folder = tmp_path_factory.mktemp("attacks") / "whole"
    (folder.parent / "weak.toml").write_text(scenario_text(weak()))
    process = subprocess.run(command(folder, 1), capture_output=True, text=True)
    assert process.returncode == 2, process.stderr
    assert "violated" in process.stdout
    return folder


def test_a_find_repeats_to_its_hash_and_the_page_is_there(whole):
    name, trajectory = finds(whole)[0]
    assert phalanx.run(phalanx.load(whole / "found" / name)).summary.trajectory == trajectory
    assert (whole / "attack.html").stat().st_size > 10_000


def test_two_workers_find_the_same_as_one(whole):
    folder = whole.parent / "two"
    assert subprocess.run(command(folder, 2), capture_output=True).returncode == 2
    assert finds(folder) == finds(whole)


@pytest.mark.parametrize(
    ("number", "rows"), [(signal.SIGINT, 5), (signal.SIGTERM, 20), (signal.SIGKILL, 5)]
)
def test_a_killed_search_goes_on_where_it_was(whole, number, rows):
    """Random search has begun when there are 20 rows."""
    folder = whole.parent / number.name
    program = subprocess.Popen(command(folder, 1), stderr=subprocess.PIPE, text=True)
    journal = folder / "rows.journal"
    wait_for(lambda: journal.exists() and journal.read_bytes().count(b"\n") >= rows)
    workers = psutil.Process(program.pid).children(recursive=True)
    program.send_signal(number)
    assert program.wait() == (-number if number is signal.SIGKILL else 130)
    wait_for(lambda: not any(worker.is_running() for worker in workers))
    if number is not signal.SIGKILL:
        announced, *progress, stopped = filter(None, program.stderr.read().splitlines())
        assert announced.startswith("at most 12 runs by cma-es and 12 runs by random")
        assert re.fullmatch(r"cma-es .* 0/24 .*", progress[0])
        assert all("/24 " in line for line in progress)
        assert "the same command goes on" in stopped
        assert (folder / "attack.html").exists()
    program.stderr.close()
    assert subprocess.run(command(folder, 2), capture_output=True).returncode == 2
    assert finds(folder) == finds(whole)


def test_another_search_is_refused_in_one_line(whole):
    done = subprocess.run([*command(whole, 1), "--seed", "1"], capture_output=True, text=True)
    assert done.returncode == 64
    assert "take another folder" in " ".join(done.stderr.split())
