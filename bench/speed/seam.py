"""Compare the step of two checkouts in turns, in CPU time: before and after scenarios name worlds.

    git worktree add /tmp/before 571f147~1 && git worktree add /tmp/after 571f147
    python bench/speed/seam.py /tmp/before /tmp/after

Both run Simulation 1 in process with this Python, compiled beforehand. Compared are numbers of
calls, which load hardly changes, and the least CPU time of all rounds; trajectories have to agree.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

RUN = """
import sys, time
import phalanx
from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
rows = build_rows(build_swarm(phalanx.load("unicycles", ["duration=3.0"])))
calls = 0
def count(frame, event, of):
    global calls
    calls += event in ("call", "c_call")
Simulation(rows, RecordsInMemory()).run()
sys.setprofile(count)
Simulation(rows, RecordsInMemory()).run()
sys.setprofile(None)
print(calls)
for _ in range(4):
    begin = time.process_time()
    summary = Simulation(rows, RecordsInMemory()).run()
    print(time.process_time() - begin, summary.trajectory)
"""


class Runs(NamedTuple):
    """Some runs of one checkout."""

    calls: int
    """Of one run."""
    seconds: list[float]
    """CPU time of each other."""
    trajectory: str


def main() -> None:
    """Print the ratio after / before."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    rounds = [(runs(options.before), runs(options.after)) for _ in range(options.rounds)]
    before, after = zip(*rounds, strict=True)
    assert len({each.trajectory for each in (*before, *after)}) == 1
    print(f"trajectory of both: {before[0].trajectory[:12]}")
    print(f"calls, after / before: {after[0].calls / before[0].calls:.6f}")
    least = [min(s for each in some for s in each.seconds) for some in (before, after)]
    print(f"CPU time, after / before: {least[1] / least[0]:.3f}")


def runs(checkout: Path) -> Runs:
    """Run in a checkout."""
    folders = (checkout, checkout / "plant", checkout / "agent")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders))}
    done = subprocess.run(
        [sys.executable, "-c", RUN],
        cwd=checkout,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    calls, *lines = done.stdout.splitlines()
    words = [line.split() for line in lines]
    return Runs(int(calls), [float(seconds) for seconds, _ in words], words[0][1])


if __name__ == "__main__":
    main()
