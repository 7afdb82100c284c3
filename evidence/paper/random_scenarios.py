"""Random scenarios: is any pair above zero while it is certified, and does certify agree.

    python evidence/paper/random_scenarios.py [--first 0] [--count 2000] [--violations] [--index N]

Each scenario is drawn by its index: dynamics (q = 1 to 3), margins, compositions, information
models, faults, disturbances, attackers, obstacles. Its h is compared with the judge's certificates
at every integration step, and its recording is given to the checker. --index N prints one.
"""

import argparse
import itertools
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
from phalanx_certify.checker.certify import Certification, certify
from phalanx_certify.checker.intervals import UncertifiableError
from phalanx_plant import run as plant_run
from phalanx_plant.judge.judge import Judge, Judged
from phalanx_plant.world.events import Event, StateReached

from phalanx.faults.commands import Command, CommandKind, CommandPolicy, turns
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.engine import RunOptions, execute
from phalanx.network.draws import Draws
from phalanx.recording.read import read
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.scenario.safety import Composition
from phalanx.schema.built_in import BUILT_IN
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.margins.margin import Margin
from phalanx.theory.rows.information import Information

MODELS: dict[int, list[str]] = {
    1: ["single-integrator", "unicycle"],
    2: ["double-integrator", "examples.bicycles:Bicycle"],
    3: ["triple-integrator"],
}


class Chance:
    """One scenario's draws, one after another."""

    def __init__(self, index: int) -> None:
        self._draws = Draws(index, "random scenario")
        self._row = itertools.count()

    def uniform(self, low: float, high: float) -> float:
        """A number, rounded so that a scenario can be read."""
        share = float(self._draws[next(self._row)][0])
        return float(f"{low + (high - low) * share:.4g}")

    def scale(self, low: float, high: float) -> float:
        """A number whose logarithm is uniform."""
        return float(f"{np.exp(self.uniform(np.log(low), np.log(high))):.4g}")

    def of(self, choices: Sequence[Any]) -> Any:
        """One of these."""
        return choices[int(self._draws[next(self._row)][0] * len(choices))]

    def happens(self, probability: float) -> bool:
        """True that often."""
        return bool(self._draws[next(self._row)][0] < probability)


def random_scenario(index: int) -> tuple[dict[str, Any], CommandPolicy]:
    """The scenario with this index, as a table, and what is done to it."""
    chance = Chance(index)
    q = chance.of([1, 1, 2, 2, 3])
    planar = chance.happens(0.75)
    radius, duration = chance.uniform(0.5, 2.0), chance.uniform(1.0, 3.0)
    models = [m for m in MODELS[q] if planar or m not in ("unicycle", "examples.bicycles:Bicycle")]
    safety = _safety(chance, q, radius)
    counts = chance.of([1, 2, 3]), chance.of([0, 1, 1, 2])
    if small := q == 3 and safety["margin"] != "paper":  # others take minutes to compile
        counts = 1, 1
    positions = _positions(chance, sum(counts), radius, planar)
    reach = radius * chance.uniform(1.0, 3.0)
    agents: list[dict[str, Any]] = []
    begin = 0
    clock = _clock(chance)
    for role, count in zip(("normal", "adversary"), counts, strict=True):
        if not count:
            continue
        model = chance.of(models)
        names = [str(k) for k in range(begin, begin + count)]
        starts = [_state(chance, model, p) for p in positions[begin : begin + count]]
        agents.append(
            {
                "names": names,
                "role": role,
                "dynamics": _dynamics(chance, model, len(positions[0])),
                "law": _law(chance, role, q),
                "clock": clock if chance.happens(0.5) else _clock(chance),
                "disturbance": _disturbance(chance),
                "start": starts,
                "slots": list(range(begin, begin + count)) if role == "normal" else [],
            }
        )
        begin += count
    obstacles = [
        _obstacle(chance, radius, planar) for _ in range(chance.of([0, 1, 1 if small else 2]))
    ]
    quickest = min(a["clock"]["period"] - a["clock"]["jitter"] for a in agents)
    network: dict[str, Any] = {"loss": chance.of([0.0, 0.0, 0.3, 0.9])}
    network["delay"] = chance.of([0.0, 0.005, {"low": 0.0, "high": 0.1}])
    table = {
        "name": f"random-{index}",
        "duration": duration,
        "seed": index,
        "time": {"latency": chance.of([0.0, 0.0, 0.5 * quickest])},
        "safety": safety,
        "network": network,
        "formation": {
            "path": [[0.0] * len(positions[0]), [reach, *[0.0] * (len(positions[0]) - 1)]],
            "finish": duration,
            "radius": reach,
            "slots": sum(counts),
        },
        "obstacles": obstacles,
        "agents": agents,
    }
    return table, _commands(chance, duration, [n for a in agents for n in a["names"]])


def _positions(chance: Chance, count: int, radius: float, planar: bool) -> list[list[float]]:
    """Starts, most of them outside one another's radius."""
    size = 1.6 * radius * np.sqrt(count)
    positions: list[list[float]] = []
    for _ in range(count):
        for _attempt in range(30):
            p = [chance.uniform(-size, size) for _ in range(2 if planar else 3)]
            distances = [np.linalg.norm(np.subtract(p, other)) for other in positions]
            if min(distances, default=np.inf) > 1.3 * radius:
                break
        positions.append(p)
    return positions


def _state(chance: Chance, model: str, p: list[float]) -> list[float]:
    match model:
        case "unicycle":
            return [*p, chance.uniform(-3.1, 3.1)]
        case "examples.bicycles:Bicycle":
            return [*p, chance.uniform(-3.1, 3.1), chance.uniform(0.1, 1.0)]
        case "double-integrator":
            return [*p, *[chance.uniform(-0.5, 0.5) for _ in p]]
        case "triple-integrator":
            return [*p, *[chance.uniform(-0.3, 0.3) for _ in range(2 * len(p))]]
    return p


def _dynamics(chance: Chance, model: str, dimension: int) -> dict[str, Any]:
    table: dict[str, Any] = {"type": model}
    match model:
        case "single-integrator":
            table |= {"speed": chance.scale(0.5, 4.0), "dimension": dimension}
        case "unicycle":
            table |= {"speed": chance.scale(0.5, 4.0), "turn_rate": chance.scale(0.5, 4.0)}
            table |= {"offset": chance.uniform(0.1, 0.5)}
        case "double-integrator":
            table |= {"acceleration": chance.scale(0.5, 6.0), "dimension": dimension}
            table |= {"drag": chance.of([0.0, 0.5, 2.0])}
        case "examples.bicycles:Bicycle":
            table |= {"acceleration": chance.scale(0.5, 4.0), "steering": chance.uniform(0.2, 1.0)}
        case "triple-integrator":
            table |= {"jerk": chance.scale(1.0, 20.0), "dimension": dimension}
    return table


def _law(chance: Chance, role: str, q: int) -> dict[str, Any]:
    gains = [[1.0], [1.0, 2.0], [1.0, 3.0, 3.0]][q - 1]
    kinds = {
        "normal": ["track", *["track-velocity"] * (q == 1)],
        "adversary": ["worst", "chase", *["pursue"] * (q == 1)],
    }
    kind = chance.of(kinds[role])
    if kind in ("track", "chase"):
        return {"type": kind, "gains": gains}
    return {"type": kind}


def _clock(chance: Chance) -> dict[str, float]:
    period = chance.of([0.01, 0.02, 0.05])
    return {"period": period, "jitter": period * chance.of([0.0, 0.0, 0.2])}


def _disturbance(chance: Chance) -> dict[str, Any]:
    return {
        "bound": chance.of([0.0, 0.1, 0.5, 1.5]),
        "every": chance.of([0.05, 0.2]),
        "kind": chance.of(["random", "adverse"]),
    }


def _obstacle(chance: Chance, radius: float, planar: bool) -> dict[str, Any]:
    axes = 2 if planar else 3
    if chance.happens(0.3):
        normal = [chance.uniform(-1.0, 1.0) for _ in range(axes - 1)] + [1.0]
        return {"normal": normal, "offset": chance.uniform(3.0, 5.0) * radius, "clearance": 0.2}
    center = [chance.uniform(-4.0, 4.0) * radius for _ in range(axes)]
    return {"center": center, "clearance": 0.5 * radius}


def _safety(chance: Chance, q: int, radius: float) -> dict[str, Any]:
    centralised = chance.happens(0.1)
    composition = "lse" if centralised else chance.of(get_args(Composition))
    margin = chance.of(list(BUILT_IN[Margin])) if composition == "pairs" else "paper"
    information = chance.of(list(BUILT_IN[Information]))
    if composition == "lse" and information == "split":
        information = "worst-case"
    table: dict[str, Any] = {
        "function": {"type": "separation", "radius": radius},
        "rho": chance.scale(0.5, 10.0),
        "alpha": [chance.scale(0.5, 20.0) for _ in range(q)],
        "margin": margin,
        "composition": composition,
        "information": information,
        "control": "centralised" if centralised else "distributed",
    }
    if margin in ("paper", "corrected"):
        table |= {"eta": chance.of([0.0, 1.0, 8.0]), "xi": chance.of([0.0, 5.0])}
    if chance.happens(0.1):
        table["neighbourhood"] = 4.0 * radius
    return table


def _commands(chance: Chance, duration: float, names: Sequence[str]) -> CommandPolicy:
    if not chance.happens(0.3):
        return CommandPolicy()
    kinds = [
        CommandKind.FREEZE,
        CommandKind.KILL,
        CommandKind.TURN,
        CommandKind.LOSS,
        CommandKind.DELAY,
    ]
    kind, t = chance.of(kinds), chance.uniform(0.0, duration)
    if kind in (CommandKind.LOSS, CommandKind.DELAY):
        return CommandPolicy(schedule=(Command(t, kind, value=chance.uniform(0.0, 0.5)),))
    name = chance.of(names)
    commands = [Command(t, kind, name)]
    if kind == CommandKind.FREEZE and chance.happens(0.5):
        commands.append(Command(min(t + 0.2, duration), CommandKind.THAW, name))
    return CommandPolicy(schedule=tuple(commands))


class WatchingJudge(Judge):
    """A judge that compares h with its certificates at every integration step."""

    latest: "WatchingJudge"

    def __init__(self, rows: SafetyRows) -> None:
        super().__init__(rows)
        self.compared = 0
        """Pairs that were looked at while certified, step by step."""
        self.wrong: list[tuple[float, str, float]] = []
        """(t, pair, h) with h > 0 while certified."""
        WatchingJudge.latest = self

    def judge(self, events: Sequence[Event], judged: list[Judged]) -> None:
        """Judge the next events one by one."""
        for event in events:
            if isinstance(event, StateReached):
                self._compare(event)
            super().judge([event], judged)

    def _compare(self, event: StateReached) -> None:
        # The certificates in force until then.
        for steps in self.evaluation.of([event.history]):
            certified = self.coverage.ends[steps.pairs] >= steps.times[:, None]
            self.compared += int(certified.sum())
            for step, column in np.argwhere(certified & ~(steps.h <= 0.0)):
                at, h = float(steps.times[step]), float(steps.h[step, column])
                self.wrong.append((at, self.extremes.label(int(steps.pairs[column])), h))


@dataclass
class Result:
    """One run."""

    index: int
    summary: Summary
    compared: int
    wrong: list[tuple[float, str, float]]
    checked: Certification | str
    """Or why the checker refused the recording."""
    kind: str
    """q and margin."""
    beyond: str
    """What the judge has and the checker has not, where the checker found a gap."""

    @property
    def agreement(self) -> str:
        """Compare judge and checker; on a difference, name the pair without a certificate."""
        judged = self.summary.certificates.uncovered is None
        if isinstance(self.checked, str):
            return f"checker refuses ({self.checked}), judge {'yes' if judged else 'no'}"
        if judged == bool(self.checked):
            return "both certified" if judged else "neither certified"
        return f"judge alone: {self.beyond}" if judged else "checker alone"


def run(index: int, folder: Path) -> Result:
    """Run one scenario and have it checked. Raises ScenarioError."""
    table, policy = random_scenario(index)
    scenario = load(table)
    out = folder / str(index)
    out.mkdir()
    setattr(plant_run, "Judge", WatchingJudge)  # noqa: B010 - the run's own judge, but watched
    summary = execute(scenario, out, RunOptions("in-process", commands=policy))
    judge = WatchingJudge.latest
    recording = read(out)
    try:
        checked: Certification | str = certify(
            scenario,
            recording.states,
            recording.steps,
            turned=turns([name for name, _, _ in scenario.roster()], recording.commands),
        )
    except UncertifiableError as error:
        checked = " ".join(str(error).split(", at t")[0].split()[2:])
    kind = f"{len(scenario.safety.class_k)} | {scenario.safety.margin_name}"
    beyond = "it tries ψ_{q-1} too" if len(scenario.safety.class_k) > 1 else "other"
    return Result(index, summary, judge.compared, judge.wrong, checked, kind, beyond)


def main() -> None:
    """Run scenario after scenario and print the results."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--first", type=int, default=0, help="index of the first scenario")
    arguments.add_argument("--count", type=int, default=2000)
    arguments.add_argument("--index", type=int, help="print this scenario, and run it alone")
    options = arguments.parse_args()
    if options.index is not None:
        print(*random_scenario(options.index), sep="\n")
        options.first, options.count = options.index, 1
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    runs: list[Result] = []
    refused: Counter[str] = Counter()
    try:
        for index in range(options.first, options.first + options.count):
            with tempfile.TemporaryDirectory(prefix="phalanx-") as folder:
                try:
                    result = run(index, Path(folder))
                except ScenarioError as error:
                    refused[str(error).strip().splitlines()[-1].split(": ", 1)[-1][:90]] += 1
                    continue
            if result.summary.outcome is Outcome.STOPPED:
                break
            runs.append(result)
            print(index, result.summary.outcome, result.agreement, file=sys.stderr, flush=True)
            for t, pair, h in result.wrong[:3]:
                print(f"WRONG: {pair} at t = {t} s has h = {h}", file=sys.stderr, flush=True)
            if result.summary.outcome is Outcome.BROKEN or "alone" in result.agreement:
                print(f"  {result.summary.reason}; {result.checked}", file=sys.stderr, flush=True)
    finally:  # also if it is stopped
        report(runs, refused)


def report(runs: Sequence[Result], refused: Counter[str]) -> None:
    """The tables."""
    outcomes = [Outcome.GUARANTEED, Outcome.SAFE, Outcome.VIOLATED, Outcome.BROKEN]
    print(f"| q | margin | runs | {' | '.join(outcomes)} | above 0 while certified |")
    print("|---|---|---|---|---|---|---|---|")
    for kind in [*sorted({r.kind for r in runs}), "all | "]:
        some = [r for r in runs if kind in (r.kind, "all | ")]
        counts = Counter(r.summary.outcome for r in some)
        cells = " | ".join(str(counts[o]) for o in outcomes)
        print(f"| {kind} | {len(some)} | {cells} | {sum(bool(r.wrong) for r in some)} |")
    print(f"\n{sum(r.compared for r in runs)} h of certified pairs looked at.\n")
    print("| judge and checker | runs |\n|---|---|")
    for agreement, count in Counter(r.agreement for r in runs).most_common():
        print(f"| {agreement} | {count} |")
    print("\n| not run, for | scenarios |\n|---|---|")
    for reason, count in refused.most_common():
        print(f"| {reason} | {count} |")


if __name__ == "__main__":
    main()
