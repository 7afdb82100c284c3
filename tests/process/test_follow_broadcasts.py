"""A script that knows zenoh, msgpack and docs/wire.md alone follows a live run."""

import json
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from phalanx.wire.session import free_endpoint

EXAMPLE = Path(__file__).parents[2] / "examples" / "follow_broadcasts.py"
RUN = ["--scenario", "stale-inputs", "--run", "r1", "--set", "duration=0.5"]


def start(*command: object) -> subprocess.Popen[str]:
    """A Python program whose output can be read."""
    words = [sys.executable, *map(str, command)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, text=True)


@pytest.mark.nightly
@pytest.mark.swarm
def test_it_prints_every_broadcast(tmp_path, monkeypatch):
    monkeypatch.setenv("PHALANX_SECRET", "s")
    endpoint = free_endpoint()
    follower = start(EXAMPLE, endpoint, "r1")
    plant = start("-m", "phalanx", "plant", *RUN, "--listen", endpoint, "--folder", tmp_path)
    # No agent comes before it listens, so it cannot miss the first broadcast.
    assert follower.stdout.readline() == "following run r1\n"
    names = ["1", "2"]
    agents = [start("-m", "phalanx", "agent", n, *RUN, "--connect", endpoint) for n in names]
    printed, _ = follower.communicate(timeout=60)
    assert [plant.wait(30), *[agent.wait(30) for agent in agents]] == [0, 0, 0]
    *broadcasts, last = printed.splitlines()
    assert last == "the run is over"
    line = re.compile(r"agent (\d) to \d  k (\d+)  from ([\d.]+) s  u \[.+\]")
    of = [line.fullmatch(broadcast) for broadcast in broadcasts]
    for name in names:
        numbers = [int(found[2]) for found in of if found[1] == name]
        assert numbers == list(range(len(numbers)))
    counted = Counter(found[1] for found in of)
    assert sum(counted.values()) == json.loads((tmp_path / "summary.json").read_text())["steps"]
    assert set(counted) == set(names)
