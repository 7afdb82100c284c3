"""Verdicts of both simulations over thousands of seeds, with the exact interval of their rates.

python evidence/paper/flagship.py simulation-1 --seeds 10000 --jobs 2
python evidence/paper/flagship.py simulation-2 --seeds 1000 --jobs 2

Runs are native: the bits of a networked run. Each has a line under build/bench, and what is there
is not run again. The counts are written to rates.json and into the pages of both simulations.
"""

import argparse
import multiprocessing
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import msgspec
from phalanx_studies.statistics import clopper_pearson

import phalanx
from phalanx.launcher.engine import RunOptions
from phalanx.native.loop.engine import NativeSimulation, compiled_rows, compiled_run
from phalanx.swarm.runnable import shared_rows

RATES = Path(__file__).with_name("rates.json")
JOURNALS = Path("build/bench/flagship")
SCENARIOS = {
    "simulation-1": ("unicycles", {"safety.information": "paper"}),
    "simulation-2": ("formation3d", {}),
}
SEEDS_AT_ONCE, GUARANTEED = 20, "guaranteed"


TITLE = "## Many seeds"


class Line(NamedTuple):
    """The result of one seed."""

    seed: int
    outcome: str
    worst_h: float
    shortest: float
    """The shortest proven time of an input, in τ."""
    trajectory: str
    """Hash of the trajectory."""


def lines(name: str, seeds: Iterable[int]) -> list[Line]:
    """Run seeds natively."""
    return [line(name, seed) for seed in seeds]


def line(name: str, seed: int) -> Line:
    """Run one seed natively; a function that is not compiled is an error."""
    scenario, overrides = SCENARIOS[name]
    run = compiled_run(shared_rows(phalanx.load(scenario, overrides, seed)))
    assert run is not None, "compiled before"
    summary = NativeSimulation(run, None, RunOptions("native")).run()
    shortest = summary.certificates.shortest or 0.0
    return Line(seed, str(summary.outcome), summary.worst_h, shortest, summary.trajectory)


def journal(name: str) -> Path:
    """Return the file with a line for each seed."""
    return JOURNALS / f"{name}.jsonl"


def read(name: str) -> list[Line]:
    """Return the lines that are there, by seed."""
    path = journal(name)
    text = path.read_bytes().splitlines() if path.exists() else []
    return sorted(msgspec.json.decode(each, type=Line) for each in text)


def run(name: str, seeds: int, jobs: int) -> None:
    """Run the seeds from 0 on that are missing."""
    scenario, overrides = SCENARIOS[name]
    compiled_rows(phalanx.load(scenario, overrides))
    JOURNALS.mkdir(parents=True, exist_ok=True)
    missing = sorted(set(range(seeds)) - {each.seed for each in read(name)})
    parts = [missing[k : k + SEEDS_AT_ONCE] for k in range(0, len(missing), SEEDS_AT_ONCE)]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=spawn) as pool, journal(name).open("ab") as file:
        for part in pool.map(lines, [name] * len(parts), parts):
            file.write(b"".join(msgspec.json.encode(each) + b"\n" for each in part))
            file.flush()


def write_rates(name: str) -> None:
    """Write the counts of a simulation's runs to RATES."""
    results = read(name)
    rates = msgspec.json.decode(RATES.read_bytes()) if RATES.exists() else {}
    rates[name] = {
        "seeds": [results[0].seed, results[-1].seed],
        "runs": len(results),
        "verdicts": dict(sorted(Counter(each.outcome for each in results).items())),
        "worst_h": max(each.worst_h for each in results),
        "shortest": min(each.shortest for each in results),
        "others": {str(each.seed): each.outcome for each in results if each.outcome != GUARANTEED},
    }
    RATES.write_bytes(msgspec.json.format(msgspec.json.encode(dict(sorted(rates.items())))) + b"\n")


def section(name: str) -> list[str]:
    """Return the lines of a page about many seeds; none if none were run."""
    rates = msgspec.json.decode(RATES.read_bytes()).get(name) if RATES.exists() else None
    if rates is None:
        return []
    runs, guaranteed = rates["runs"], rates["verdicts"].get(GUARANTEED, 0)
    low, high = clopper_pearson(runs - guaranteed, runs)
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in rates["verdicts"].items())
    violated = rates["verdicts"].get("violated", 0)
    least, most = clopper_pearson(violated, runs)
    others = ", ".join(f"seed {seed} {outcome}" for seed, outcome in rates["others"].items())
    command = f"`phalanx run {SCENARIOS[name][0]} --seed SEED`"
    return [
        TITLE,
        "",
        f"`python evidence/paper/flagship.py {name}` runs seeds {rates['seeds'][0]} to "
        f"{rates['seeds'][1]} with the [native engine](speed.md#the-native-engine): {runs} runs, "
        f"{verdicts}. The exact interval (Clopper and Pearson, 95 %) of the rate of runs that are "
        f"not guaranteed is {low:.3%} to {high:.3%}, of violated ones {least:.3%} to {most:.3%}. "
        f"The largest h of all is {rates['worst_h']:.4g}, the shortest proven time of an input "
        f"{rates['shortest']:.2f} τ."
        + (f" Not guaranteed: {others}; {command} repeats one, with any engine." if others else ""),
        "",
    ]


def main() -> None:
    """Run, and write the counts."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("name", choices=SCENARIOS)
    arguments.add_argument("--seeds", type=int, default=10_000, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--jobs", type=int, default=1, help="processes side by side")
    options = arguments.parse_args()
    run(options.name, options.seeds, options.jobs)
    write_rates(options.name)
    page = Path(f"docs/{options.name}.md")
    before = page.read_text("utf-8").partition(TITLE)[0]
    page.write_text(before.rstrip() + "\n\n" + "\n".join(section(options.name)), "utf-8")


if __name__ == "__main__":
    main()
