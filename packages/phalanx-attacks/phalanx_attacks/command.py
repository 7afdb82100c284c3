"""phalanx attack: search for the attack that breaks a swarm."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from phalanx.cli.jobs import Job
from phalanx.cli.options import Overrides
from phalanx.launcher import interrupt
from phalanx.launcher.streams import echo, echo_error

if TYPE_CHECKING:
    from collections.abc import Callable

    from phalanx_attacks.runner import Attacked
    from phalanx_attacks.search import History, Options


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel=Job.STUDY)(attack)


def attack(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="As `phalanx run` takes it; its table `attack` says what may change.",
        ),
    ],
    budget: Annotated[
        int, typer.Option(min=1, max=1_000_000, help="Most runs of search, and of baseline.")
    ] = 200,
    preset: Annotated[
        Literal["within", "beyond"] | None,
        typer.Option(
            help="Knobs besides those declared. within: starts, gains, how disturbances act, lies; "
            "beyond: also faults of robots. Without a table: within."
        ),
    ] = None,
    optimiser: Annotated[Literal["cma-es", "random"], typer.Option()] = "cma-es",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search; runs have their own.")] = 0,
    batch: Annotated[
        int | None,
        typer.Option(min=5, help="Points in a generation; they are evaluated at the same time."),
    ] = None,
    fresh: Annotated[
        int,
        typer.Option(min=0, help="More seeds, with which the best of a generation runs again."),
    ] = 4,
    first: Annotated[
        bool, typer.Option("--first", help="End each optimiser at its first violated run.")
    ] = False,
    baseline: Annotated[
        bool, typer.Option(help="Let a random search with the same budget follow, to compare.")
    ] = True,
    overrides: Overrides = None,
    out: Annotated[
        Path | None,
        typer.Option(help="The folder; by default attacks/<scenario>. A search there goes on."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; by default one for each processor.")
    ] = None,
) -> int:
    """Search for starts, inputs, lies and faults that break a swarm, within declared bounds.

    Each run is measured by its robustness: below 0 a pair was unsafe, below 1 it was without a
    certificate for some time. Starts that leave a pair no certificate are not run. The best attack
    of each kind is kept as a scenario that `phalanx run` repeats to the same trajectory.

    Asked again, it goes on where it was, also after Ctrl-C, a crash, or for a larger budget.
    Exit status: 2 if an attack was found, else 0.

    Examples:

      phalanx attack guaranteed --budget 200
      phalanx attack unicycles --preset beyond --set duration=6 --workers 4
      phalanx run attacks/guaranteed/found/01-1-4-1.68s.toml
    """
    from phalanx_studies.store import StudyError

    from phalanx.scenario.load import field_and_value
    from phalanx_attacks.runner import attack as search
    from phalanx_attacks.search import Options

    folder = out or Path("attacks") / Path(scenario).name.removesuffix(".toml")
    options = Options(budget, preset, optimiser, seed, batch, fresh, first, baseline)
    fields = dict(map(field_and_value, overrides or ()))
    try:
        with _display(options) as show:
            attacked = search(
                scenario, fields, options, folder=folder, workers=workers, progress=show
            )
    except StudyError as error:
        raise typer.BadParameter(str(error)) from error
    except KeyboardInterrupt:
        interrupt.clear()  # said in one line
        echo_error("stopped; the finished runs are kept, and the same command goes on")
        raise
    _print(attacked)
    return 2 if any(history.violated for history in attacked.histories) else 0


@contextmanager
def _display(options: "Options") -> "Iterator[Callable[[History], None]]":
    """Say what will run, and show how far it is; yields the function to call."""
    from phalanx.cli.display import progress_of_runs

    phases, most = options.optimisers, options.budget
    fresh = f"; of each generation the best on {options.fresh} more seeds" if options.fresh else ""
    echo_error(f"at most {' and '.join(f'{most} runs by {name}' for name in phases)}{fresh}")
    with progress_of_runs(most * len(phases)) as show:

        def show_search(history: "History") -> None:
            finished = most * phases.index(history.optimiser) + history.begun
            result = f"least robustness {history.best:.4g}, {len(history.violated)} violated"
            show(history.optimiser, finished, result if history.finds else "")

        yield show_search


def _print(attacked: "Attacked") -> None:
    from rich.console import Console

    from phalanx.cli.display import TextTable
    from phalanx_attacks.page import counts, fresh

    head, rows = counts(attacked.histories)
    table = TextTable(*head)
    for row in rows:
        table.add_row(*row)
    Console().print(table)
    table = TextTable("weakest pair", "at", "by", "robustness", "verdict", "on fresh seeds")
    for behaviour, find, _ in attacked.finds:
        words = f"{find.when:.3f} s", behaviour.means, f"{find.robustness:.4g}", find.row.outcome
        table.add_row(behaviour.pair, *words, fresh(find))
    Console().print(table)
    for _, _, path in attacked.finds:
        echo(path)
    echo(f"page: {attacked.page}")
