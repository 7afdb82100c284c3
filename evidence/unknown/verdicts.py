"""Verdicts and costs of each information when an agent is hijacked, or lies while it attacks.

python evidence/unknown/verdicts.py --seeds 50 --out FOLDER

Each scenario is a study in a folder of its own, which goes on where it ended. --only NAME runs one,
--table prints what there is: of each cell the runs, and how many of them ended safe (guaranteed or
not) and guaranteed. Pairs without a remaining normal agent do not count. Lies leave the inputs of
`split`, `worst-case` and `unknown` as they are, so their row is that of a hijack at that time.
"""

import argparse
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl
from phalanx_studies.row import json_text

import phalanx

INFORMATION = ("paper", "in-flight", "split", "worst-case", "unknown")
BELIEVES = ("paper", "in-flight")
"""Who uses what others announce: the inputs of all others are the same for each lie."""
LIES: Mapping[str, Mapping[str, Any]] = {
    "opposite": {"says": "opposite"},
    "zero": {"says": "zero"},
    "equivocate": {"equivocate": True},
    "replay": {"replay": 20},
    "late": {"apply_time": 0.5},
    "silent": {"silent": True},
}
"""By name, what an agent broadcasts that attacks; late: as a share of its period."""


class Case(NamedTuple):
    """A scenario of the study."""

    scenario: str
    duration: float
    """[s]"""
    agent: str
    """Who is hijacked."""
    instants: tuple[float, ...] = ()
    """When [s]; lies begin at the first one."""
    period: float = 0.0
    """Sampling period of agents [s]."""

    def attacks(self) -> Iterator[tuple[str, list[dict[str, Any]]]]:
        """Yield each attack's name and faults; none: declared adversaries alone."""
        yield "declared", []
        for at in self.instants:
            yield f"hijack at {at:g} s", [{"kind": "hijack", "at": at, "agents": [self.agent]}]
        for name, lie in LIES.items() if self.instants else ():
            at = self.instants[0]
            fields = {k: v * self.period if k == "apply_time" else v for k, v in lie.items()}
            turn = {"kind": "turn", "at": at, "agents": [self.agent]}
            yield (
                name,
                [
                    turn,
                    {"kind": "lie", "agent": self.agent, "at": at, "for": self.duration, **fields},
                ],
            )

    def points(self) -> Iterator[dict[str, Any]]:
        """Yield the fields of each point of the study."""
        pairwise = phalanx.load(self.scenario).safety.pairwise
        for information, prove in itertools.product(INFORMATION, (False, True)):
            if information == "split" and not pairwise:
                continue
            for name, faults in self.attacks():
                if name not in LIES or (information in BELIEVES and not prove):
                    yield fields(information, prove, faults)


def fields(information: str, prove: bool, faults: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the fields of a point of a study."""
    return {"safety.information": information, "safety.prove": prove, "faults": faults}


CASES = (
    Case("unicycles", 16.0, "2", (3.0, 6.0, 9.0), 0.01),
    Case("guaranteed", 7.0, "2", (3.0, 2.0, 4.0), 0.01),
    Case("formation3d", 22.0, "1", (10.0, 5.0, 15.0), 0.07),
    Case("formation3d-distance", 22.0, "1", (10.0, 5.0, 15.0), 0.07),
    Case("swarm", 5.0, "2", (2.0, 1.0, 3.0), 0.07),
    Case("crossing", 18.0, "south"),
)


def main() -> None:
    """Run what is missing, or print the tables."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=50)
    arguments.add_argument("--out", type=Path, required=True)
    arguments.add_argument("--workers", type=int, default=None)
    arguments.add_argument("--only", choices=[case.scenario for case in CASES])
    arguments.add_argument("--attacks", nargs="*", type=int, help="places; by default all")
    arguments.add_argument("--unproved", action="store_true", help="without safety.prove alone")
    arguments.add_argument("--table", action="store_true")
    options = arguments.parse_args()
    for case in CASES:
        if options.only in (None, case.scenario):
            folder = options.out / case.scenario
            if not options.table:
                run(case, folder, options)
            elif folder.exists():
                print_tables(case, kept_rows(folder))


def run(case: Case, folder: Path, options: argparse.Namespace) -> None:
    """Run what is missing of a scenario's study."""
    attacks = [faults for _, faults in case.attacks()]
    chosen = attacks if options.attacks is None else [attacks[place] for place in options.attacks]
    points = [
        point
        for point in case.points()
        if point["faults"] in chosen and not (options.unproved and point["safety.prove"])
    ]
    phalanx.study(
        case.scenario,
        seeds=options.seeds,
        points=points,
        overrides={"duration": case.duration},
        out=folder,
        workers=options.workers,
        progress=True,
    )


def kept_rows(folder: Path) -> pl.DataFrame:
    """Return the rows of a study that ended, also of another version of Phalanx."""
    return pl.read_parquet(folder / "rows.parquet")


def cells(case: Case, rows: pl.DataFrame) -> dict[tuple[str, bool, str], pl.DataFrame]:
    """Return the newest rows by information, whether inputs are proven, and attack."""
    latest = rows.unique(["overrides", "seed"], keep="last").filter(pl.col("outcome") != "broken")
    return {
        (information, prove, attack): latest.filter(
            pl.col("overrides") == json_text({"duration": case.duration, **point})
        )
        for information, prove in itertools.product(INFORMATION, (False, True))
        for attack, faults in case.attacks()
        for point in [fields(information, prove, faults)]
    }


def print_tables(case: Case, rows: pl.DataFrame) -> None:
    """Print the verdicts, and what runs without a hijack cost."""
    cells_of = cells(case, rows)
    attacks = [attack for attack, _ in case.attacks()]
    columns = [
        a for a in attacks if any(len(cell) for key, cell in cells_of.items() if key[2] == a)
    ]
    print(f"\n`{case.scenario}`, {case.duration:g} s:\n")
    costs = ("‖u - u_nom‖", "empty K_i", "tracking error [m]", "arrived, at [s]")
    print("| information | " + " | ".join([*columns, *costs]) + " |")
    print("|---" * (1 + len(columns) + len(costs)) + "|")
    for information, prove in itertools.product(INFORMATION, (False, True)):
        of = [cells_of[information, prove, attack] for attack in columns]
        if any(len(cell) for cell in of):
            name = f"`{information}`" + (", `prove`" if prove else "")
            cost = cost_of(cells_of[information, prove, "declared"], case)
            print(f"| {name} | " + " | ".join([*map(verdicts, of), *cost]) + " |")


def verdicts(cell: pl.DataFrame) -> str:
    """Return how many runs there are, and if not all were guaranteed how many were, and safe."""
    if not len(cell):
        return ""
    counts = {
        each: cell.filter(pl.col("outcome") == each).height for each in ("safe", "guaranteed")
    }
    guaranteed = counts["guaranteed"]
    words = "" if guaranteed == len(cell) else f": {sum(counts.values())}, {guaranteed}"
    return f"{len(cell)}{words}"


def cost_of(cell: pl.DataFrame, case: Case) -> list[str]:
    """Return the cost of runs without an attack, and the share of time without a QP's solution."""
    if not len(cell):
        return [""] * 4
    named = phalanx.load(case.scenario).named()
    normal = sum(len(group.names) for group in named if group.role == "normal")
    backup, without, deviation, error = (
        cell[name].to_numpy().mean()
        for name in (
            "backup_time",
            "no_authority_time",
            "input_deviation_mean",
            "tracking_error_mean",
        )
    )
    empty = (backup + without) / (normal * case.duration)
    times = cell["arrival_time"].drop_nulls().to_numpy()
    arrived = f"{len(times)} of {len(cell)}" + (f", {times.mean():.2f}" if len(times) else "")
    return [f"{deviation:.3f}", f"{100.0 * empty:.1f} %", f"{error:.2f}", arrived]


if __name__ == "__main__":
    main()
