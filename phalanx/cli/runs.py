"""phalanx runs: the runs of a folder, and how each ended."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from phalanx.guarantee.verdict import Summary


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(runs)


def runs(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="Where runs are, as `phalanx run --out` has it."),
    ] = Path("runs"),
) -> int:
    """List the runs of a folder, the newest last, and how each ended.

    Examples:

      phalanx runs
      phalanx runs /data/runs
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from phalanx.cli.display import COLOUR
    from phalanx.launcher.live import find_live
    from phalanx.recording.records import RECORDING

    recordings = sorted(folder.glob(f"*/{RECORDING}"), key=lambda path: path.stat().st_mtime)
    if not recordings:
        print(f"{folder}: no runs there; make one with: phalanx run unicycles", file=sys.stderr)
        return 3
    table = Table("run", "verdict", "time", "seed", "worst h_tot", "certified", box=None)
    for run in (recording.parent for recording in recordings):
        summary = _summary(run)
        if summary is None:
            table.add_row(Text(run.name), "running" if find_live(run) else "broken: no summary")
            continue
        certificates = summary.certificates
        table.add_row(
            Text(run.name),
            Text(summary.outcome, style=COLOUR[summary.outcome]),
            f"{summary.t:.3f} s",
            str(summary.seed),
            f"{summary.worst_h_tot:.4g}",
            f"{certificates.certified} of {certificates.samples}",
        )
    Console().print(table)
    return 0


def _summary(run: Path) -> "Summary | None":
    from phalanx.guarantee.verdict import read_summary
    from phalanx.recording.records import SUMMARY

    try:
        return read_summary((run / SUMMARY).read_bytes())
    except (OSError, ValueError):
        return None
