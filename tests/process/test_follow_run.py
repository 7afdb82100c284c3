"""A script that knows zenoh, msgpack and docs/wire.md alone follows a live run."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from phalanx.wire.session import free_endpoint

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
