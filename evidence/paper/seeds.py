"""One simulation over many seeds, in variants: results that are kept, and lines made of them.

Every result is a file under build/bench, written as soon as it is there. What is there is not run
again, so that a command that was interrupted goes on, and variants can be run one by one; delete
the folder after a change that moves trajectories.
"""

import argparse
import multiprocessing
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import NamedTuple

import msgspec
from rich.console import Console
from rich.progress import track

import phalanx
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import EMPTY, Origin

KEPT = Path("build/bench")


class Variant(NamedTuple):
    """A scenario with overrides."""

    title: str
    scenario: str
    overrides: tuple[str, ...] = ()


class Result(msgspec.Struct):
    """The result of one run."""

    summary: Summary
    uncertified: float | None
    """Time of the first applied input that was not certified for τ [s]."""

    @property
    def warning(self) -> float | None:
        """Time between the first such input and the violation [s]; None without either."""
        if self.summary.outcome is not Outcome.VIOLATED or self.uncertified is None:
            return None
        return min(v.first for v in self.summary.violations) - self.uncertified


Results = dict[str, dict[int, Result]]
"""By variant, by seed."""


def command(name: str, variants: Mapping[str, Variant], page: Callable[[Results], str]) -> None:
    """Run the chosen variants and seeds, and write the page of all results that are kept.

    Args:
        name: of the page in docs/ and of the folder of results.
        variants: by short name.
        page: its text; results are in the order of variants and seeds.
    """
    arguments = argparse.ArgumentParser(description=f"{name} over many seeds")
    arguments.add_argument("--seeds", type=int, default=50, help="seeds 0 to SEEDS - 1")
    arguments.add_argument("--only", choices=variants, action="append", help="of the variants")
    arguments.add_argument("--jobs", type=int, default=1, help="processes side by side")
    arguments.add_argument("--out", type=Path, default=Path(f"docs/{name}.md"))
    options = arguments.parse_args()
    folder = KEPT / name
    folder.mkdir(parents=True, exist_ok=True)
    chosen = options.only or list(variants)
    jobs = [(path_of(folder, v, seed), v, seed) for seed in range(options.seeds) for v in chosen]
    missing = [job for job in jobs if not job[0].exists()]
    # A fork would share the state of libraries that start threads.
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=spawn) as pool:
        running = [pool.submit(keep, path, variants[v], seed) for path, v, seed in missing]
        completed = as_completed(running)
        for future in track(completed, "running", len(running), console=Console(stderr=True)):
            future.result()
    options.out.write_text(
        page(read_results(folder, variants, range(options.seeds))), encoding="utf-8"
    )


def path_of(folder: Path, variant: str, seed: int) -> Path:
    """File of a result."""
    return folder / f"{variant}-{seed}.json"


def keep(path: Path, variant: Variant, seed: int) -> None:
    """Run one seed of a variant and keep its result."""
    outcome = result(variant.scenario, variant.overrides, seed)
    unfinished = path.with_suffix(".part")
    unfinished.write_bytes(msgspec.json.encode(outcome))
    unfinished.rename(path)


def read_results(folder: Path, variants: Iterable[str], seeds: Iterable[int]) -> Results:
    """The results that are kept."""
    results: Results = {}
    for variant in variants:
        paths = {seed: path_of(folder, variant, seed) for seed in seeds}
        read = {
            seed: msgspec.json.decode(path.read_bytes(), type=Result)
            for seed, path in paths.items()
            if path.exists()
        }
        if read:
            results[variant] = read
    return results


def result(scenario: str, overrides: Sequence[str] = (), seed: int | None = None) -> Result:
    """Run a shipped scenario and return its result."""
    run = phalanx.run(phalanx.load(scenario, overrides, seed), engine="native")
    assert run.summary is not None
    swarm = build_swarm(run.recording.scenario)
    tau = {swarm.names[i]: swarm.horizon(i) for i in swarm.normal}
    uncertified = [
        step.t_apply
        for step in run.recording.steps
        if step.agent in tau and (step.certified or 0.0) < tau[step.agent]
    ]
    return Result(run.summary, min(uncertified, default=None))


def outcome(scenario: str, overrides: Sequence[str] = (), seed: int | None = None) -> Summary:
    """The same, its summary alone."""
    return result(scenario, overrides, seed).summary


CERTIFICATES = (
    "| variant | seeds | verdicts | samples certified for τ | shortest [τ] "
    "| first uncertified sample to violation [ms]: least, median, greatest "
    "| violations without warning |",
    "|---|---|---|---|---|---|---|",
)
"""Head of the table of certificates()."""

CERTIFICATES_NOTE = (
    "*Certified for τ*: inputs of normal agents that the [certificate](certificate.md) proves safe "
    "until that agent's next sample. *Shortest*: the shortest proven time of an input, in τ; at "
    "most 8 are tried."
)


def certificates(title: str, results: Mapping[int, Result]) -> str:
    """One line: verdicts and certificates of a variant."""
    runs = [each.summary for each in results.values()]
    counts = Counter(str(run.outcome) for run in runs)
    verdicts = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    proofs = [run.certificates for run in runs]
    samples, proven = sum(f.samples for f in proofs), sum(f.certified for f in proofs)
    shortest = min((f.shortest for f in proofs if f.shortest is not None), default=0.0)
    warnings = sorted(1e3 * r.warning for r in results.values() if r.warning is not None)
    late = counts[Outcome.VIOLATED] - sum(each > 0.0 for each in warnings)
    spread_of = (
        f"{warnings[0]:.0f}, {statistics.median(warnings):.0f}, {warnings[-1]:.0f}"
        if warnings
        else "-"
    )
    return (
        f"| {title} | {covered(results)} | {verdicts} | {proven} of {samples} "
        f"({proven / samples:.2%}) | {shortest:.2f} | {spread_of} "
        f"| {late if counts[Outcome.VIOLATED] else '-'} |"
    )


def covered(results: Iterable[int]) -> str:
    """The seeds that were run, in words."""
    seeds = sorted(results)
    whole = seeds == list(range(seeds[0], seeds[-1] + 1))
    return f"{seeds[0]} to {seeds[-1]}" if whole else f"{len(seeds)} of 0 to {seeds[-1]}"


def with_empty_set(run: Summary) -> float:
    """Share of normal agents' control steps whose QP had no solution."""
    return sum(run.origins.get(o, 0) for o in EMPTY) / sum(run.origins.values())


def with_authority(run: Summary) -> float:
    """Share of normal agents' control steps on the backup LP."""
    return run.origins[Origin.BACKUP] / sum(run.origins.values())


def spread(runs: Sequence[Summary], share: Callable[[Summary], float]) -> str:
    """Least, mean and greatest of a share over the runs."""
    shares = [share(run) for run in runs]
    return f"{min(shares):.1%}, {statistics.mean(shares):.1%}, {max(shares):.1%}"
