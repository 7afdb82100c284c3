"""The runs behind the paper's figures."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import phalanx
from phalanx.guarantee.verdict import Summary
from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.metrics.table import SWARM, metrics_of


class Case(NamedTuple):
    """A scenario that ships, with some fields set."""

    title: str
    scenario: str
    overrides: Mapping[str, float] = MappingProxyType({})

    def command(self) -> str:
        """Return the command that repeats it."""
        chosen = "".join(f" --set {field}={value:g}" for field, value in self.overrides.items())
        return f"phalanx run {self.scenario}{chosen}"


_NO_MARGIN = {"safety.eta": 0.0, "safety.xi": 0.0}
CASES: Mapping[str, Case] = {
    "surrounded": Case("Surrounded", "surrounded"),
    "pinned": Case("Pinned against a wall", "pinned"),
    "1": Case("Simulation 1", "unicycles"),
    "1, η = 0": Case("Simulation 1, η = 0", "unicycles", {"safety.eta": 0.0}),
    "2": Case("Simulation 2", "formation3d"),
    "2, η = 0": Case("Simulation 2, η = ξ = 0", "formation3d", _NO_MARGIN),
    "2, β = 3": Case("Simulation 2, β = 3 as printed", "formation3d-beta3"),
}
RUNS_HEAD = ("run", "command", "verdict", "largest h_tot", "largest h of a pair",
             "from their goals, mean [m]", "farthest at the end [m]")  # fmt: skip


class Finished(NamedTuple):
    """A case that was run."""

    case: Case
    summary: Summary
    history: ReportHistory

    @property
    def shown_agent(self) -> int:
        """Index of agent 2, whose inputs the paper shows."""
        return self.history.swarm.names.index("2")

    def row(self) -> tuple[str, ...]:
        """Return the case and what came of it, as RUNS_HEAD has it."""
        summary, metrics = self.summary, metrics_of(self.history.recording, self.history.swarm)
        errors = [metrics[SWARM][f"tracking_error_{which}"] for which in ("mean", "final")]
        return (
            self.case.title,
            self.case.command(),
            str(summary.outcome),
            f"{summary.largest_h_tot:.4g} at {summary.largest_h_tot_at:.2f} s",
            f"{summary.worst_h:.4g} of {summary.worst_pair}",
            *("–" if error is None else f"{error:.3g}" for error in errors),
        )


def finish(
    folder: Path, overrides: Mapping[str, Any], seed: int | None, show: Callable[[str], None]
) -> Iterator[tuple[str, Finished]]:
    """Run every case in this process, and yield it by its name.

    overrides: fields of every case, before its own. Raises as phalanx.load and phalanx.run.
    """
    for name, case in CASES.items():
        show(case.title)
        scenario = phalanx.load(case.scenario, {**overrides, **case.overrides}, seed)
        run = phalanx.run(scenario, engine="in-process", out=folder)
        assert run.summary is not None
        yield name, Finished(case, run.summary, ReportHistory(run.recording))
