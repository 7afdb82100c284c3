"""phalanx runs: the runs of a folder, and how each ended."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from phalanx.cli.terminal import complain

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

    from phalanx.cli.display import COLOUR
    from phalanx.cli.text_table import TextTable, styled
    from phalanx.launcher.live import find_live
    from phalanx.recording.records import RECORDING

    recordings = sorted(folder.glob(f"*/{RECORDING}"), key=lambda path: path.stat().st_mtime)
    if not recordings:
        complain(f"{folder}: no runs there; make one with: phalanx run unicycles")
        return 3
    table = TextTable("run", "verdict", "time", "seed", "worst h_tot", "certified")
    for run in (recording.parent for recording in recordings):
        summary = _summary(run)
        if summary is None:
            table.add_row(run.name, "running" if find_live(run) else "broken: no summary")
            continue
        certificates = summary.certificates
        table.add_row(
            run.name,
            styled(summary.outcome, COLOUR[summary.outcome]),
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
