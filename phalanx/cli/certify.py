"""phalanx certify: prove a recorded run safe, with code of its own."""

import sys
from typing import TYPE_CHECKING

import typer

from phalanx.cli.recordings import RunArgument

if TYPE_CHECKING:
    from phalanx.guarantee.checker.certify import Certification


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(certify)


def certify(run: RunArgument) -> int:
    """Prove from its recording that no pair of a run could leave its safe set.

    From each recorded state and the input applied there it bounds h until the next input, between
    integration steps too, whatever other agents and disturbances do within their bounds. It shares
    no code with controller and plant but dynamics and h, and rounds outwards. Assumed are the
    dynamics and the disturbance bounds; a recording that is no motion of them is refused.

    Exit status 0 if the run is certified, 1 if it is not, 3 if the recording cannot be read.
    """
    from rich.console import Console
    from rich.progress import Progress

    from phalanx.guarantee.checker.certify import certify as certify_run
    from phalanx.guarantee.checker.intervals import UncertifiableError
    from phalanx.recording.read import UnreadableRecordingError, read

    try:
        recording = read(run)
    except (UnreadableRecordingError, OSError) as error:
        print(error, file=sys.stderr)
        return 3
    if recording.damage:
        print(f"{recording.path}: {recording.damage}", file=sys.stderr)
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("certifying", total=1.0)
        try:
            found = certify_run(
                recording.scenario,
                recording.states,
                recording.steps,
                lambda share: bar.update(task, completed=share),
            )
        except UncertifiableError as error:
            print(f"not certified: {error}")
            return 1
    _show(found)
    return 0 if found else 1


def _show(found: "Certification") -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    verdict = "[green bold]certified[/]" if found else "[yellow bold]not certified[/]"
    table.add_row("verdict", f"{verdict}, on the recorded inputs and disturbances within bounds")
    share = found.certified / max(found.samples, 1)
    table.add_row(
        "certified to the next input", f"{found.certified} of {found.samples} ({share:.2%})"
    )
    table.add_row("shortest horizon", f"{1e3 * found.horizon:.4g} ms")
    if found.gap:
        table.add_row("first not covered", f"{found.gap.pair} from t = {found.gap.t:.6f} s on")
    table.add_row("recording", "a motion of these inputs, with disturbances within their bounds")
    Console().print(table)
