"""Measure runs by CasADi's interpreter and by machine code, in turns, in CPU time.

    python bench/speed/machine_code.py [unicycles formation3d swarm swarm:64] [--rounds 5]

swarm:64 is a swarm of 64 agents. Each run is an in-process one in a process of its own; its CPU
time is that of a step, and of all before the first one. --python NAME=path adds another checkout,
by its Python, without machine code. The ratio is the median of the rounds' own, to the last column.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from typing import NamedTuple

from phalanx.native.library import COMPILER, FOLDER

RUN = """
import json, sys, time
import phalanx
from phalanx.launcher.simulation import Simulation
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx_plant.clock.lockstep import Lockstep

class Forgotten:
    def write(self, *records):
        pass

def run(clock, duration):
    times.append(time.process_time())
    original(clock, duration)
    times.append(time.process_time())

name, overrides = json.loads(sys.argv[1])
original, Lockstep.run = Lockstep.run, run
times = [time.process_time()]
rows = require_runnable(build_swarm(phalanx.load(name, overrides)))
compile_rows(rows)
summary = Simulation(rows, Forgotten()).run()
began, started, ended = times
print(json.dumps([(ended - started) / summary.steps, started - began, summary.trajectory]))
"""


def main() -> None:
    """Measure every scenario and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument(
        "scenarios",
        nargs="*",
        default=["unicycles", "formation3d", "swarm", "swarm:64", "swarm:128"],
    )
    arguments.add_argument("--rounds", type=int, default=5)
    arguments.add_argument("--steps", type=int, default=4000, help="of all agents in a run")
    arguments.add_argument("--python", action="append", default=[], help="NAME=path of another")
    options = arguments.parse_args()
    others = dict(given.split("=", 1) for given in options.python)
    kinds = [*others, "interpreter", "machine code"]
    cells = [f"{kind}: step, start [µs, s]" for kind in kinds]
    print("| scenario |", " | ".join([*cells, "step: ratios", "start: ratios"]), "| trajectory |")
    print("|---" * (4 + len(kinds)) + "|", flush=True)
    for name in options.scenarios:
        with tempfile.TemporaryDirectory() as cache:
            compiled = {COMPILER: "cc", FOLDER: cache}
            arguments_of = overridden(name, options.steps)
            prepare(*arguments_of, compiled)
            rounds = [
                [
                    measured(others.get(kind, sys.executable), arguments_of, environment)
                    for kind, environment in zip(
                        kinds, [{COMPILER: ""}] * (len(kinds) - 1) + [compiled], strict=True
                    )
                ]
                for _ in range(options.rounds)
            ]
        print(line(name, rounds), flush=True)


class Run(NamedTuple):
    """One run."""

    times: tuple[float, float]
    """CPU time of a step, and of the start [s]."""
    trajectory: str


def line(name: str, rounds: list[list[Run]]) -> str:
    """Make one line of the table."""
    medians = [
        [statistics.median(run.times[k] for run in kind) for k in (0, 1)]
        for kind in zip(*rounds, strict=True)
    ]
    cells = [f"{step * 1e6:.0f}, {start:.2f}" for step, start in medians]
    ratios = [
        " ".join(
            f"{statistics.median(each[n].times[k] / each[-1].times[k] for each in rounds):.2f}"
            for n in range(len(rounds[0]) - 1)
        )
        for k in (0, 1)
    ]
    same = "same" if len({run.trajectory for each in rounds for run in each}) == 1 else "DIFFERENT"
    return f"| {name} | {' | '.join([*cells, *ratios])} | {same} |"


def overridden(name: str, steps: int) -> tuple[str, dict[str, float]]:
    """Return the scenario's name and overrides, with about so many steps of all agents."""
    import phalanx

    scenario, _, size = name.partition(":")
    overrides: dict[str, float] = {}
    if size:
        adversaries = max(1, int(size) // 8)
        overrides |= {"agents.0.count": int(size) - adversaries, "agents.1.count": adversaries}
    loaded = phalanx.load(scenario, overrides)
    rate = sum(group.size / group.clock.period for group in loaded.agents)
    return scenario, {**overrides, "duration": min(steps / rate, loaded.duration)}


def prepare(name: str, overrides: Mapping[str, float], environment: Mapping[str, str]) -> None:
    """Fill the cache."""
    changes = [part for path, value in overrides.items() for part in ("--set", f"{path}={value}")]
    command = [sys.executable, "-m", "phalanx", "compile", name, *changes]
    subprocess.run(command, env={**os.environ, **environment}, check=True, capture_output=True)


def measured(
    python: str, arguments: tuple[str, dict[str, float]], environment: Mapping[str, str]
) -> Run:
    """Run once in a process of its own."""
    answer = subprocess.run(
        [python, "-P", "-c", RUN, json.dumps(arguments)],
        env={**os.environ, **environment},
        capture_output=True,
        check=True,
    )
    step, start, trajectory = json.loads(answer.stdout)
    return Run((step, start), trajectory)


if __name__ == "__main__":
    main()
