"""phalanx shrink and phalanx replay: attacks as the smallest files, and their repetition."""

from pathlib import Path
from typing import Annotated

import typer

from phalanx.cli.jobs import Job
from phalanx.launcher.streams import echo, echo_error
from phalanx.native.files import whole_file

_ENGINES = ("in-process", "processes")


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command(rich_help_panel=Job.STUDY)(shrink)
    app.command(rich_help_panel=Job.STUDY)(replay)


def shrink(
    file: Annotated[Path, typer.Argument(help="An attack: a scenario whose run is violated.")],
    attacked: Annotated[
        str | None,
        typer.Option(help="The scenario attacked, by default the shipped one of the same name."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Write it there; by default print it.")] = None,
) -> int:
    """Find the smallest scenario that is violated as an attack is.

    Fewer agents, faults, obstacles and switches, fields as in the scenario attacked, a shorter run,
    rounder numbers. Agents start no nearer to one another than in the attack, and with a
    certificate. Every step is a run.

    Examples:

      phalanx shrink found/01-1-4-2.05s.toml --attacked guaranteed --out smallest.toml
    """
    from phalanx.scenario.load import read_table
    from phalanx_attacks.minimise import attack_text, smallest

    table = read_table(file)
    attacked = attacked or str(table.get("name", ""))
    origin = read_table(attacked)
    shrunk = smallest(table, origin)
    text = attack_text(shrunk, origin, attacked, f"phalanx run {out or 'FILE'}")
    if out is None:
        echo(text)
        return 0
    with whole_file(out) as part:
        part.write_text(text, encoding="utf-8")
    before, after = shrunk.sizes
    echo(f"{out}: {after} values instead of {before}, after {shrunk.runs} runs")
    return 0


def replay(
    files: Annotated[list[Path], typer.Argument(help="Attacks, or folders with them.")],
) -> int:
    """Run attacks again on both engines, and compare verdict and trajectory with their files.

    Exit status: 0 if all are as stated, else 2.

    Examples:

      phalanx replay scenarios/attacks
    """
    from phalanx_attacks.minimise import differences, stated

    status = 0
    for path in files:
        for file in sorted(path.glob("*.toml")) if path.is_dir() else [path]:
            deviations = differences(file, _ENGINES)
            for difference in deviations:
                echo_error(f"{file}: {difference}")
            words = "differs" if deviations else "as stated, on both engines"
            echo(f"{file}: {words}: {stated(file).shows}")
            status = 2 if deviations else status
    return status
