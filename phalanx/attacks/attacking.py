"""An attack as a scenario file: its smallest form, and its repetition."""

import math
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import phalanx
from phalanx.attacks.admissible import shortfall
from phalanx.attacks.robustness import Evaluation, evaluate_rows
from phalanx.attacks.shrinking import Fields, shrink, size_of
from phalanx.guarantee.verdict import Outcome, Violation
from phalanx.scenario.attack import Attack
from phalanx.scenario.load import ScenarioError, digest, read_table, scenario_text, validate
from phalanx.scenario.model import Scenario
from phalanx.swarm.runnable import shared_rows
from phalanx.swarm.swarm import Swarm, build_swarm

_VERDICT, _TRAJECTORY, _ATTACKED = "Verdict: ", "Trajectory: ", "Attacked: "


class Kind(NamedTuple):
    """Properties that a candidate must share with the attack that is shrunk."""

    roles: tuple[str, ...]
    """Of the first violating pair; "obstacle" for an obstacle or a limit."""
    apart: float
    """Least distance of adversaries from normal agents at the start [m]."""


class Shrunk(NamedTuple):
    """The smallest form of an attack."""

    table: Fields
    evaluation: Evaluation
    runs: int
    """Number of runs that it took."""
    sizes: tuple[int, int]
    """Number of values in the table, before and after."""


class _Candidates:
    """Runs candidates, each different one once."""

    def __init__(self, table: Fields) -> None:
        """Raises ScenarioError: the table is no scenario, or it is not violated."""
        scenario = validate(table, "attack")
        self.found: dict[str, float | None] = {}
        swarm, evaluation = _run(scenario)
        first = first_violation(evaluation)
        if first is None:
            reason = f"expected a violated run, got {evaluation.summary.outcome.value}"
            raise ScenarioError(f"{scenario.name}: {reason}")
        self.kind = Kind(_roles(swarm, first), math.floor(10.0 * _apart(swarm)) / 10.0)
        self.found[digest(scenario)] = first.first

    def __call__(self, table: Fields) -> float | None:
        """Return when a candidate fails in the same manner [s]; None if it does not."""
        try:
            scenario = validate(table, "candidate")
            key = digest(scenario)
            if key not in self.found:
                self.found[key] = self._failed(scenario)
            return self.found[key]
        except ScenarioError:
            return None

    def _failed(self, scenario: Scenario) -> float | None:
        if shortfall(build_swarm(scenario), Attack(apart=self.kind.apart))[0] > 0.0:
            return None
        swarm, evaluation = _run(scenario)
        first = first_violation(evaluation)
        same = first is not None and _roles(swarm, first) == self.kind.roles
        return first.first if first is not None and same else None


def smallest(table: Fields, origin: Fields) -> Shrunk:
    """Shrink an attack. Every step is a run, and the same attack gives the same result.

    Args:
        table: of the attack, as its file has it.
        origin: of the scenario attacked.

    Raises ScenarioError if the attack's run is not violated.
    """
    candidates = _Candidates(table)
    small = shrink(table, origin, candidates)
    _, evaluation = _run(validate(small, "attack"))
    return Shrunk(small, evaluation, len(candidates.found), (size_of(table), size_of(small)))


def first_violation(evaluation: Evaluation) -> Violation | None:
    """Return the violation that begins first; None if the run is not violated."""
    if evaluation.summary.outcome is not Outcome.VIOLATED:
        return None
    return min(evaluation.summary.violations, key=lambda each: each.first, default=None)


def attack_text(shrunk: Shrunk, attacked: str, command: str) -> str:
    """Return the file of a shrunk attack, with comments that say what it shows."""
    first, summary = first_violation(shrunk.evaluation), shrunk.evaluation.summary
    assert first is not None
    lost = summary.certificates.uncovered_at
    before = "" if lost is None else f" Its certificate was lost {first.first - lost:.3f} s before."
    lines = [
        f"The pair {first.pair} leaves the safe set at {first.first:.3f} s, up to h = "
        f"{first.worst:.3g}.{before}",
        f"{_ATTACKED}{attacked}; shrunk from {shrunk.sizes[0]} to {shrunk.sizes[1]} values in "
        f"{shrunk.runs} runs.",
        f"{_VERDICT}{summary.outcome.value}",
        f"{_TRAJECTORY}{summary.trajectory}",
        f"Run it: {command}",
    ]
    return "".join(f"# {line}\n" for line in lines) + "\n" + scenario_text(shrunk.table)


class Stated(NamedTuple):
    """The run of an attack as its file states it."""

    verdict: str
    trajectory: str
    attacked: str
    shows: str
    """Its first comment."""


def stated(file: Path) -> Stated:
    """Read an attack's comments. Raises ScenarioError if they state no verdict or trajectory."""
    lines = [line.lstrip("# ") for line in file.read_text(encoding="utf-8").splitlines()]

    def after(word: str) -> str:
        return next((line.removeprefix(word) for line in lines if line.startswith(word)), "")

    for word in (_VERDICT, _TRAJECTORY):
        if not after(word):
            raise ScenarioError(f"{file}: expected a comment '# {word}...': no attack's file")
    return Stated(after(_VERDICT), after(_TRAJECTORY), after(_ATTACKED).partition(";")[0], lines[0])


def differences(file: Path, engines: Sequence[str]) -> list[str]:
    """Run an attack's file on each engine, and return in words what is not as it states."""
    expected, found = stated(file), []
    for engine in engines:
        with TemporaryDirectory() as folder:
            summary = phalanx.run(phalanx.load(file), engine=engine, out=folder).summary
        assert summary is not None, "the run has ended"
        got = {"verdict": summary.outcome.value, "trajectory": summary.trajectory}
        found += [
            f"{engine}: expected the {word} {getattr(expected, word)}, got {value}"
            for word, value in got.items()
            if value != getattr(expected, word)
        ]
    return found


def read_attack(file: Path, attacked: str | None) -> tuple[Fields, Fields, str]:
    """Return the tables of an attack and of the scenario attacked, and the latter's name."""
    table = read_table(file)
    name = attacked or str(table.get("name", ""))
    return table, read_table(name), name


def _run(scenario: Scenario) -> tuple[Swarm, Evaluation]:
    rows = shared_rows(scenario)
    return rows.swarm, evaluate_rows(rows)


def _apart(swarm: Swarm) -> float:
    """Least distance of a normal agent from an adversary at the start [m]; 0 without one."""
    x = swarm.start()
    others = [j for j, member in enumerate(swarm.members) if member.adversary]
    return min((swarm.apart(x, i, j) for i in swarm.normal for j in others), default=0.0)


def _roles(swarm: Swarm, violation: Violation) -> tuple[str, ...]:
    """Return the roles of a violation's pair."""
    composed = swarm.safe_set
    pair = next(pair for pair in composed.pairs if composed.label(pair) == violation.pair)
    roles = ["adversary" if member.adversary else "normal" for member in swarm.members]
    return tuple(roles[l] if l < len(roles) else "obstacle" for l in (pair.a, pair.b))
