"""A study on a cluster in two network namespaces, while workers and the coordinator are killed.

    python evidence/studies/cluster.py --seeds 100

Needs root, /dev/net/tun and the extra dask. The rows are compared with those of the built-in pool.
"""

import argparse
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from pathlib import Path

import polars as pl

import phalanx
from phalanx.studies.plan import plan_from
from phalanx.studies.store import PLAN, plan_text
from tests.network.testbed import HERE, Testbed, opened

SCHEDULER = f"tcp://{HERE}:8786"
DASK = (sys.executable, "-m")
WORKER = (*DASK, "distributed.cli.dask_worker", SCHEDULER, "--nthreads", "1", "--no-nanny",
          "--no-dashboard")  # fmt: skip
_SAME = ("index", "seed", "network.loss", "outcome", "worst_h", "certified", "trajectory")


def main() -> None:
    """Run the study twice, and say whether the rows are equal."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=100, help="of each of two points")
    arguments.add_argument("--every", type=float, default=20.0, help="a worker is killed [s]")
    options = arguments.parse_args()
    plan = plan_from(
        {
            "scenario": "unicycles",
            "seeds": f"0:{options.seeds}",
            "overrides": {"duration": 1.0},
            "vary": {"network.loss": [0.0, 0.5]},
        }
    )
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "study")
        out.mkdir()
        (out / PLAN).write_text(plan_text(plan))
        with opened() as bed:
            starts, killed = coordinated(bed, out, options.every)
        there = phalanx.open_study(out)
        stored = pl.read_parquet(out / "rows.parquet")
        print(f"{plan.size} runs, {killed} workers killed, the coordinator started {starts} times")
        print(f"rows {len(there.frame)}, missing {there.missing}, outcomes {dict(there.outcomes)}")
        print(f"stored {len(stored)}, different keys {stored['key'].n_unique()}")
        here = phalanx.study(plan, confirm=0.0)
        same = there.frame.select(_SAME).equals(here.frame.select(_SAME))
        print("equal to the rows of the built-in pool" if same else "DIFFERENT from the pool's")


def coordinated(bed: Testbed, out: Path, every: float) -> tuple[int, int]:
    """Run the study to its end; return how often it was started, and the workers killed."""
    scheduler = bed.start(
        bed.here, *DASK, "distributed.cli.dask_scheduler", "--host", HERE,
        "--dashboard-address", ":0",
    )  # fmt: skip
    workers = deque(bed.start(place, *WORKER) for place in (bed.here, bed.there))
    hosts = deque((bed.here, bed.there))
    over, killed = threading.Event(), 0

    def kill_workers() -> None:
        nonlocal killed
        while not over.wait(every):
            end(workers.popleft())
            workers.append(bed.start(hosts[0], *WORKER))
            hosts.rotate()
            killed += 1

    killing = threading.Thread(target=kill_workers)
    killing.start()
    words = (
        *(sys.executable, "-m", "phalanx", "study", str(out / PLAN), "--out", str(out)),
        *("--dask", SCHEDULER, "--confirm", "0"),
    )
    first = bed.start(bed.here, *words)
    while rows_in(out) < 20:
        time.sleep(0.2)
    end(first)
    print(f"the coordinator was killed when {rows_in(out)} rows were there", flush=True)
    second = bed.start(bed.here, *words)
    output, _ = second.communicate()
    print(output)
    over.set()
    killing.join()
    for program in (*workers, scheduler):
        end(program)
    return 2, killed


def rows_in(folder: Path) -> int:
    """Return the number of rows in the journal, which has all until there are a thousand."""
    journal = folder / "rows.journal"
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


def end(program: "subprocess.Popen[str]") -> None:
    """Kill a program; `ip netns exec` has become it."""
    program.kill()
    program.wait()


if __name__ == "__main__":
    main()
