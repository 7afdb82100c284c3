"""phalanx study: run a scenario over seeds and a grid, go on with a study, and open one."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phalanx.cli.jobs import Job
from phalanx.cli.options import Overrides
from phalanx.launcher import interrupt
from phalanx.launcher.streams import echo, echo_error

if TYPE_CHECKING:
    from phalanx_studies.plan import Plan
    from phalanx_studies.study import Study

_OPEN = "open"

Vary = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATH=V,V,...",
        help="An axis of the grid: a field and its values, as network.loss=0,.1,.3. Repeatable.",
    ),
]
Draw = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATH=DISTRIBUTION",
        help="A field drawn at random: uniform(0,1), log-uniform(1e-3,1) or choice(a,b). "
        "Repeatable.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel=Job.STUDY)(study)


def study(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="A scenario as `phalanx run` takes it, or a study.toml; or `open` and a folder.",
        ),
    ],
    folder: Annotated[
        Path | None, typer.Argument(metavar="[FOLDER]", help="After `open`: of a study.")
    ] = None,
    seeds: Annotated[
        str | None, typer.Option(help="As 0:200 for 0 to 199, or 1,2,5; by default 0:10.")
    ] = None,
    vary: Vary = None,
    draw: Draw = None,
    draws: Annotated[
        int | None, typer.Option(min=1, help="Number of draws, each with every seed.")
    ] = None,
    overrides: Overrides = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The study's folder; by default studies/<scenario>. What is there is not run "
            "again."
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; by default one for each processor.")
    ] = None,
    confirm: Annotated[
        float | None,
        typer.Option(
            min=1e-6,
            max=1.0,
            help="Repeat this share of the rows over processes, and compare their hashes.",
        ),
    ] = None,
) -> int:
    """Run a scenario many times: every seed at every point of a grid, a table row for each run.

    Asked again, it runs what is missing: after Ctrl-C or a crash, or for more seeds or values.
    Writes study.toml, rows.parquet and study.html into its folder. Exit status: 3 if a run broke
    or has another hash over processes.

    Examples:

      phalanx study unicycles --seeds 0:200 --vary network.loss=0,.1,.3
      phalanx study unicycles --seeds 0:20 --draw "safety.eta=uniform(0,10)" --draws 50
      phalanx study studies/unicycles/study.toml --out studies/unicycles
      phalanx study open studies/unicycles
    """
    if scenario == _OPEN:
        return _open(folder)
    if folder is not None:
        raise typer.BadParameter("FOLDER: expected after `phalanx study open`")
    from phalanx_studies.study import study as run_study

    plan = _plan(scenario, seeds, vary, draw, draws, overrides)
    target = out or Path("studies") / plan.name
    with _refusals():
        result = run_study(plan, out=target, workers=workers, progress=True)
    status = _print_rates(result)
    return status if confirm is None else max(status, _confirm(result, confirm))


def _confirm(result: "Study", share: float) -> int:
    """Print how many rows have the same hash over processes; return the exit status."""
    same = result.confirm(share)
    echo(f"over processes {sum(same.values())} of {len(same)} rows have the same hash")
    if others := [str(index) for index, equal in same.items() if not equal]:
        echo_error(f"another hash: rows {', '.join(others)}")
    return 3 if others else 0


def _plan(
    scenario: str, seeds: str | None, vary: Sequence[str] | None, draw: Sequence[str] | None,
    draws: int | None, overrides: Sequence[str] | None,
) -> "Plan":  # fmt: skip
    from phalanx.scenario.load import field_and_value
    from phalanx_studies.plan import distribution_from, plan_from, read_plan, values_from

    if Path(scenario).name == "study.toml":
        if seeds is not None or vary or draw or draws or overrides:
            raise typer.BadParameter(
                f"{scenario} has the whole plan: expected no seeds or fields, edit them there"
            )
        return read_plan(Path(scenario))
    table: dict[str, Any] = {
        "scenario": scenario,
        "seeds": "0:10" if seeds is None else seeds,
        "overrides": dict(map(field_and_value, overrides or ())),
        "vary": _fields("--vary", vary, values_from),
        "draw": _fields("--draw", draw, distribution_from),
        "draws": draws,
    }
    return plan_from(table, "study")


def _fields(option: str, texts: Sequence[str] | None, read: Callable[[str], Any]) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    for text in texts or ():
        path, separator, values = text.partition("=")
        if not separator or not values:
            raise typer.BadParameter(f"{option} {text}: expected PATH=VALUES")
        if path in fields:
            raise typer.BadParameter(f"{option} {path}: expected every field once")
        try:
            fields[path] = read(values)
        except ValueError as error:
            raise typer.BadParameter(f"{option} {path}: {error}") from error
    return fields


def _open(folder: Path | None) -> int:
    from phalanx_studies.study import open_study

    if folder is None:
        raise typer.BadParameter("open: expected the folder of a study")
    with _refusals():
        return _print_rates(open_study(folder))


@contextmanager
def _refusals() -> Iterator[None]:
    """Make errors of the study's folder those of an argument, and say what Ctrl-C has left."""
    from phalanx_studies.store import StudyError

    try:
        yield
    except StudyError as error:
        raise typer.BadParameter(str(error)) from error
    except KeyboardInterrupt:
        interrupt.clear()  # said in one line
        echo_error("stopped; the finished rows are kept, and the same command goes on")
        raise


def _print_rates(result: "Study") -> int:
    """Print a row for each point, and write the page; return the exit status."""
    from rich.console import Console

    from phalanx.cli.display import TextTable
    from phalanx_studies.row import without_effect

    table = TextTable(*result.axes, "runs", "guaranteed", "safe", "violated", "rate, 95 %", "other")
    guaranteed, safe = result.rates("guaranteed"), result.rates("safe")
    for point, rate in enumerate(result.rates("violated").iter_rows(named=True)):
        counts = guaranteed["guaranteed"][point], safe["safe"][point], rate["violated"]
        table.add_row(
            *(str(rate[axis]) for axis in result.axes),
            str(rate["runs"]),
            *map(str, counts),
            f"{rate['low']:.3g} to {rate['high']:.3g}",
            str(rate["runs"] - sum(counts)),
        )
    Console().print(table)
    for line in without_effect(result.frame, result.axes):
        echo(line)
    refused = result.outcomes["refused"]
    if refused:
        echo(f"{refused} runs were refused: their scenario is not valid; reasons are in the page")
    if result.missing:
        echo(f"{result.missing} of {result.plan.size} runs have no row")
    echo(f"page: {result.page()}")
    if broken := result.outcomes["broken"]:
        echo_error(f"broken: {broken} of {result.plan.size} runs, see the page; run it again")
    return 3 if broken else 0
