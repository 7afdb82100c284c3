"""phalanx fit disturbance: a bound on the disturbance from recorded runs."""

import json
import math
from collections.abc import Sequence
from decimal import ROUND_CEILING, Context
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from phalanx.cli.jobs import Job
from phalanx.cli.options import Trust
from phalanx.launcher.streams import echo

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phalanx.recording.disturbances import AgentDisturbances
    from phalanx.scenario.agents import AgentGroup
    from phalanx.scenario.model import Scenario
    from phalanx.theory.arrays import Array

commands = typer.Typer(no_args_is_help=True, help="Fit a scenario's table to recorded runs.")
_EXACT = 1e-9
"""Shares are decimal fractions: 100 times 0.99 counts as 99, whatever its last digit."""
_ROUNDED_UP = Context(prec=4, rounding=ROUND_CEILING)


def register(app: typer.Typer) -> None:
    """Add the group."""
    app.add_typer(commands, name="fit", rich_help_panel=Job.STUDY)


@commands.command()
def disturbance(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Folders of runs, or their recordings.")
    ],
    level: Annotated[
        float,
        typer.Option(min=0.5, max=0.99999, help="Probability that the next interval keeps it."),
    ] = 0.999,
    trust: Trust = False,
) -> int:
    """Print the disturbance bound that recorded runs need, and what `check` says of it.

    For each interval in which an agent holds an input, this is the norm of the constant
    disturbance that explains its motion under the declared dynamics. The conformal bound holds for
    the next interval if that is exchangeable with the recorded ones. The bound for the scenario is
    that one, or the largest norm if that is larger or there are too few intervals; rounded up.

    Examples:

      phalanx fit disturbance runs/unicycles-1
      phalanx fit disturbance runs/warehouse-* --level 0.99
    """
    import phalanx

    scenario, by_group = _read(runs, trust)
    bounds = []
    for group, intervals in zip(scenario.agents, by_group, strict=True):
        fitted = _fit(intervals, level)
        bounds.append(fitted.bound)
        _show(group, intervals, fitted, level)
    refitted = _with_bounds(scenario, bounds)
    echo(f"# check with these bounds: {phalanx.check(refitted).answer}")
    return 0


def conformal_bound(values: "ArrayLike", share: float) -> float:
    """Return a bound that the next value keeps with at least this probability.

    It is the order statistic ⌈(n + 1) share⌉ of n values, and needs no more than that the next one
    is exchangeable with them (Vovk, Gammerman and Shafer, Algorithmic Learning in a Random World,
    2005). Infinite if there are fewer values than share / (1 - share).
    """
    import numpy as np

    x = np.sort(np.asarray(values, dtype=float))
    rank = math.ceil((len(x) + 1) * share - _EXACT)
    return float(x[rank - 1]) if 0 < rank <= len(x) else math.inf


class _Fit(NamedTuple):
    """The sizes of a group's disturbances."""

    largest: float
    p99: float
    conformal: float
    """Infinite if there are too few intervals."""

    @property
    def bound(self) -> float:
        """The bound to declare, rounded up: no recorded interval needs a larger one."""
        enough = math.isfinite(self.conformal)
        bound = max(self.conformal, self.largest) if enough else self.largest
        return float(_ROUNDED_UP.create_decimal_from_float(bound))


def _fit(intervals: "AgentDisturbances", level: float) -> _Fit:
    import numpy as np

    return _Fit(
        float(intervals.size.max()),
        float(np.quantile(intervals.size, 0.99)),
        conformal_bound(intervals.size, level),
    )


def _read(runs: Sequence[Path], trust: bool) -> "tuple[Scenario, list[AgentDisturbances]]":
    """Return the scenario, and the intervals of all runs by group of agents."""
    import numpy as np

    from phalanx.recording.disturbances import AgentDisturbances, disturbances_of
    from phalanx.recording.read import read, swarm_of

    recordings = [read(run, trust) for run in runs]
    first = recordings[0].scenario
    for other in recordings[1:]:
        if [_kind(g) for g in other.scenario.agents] != [_kind(g) for g in first.agents]:
            raise typer.BadParameter(
                f"{other.path}: expected the agents and dynamics of {recordings[0].path}"
            )
    by_run = [disturbances_of(recording, swarm_of(recording)) for recording in recordings]
    by_group, begin = [], 0
    for group in first.agents:
        members = [member for run in by_run for member in run[begin : begin + len(group.names)]]
        begin += len(group.names)
        by_group.append(AgentDisturbances(*map(np.concatenate, zip(*members, strict=True))))
    if not all(len(group.t) for group in by_group):
        raise typer.BadParameter(
            f"{recordings[0].path}: no state where inputs took effect: record one at every event, "
            "time.recording_step = 0"
        )
    return first, by_group


def _kind(group: "AgentGroup") -> tuple[object, ...]:
    return group.names, group.dynamics


def _show(group: "AgentGroup", intervals: "AgentDisturbances", fitted: _Fit, level: float) -> None:
    names = ", ".join(group.names[:4]) + (", ..." if len(group.names) > 4 else "")
    fields = {**group.disturbance.model_dump(exclude_defaults=True), "bound": fitted.bound}
    few = f"; too few intervals for {level:g}" if math.isinf(fitted.conformal) else ""
    echo(
        f"# agents {names}: {len(intervals.t)} intervals; declared {group.disturbance.bound:g}",
        f"# largest {fitted.largest:.4g}, 99 % below {fitted.p99:.4g}, "
        f"next below {fitted.conformal:.4g} with probability {level:g}{few}",
        *_against("speed [m/s]", intervals.speed, intervals.size),
        *_against("input", intervals.input, intervals.size),
        f"disturbance = {{ {', '.join(f'{k} = {json.dumps(v)}' for k, v in fields.items())} }}",
        "",
    )


def _against(name: str, values: "Array", size: "Array") -> list[str]:
    """Lines with the largest size in each third of the values."""
    import numpy as np

    ends = np.quantile(values, [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0])
    lines = []
    for low, high in pairwise(ends.tolist()):
        some = size[(values >= low) & (values <= high)]
        lines.append(f"#   {name} {low:.3g} to {high:.3g}: largest {some.max():.4g}")
    return list(dict.fromkeys(lines))


def _with_bounds(scenario: "Scenario", bounds: Sequence[float]) -> "Scenario":
    from phalanx.scenario.load import from_json
    from phalanx.scenario.model import to_json

    table = json.loads(to_json(scenario))
    for group, bound in zip(table["agents"], bounds, strict=True):
        group["disturbance"]["bound"] = bound
    return from_json(json.dumps(table))
