"""An attack as a scenario file: its smallest form, and its repetition."""

import math
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import phalanx
from phalanx.guarantee.start import promised
from phalanx.guarantee.verdict import Outcome, Violation
from phalanx.scenario.attack import Attack
from phalanx.scenario.load import scenario_text, validate
from phalanx.scenario.model import Scenario, ScenarioError, digest
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx_attacks.robustness import Evaluation, evaluate, nearest, shortfall
from phalanx_attacks.shrinking import Fields, shrink, size_of

_VERDICT, _TRAJECTORY, _ATTACKED = "Verdict: ", "Trajectory: ", "Attacked: "


class Shrunk(NamedTuple):
    """The smallest form of an attack."""

    table: Fields
    evaluation: Evaluation
    runs: int
    """Number of runs that it took."""
    sizes: tuple[int, int]
    """Number of values in the table, before and after."""


class _Candidates:
    """Runs candidates, each different one once.

    One fails in the same manner if its first violating pair has the same roles, and adversaries
    start no nearer to normal agents.
    """

    def __init__(self, table: Fields) -> None:
        """Raises ScenarioError: the table is no scenario, or it is not violated."""
        scenario = validate(table, "attack")
        self.failures: dict[str, float | None] = {}
        evaluation = evaluate(scenario)
        first = first_violation(evaluation)
        if first is None:
            reason = f"expected a violated run, got {evaluation.summary.outcome.value}"
            raise ScenarioError(f"{scenario.name}: {reason}")
        distance, _ = nearest(evaluation.swarm)
        self._roles = [side.role for side in _sides(evaluation.swarm, first)]
        self._distance = 0.0 if math.isinf(distance) else math.floor(10.0 * distance) / 10.0
        self.failures[digest(scenario)] = first.first

    def __call__(self, table: Fields) -> float | None:
        """Return when a candidate fails in the same manner [s]; None if it does not."""
        try:
            scenario = validate(table, "candidate")
            key = digest(scenario)
            if key not in self.failures:
                self.failures[key] = self._failed(scenario)
            return self.failures[key]
        except ScenarioError:
            return None

    def _failed(self, scenario: Scenario) -> float | None:
        if shortfall(build_swarm(scenario), Attack(apart=self._distance))[0] > 0.0:
            return None
        evaluation = evaluate(scenario)
        first = first_violation(evaluation)
        if first and [side.role for side in _sides(evaluation.swarm, first)] == self._roles:
            return first.first
        return None


def smallest(table: Fields, origin: Fields) -> Shrunk:
    """Shrink an attack. Every step is a run, and the same attack gives the same result.

    Args:
        table: of the attack, as its file has it.
        origin: of the scenario attacked.

    Raises ScenarioError if the attack's run is not violated.
    """
    candidates = _Candidates(table)
    small = shrink(table, origin, candidates)
    sizes = size_of(table), size_of(small)
    return Shrunk(small, evaluate(validate(small, "attack")), len(candidates.failures), sizes)


def first_violation(evaluation: Evaluation) -> Violation | None:
    """Return the violation that begins first; None if the run is not violated."""
    if evaluation.summary.outcome is not Outcome.VIOLATED:
        return None
    return min(evaluation.summary.violations, key=lambda violation: violation.first, default=None)


def attack_text(shrunk: Shrunk, origin: Fields, attacked: str, command: str) -> str:
    """Return the file of a shrunk attack, with comments that say what it shows.

    Args:
        shrunk: the attack.
        origin: table of the scenario attacked.
        attacked: its name.
        command: repeats the run.
    """
    swarm, summary = shrunk.evaluation.swarm, shrunk.evaluation.summary
    first = first_violation(shrunk.evaluation)
    assert first is not None
    sides = " and ".join(side.in_words for side in _sides(swarm, first))
    distance, nearest_two = nearest(swarm)
    rounded_down = math.floor(1e3 * promised(swarm).time) / 1e3
    lines = [
        f"{sides.capitalize()} are unsafe from {first.first:.3f} s on: h up to {first.worst:.3g}, "
        "where 0 is allowed.",
        f"Before the run, `phalanx check` promises safety for {rounded_down:.3f} s.",
    ]
    if summary.certificates.uncovered_at is not None:
        lines.append(f"Certificates proved it until {summary.certificates.uncovered_at:.3f} s.")
    if not math.isinf(distance):
        start = f"{distance:.2f} m to a normal agent ({nearest_two})"
        lines.append(f"At the start no adversary is nearer than {start}.")
    lines += [
        f"{_ATTACKED}{attacked}; shrunk from {shrunk.sizes[0]} to {shrunk.sizes[1]} values in "
        f"{shrunk.runs} runs.",
        f"Left out of it: {', '.join(_left_out(shrunk.table, origin)) or 'nothing'}.",
        f"{_VERDICT}{summary.outcome.value}",
        f"{_TRAJECTORY}{summary.trajectory}",
        f"Run it: {command}",
    ]
    rest = {key: value for key, value in shrunk.table.items() if key != "name"}
    description = f"An attack on {attacked}: {sides}, unsafe at {first.first:.2f} s"
    table = {"name": shrunk.table["name"], "description": description, **rest}
    return "".join(f"# {line}\n" for line in lines) + "\n" + scenario_text(table)


def _left_out(table: Fields, origin: Fields) -> list[str]:
    """Return in words the agents, tables and fields of agents that an attack has no more."""
    here, there = (
        ({str(name) for group in table["agents"] for name in group.get("names", ())},
         {field for group in table["agents"] for field in group})
        for table in (table, origin)
    )  # fmt: skip
    agents, fields = sorted(there[0] - here[0]), sorted(there[1] - here[1])
    return [
        *(f"agent {name}" for name in agents),
        *sorted(origin.keys() - table.keys() - {"attack", "description", "seed"}),
        *(f"{field} of agents" for field in fields),
    ]


class Expected(NamedTuple):
    """The run of an attack as its file states it."""

    verdict: str
    trajectory: str
    attacked: str
    shows: str
    """Its first comment."""


def stated(file: Path) -> Expected:
    """Read an attack's comments. Raises ScenarioError if they state no verdict or trajectory."""
    lines = [line.lstrip("# ") for line in file.read_text(encoding="utf-8").splitlines()]

    def after(word: str) -> str:
        return next((line.removeprefix(word) for line in lines if line.startswith(word)), "")

    for word in (_VERDICT, _TRAJECTORY):
        if not after(word):
            raise ScenarioError(f"{file}: expected a comment '# {word}...': no attack's file")
    return Expected(
        after(_VERDICT), after(_TRAJECTORY), after(_ATTACKED).partition(";")[0], lines[0]
    )


def differences(file: Path, engines: Sequence[str]) -> list[str]:
    """Run an attack's file on each engine, and return in words what is not as it states."""
    scenario = phalanx.load(file)
    expected, deviations = stated(file), []
    for engine in engines:
        with TemporaryDirectory() as folder:
            summary = phalanx.run(scenario, engine=engine, out=folder).summary
        assert summary is not None, "the run has ended"
        if summary.outcome is Outcome.STOPPED:
            raise KeyboardInterrupt
        got = {"verdict": summary.outcome.value, "trajectory": summary.trajectory}
        deviations += [
            f"{engine}: expected the {word} {getattr(expected, word)}, got {value}"
            for word, value in got.items()
            if value != getattr(expected, word)
        ]
    return deviations


class Side(NamedTuple):
    """A side of a pair."""

    role: str
    """"normal", "adversary", or "other" for an obstacle or a limit."""
    label: str

    @property
    def in_words(self) -> str:
        """Such as "normal agent 1", "adversary 4" or "obstacle 0"."""
        prefix = {"normal": "normal agent ", "adversary": "adversary "}.get(self.role, "")
        return prefix + self.label


def _sides(swarm: Swarm, violation: Violation) -> list[Side]:
    """Return the two sides of a violation's pair."""
    composed = swarm.safe_set
    pair = next(pair for pair in composed.pairs if composed.label(pair) == violation.pair)
    roles = ["adversary" if member.adversary else "normal" for member in swarm.members]
    roles += ["other"] * len(composed.obstacles)
    return [Side(roles[end], composed.labels[end]) for end in pair]
