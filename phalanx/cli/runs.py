"""phalanx scenarios, schema, runs and verify: what a scenario may say, list and repeat runs."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from phalanx.cli.options import Engine, RunArgument, Trust
from phalanx.launcher.engine import DEFAULT_ENGINE
from phalanx.launcher.streams import echo, echo_error

if TYPE_CHECKING:
    from phalanx.guarantee.verdict import Summary


def scenarios() -> int:
    """List the scenarios that ship."""
    from rich.console import Console

    from phalanx.cli.display import TextTable
    from phalanx.scenario.load import load, shipped

    table = TextTable("name", "agents", "duration", "description")
    for name in shipped():
        scenario = load(name)
        roles = [group.role for _, group, _ in scenario.roster()]
        agents = f"{roles.count('normal')} + {roles.count('adversary')}"
        table.add_row(name, agents, f"{scenario.duration:g} s", scenario.description)
    Console().print(table)
    echo("agents: normal + adversary. Run one with: phalanx run NAME")
    return 0


def schema() -> int:
    """Print the JSON Schema of a scenario file, by which editors complete and check it.

    Example:

      phalanx schema > scenario.schema.json
    """
    from phalanx.scenario.model import Scenario
    from phalanx.schema.json_schema import json_schema

    echo(*json.dumps(json_schema(Scenario), indent=1).splitlines())
    return 0


def runs(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="The folder of runs, as for `phalanx run --out`."),
    ] = Path("runs"),
) -> int:
    """List the runs of a folder, the newest last, and how each ended.

    Examples:

      phalanx runs
      phalanx runs /data/runs
    """
    from rich.console import Console

    from phalanx.cli.display import COLOUR, TextTable, styled
    from phalanx.launcher.live import find_live
    from phalanx.recording.records import RECORDING

    recordings = sorted(folder.glob(f"*/{RECORDING}"), key=lambda path: path.stat().st_mtime)
    if not recordings:
        echo_error(f"{folder}: no runs in this folder; make one with: phalanx run unicycles")
        return 3
    table = TextTable("run", "verdict", "time", "seed", "worst h", "certified")
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
            f"{summary.worst_h:.4g}",
            f"{certificates.certified} of {certificates.samples}",
        )
    Console().print(table)
    return 0


def verify(
    run: RunArgument,
    engine: Engine = DEFAULT_ENGINE,
    trust: Trust = False,
) -> int:
    """After a run: repeat it and compare the trajectories bit by bit, to test reproducibility.

    To check a scenario before a run use `phalanx check`; to prove a recording safe, `phalanx
    certify`.

    Exit status 0 if the trajectories are identical, 1 if not, 3 if the recording cannot be read
    or run, 130 if it was stopped.
    """
    import phalanx
    from phalanx.cli.display import progress
    from phalanx.guarantee.verdict import Outcome, exit_status
    from phalanx.launcher.verify import cut_short

    try:
        recorded = phalanx.open(run, trust=trust)
        with progress(recorded.scenario) as show:
            verification = phalanx.verify(recorded, engine=engine, progress=show)
    except KeyboardInterrupt:
        echo_error("stopped")
        return exit_status(Outcome.STOPPED)
    if cut_short(recorded.recording):
        summary = recorded.summary
        why = recorded.recording.damage or (summary and summary.reason) or "no summary"
        echo(f"{recorded.recording.path}: {why}; comparing up to its end")
    echo(verification)
    return 0 if verification else 1


def _summary(run: Path) -> "Summary | None":
    from phalanx.guarantee.verdict import read_summary
    from phalanx.recording.records import SUMMARY

    file = run / SUMMARY
    try:
        return read_summary(file.read_bytes()) if file.is_file() else None
    except (OSError, ValueError):
        return None
