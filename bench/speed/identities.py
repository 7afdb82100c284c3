"""What identities cost a step: a run as it is, and one whose hub lets everybody do everything.

    python bench/speed/identities.py --runs 5

with     each session shows a password, the hub holds every message against its rules, and each
         message is sealed with a key of the program that it is about
without  no passwords, no rules, and one key for all, which only tells damage

The two take turns; a step is a control step of one agent, start and end of the run left out.
"""

import argparse
import multiprocessing
import os
import secrets
import statistics
import tempfile
from multiprocessing.connection import Connection
from pathlib import Path
from unittest.mock import patch

from phalanx_plant.hub import session

import phalanx
from phalanx.faults.commands import NO_COMMANDS
from phalanx.guarantee.verdict import Summary, read_summary
from phalanx.launcher.fork_server import Order, serve
from phalanx.launcher.programs import Program
from phalanx.recording.records import SUMMARY
from phalanx.scenario.load import to_json
from phalanx.scenario.model import Scenario
from phalanx.wire.keys import PLANT
from phalanx.wire.membership import Membership
from phalanx.wire.seal import Sealer
from phalanx.wire.session import reserved_endpoint


def main() -> None:
    """Measure both in turns; print the medians and their ratio."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--runs", type=int, default=5)
    arguments.add_argument("--scenario", default="unicycles")
    options = arguments.parse_args()
    scenario = phalanx.load(options.scenario)
    steps: dict[str, list[float]] = {"with": [], "without": []}
    trajectories = set()
    for _ in range(options.runs):
        for which, times in steps.items():
            summary = run(scenario, identities=which == "with")
            times.append(summary.wall_time / summary.steps)
            trajectories.add(summary.trajectory)
    assert len(trajectories) == 1, "the runs were not the same"
    medians = {which: statistics.median(times) for which, times in steps.items()}
    for which, median in medians.items():
        print(f"{which:8} {1e6 * median:7.1f} µs a step ({1e6 * min(steps[which]):.1f} at best)")
    print(f"ratio    {medians['with'] / medians['without']:7.3f}")


def run(scenario: Scenario, identities: bool) -> Summary:
    """One run of processes."""
    context = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as parent, reserved_endpoint() as endpoint:
        folder = Path(parent) / "run"
        (folder / "logs").mkdir(parents=True)
        membership = Membership(folder.name, endpoint, secrets.token_bytes(16))
        ours, theirs = context.Pipe()
        programs = [Program(PLANT, PLANT, {"folder": folder, "policy": NO_COMMANDS})]
        programs += [Program("agent", name) for name in scenario.programs()]
        ours.send(Order(membership, programs, folder / "logs"))
        server = context.Process(target=_serve, args=(scenario, theirs, identities))
        server.start()
        theirs.close()
        server.join()
        ours.close()
        return read_summary((folder / SUMMARY).read_bytes())


def _serve(scenario: Scenario, launcher: Connection, identities: bool) -> None:
    if not identities:
        # In this process and those that it forks alone.
        patch.object(session, "admission", lambda *_: None).start()
        patch.object(Membership, "credentials", property(lambda _: None)).start()
        patch.object(Membership, "sealer", property(lambda _: Sealer())).start()
    _, unheard = multiprocessing.Pipe(duplex=False)
    serve(to_json(scenario), dict(os.environ), launcher, unheard)


if __name__ == "__main__":
    main()
