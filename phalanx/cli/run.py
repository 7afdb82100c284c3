"""phalanx run: a scenario from its file to its verdict, on this machine."""

import pkgutil
import secrets
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from phalanx.cli.options import Overrides, ScenarioArgument, Secret, Seed


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(run)


def run(
    scenario: ScenarioArgument,
    seed: Seed = None,
    overrides: Overrides = None,
    out: Annotated[Path, typer.Option(help="Folder for the folders of runs.")] = Path("runs"),
    listen: Annotated[
        str | None,
        typer.Option(help="Zenoh endpoint of the hub; by default a free port on 127.0.0.1."),
    ] = None,
    secret: Secret = "",
    report: Annotated[bool, typer.Option(help="Make the report when the run is over.")] = True,
    strict: Annotated[
        bool, typer.Option(help="Exit with 1 if the run was safe but not guaranteed.")
    ] = False,
    view: Annotated[
        bool, typer.Option("--view", help="Show the run on a page, and replay it when it is over.")
    ] = False,
    control: Annotated[
        bool,
        typer.Option(
            "--control",
            help="With --view: the page may pause, step, change the network, kill and so on.",
        ),
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(help="With --view: of the page; by default 8080 or the next free one."),
    ] = None,
) -> int:
    """Run a scenario: plant and agents, each in its own process, to a verdict.

    Examples:

      phalanx run unicycles
      phalanx run unicycles --seed 7 --set safety.eta=0
      phalanx run unicycles --set network.loss=0.3 --set network.delay=0.01
      phalanx run my-scenario.toml --out /data/runs --strict
      phalanx run unicycles --view --control
    """
    from phalanx.cli.display import print_summary, progress
    from phalanx.faults.commands import CommandPolicy
    from phalanx.guarantee.verdict import exit_status
    from phalanx.launcher.launch import LaunchError, launch, new_folder
    from phalanx.launcher.programs import run_program
    from phalanx.scenario.load import load
    from phalanx.swarm.swarm import build_swarm, require_rows
    from phalanx.wire.session import free_endpoint

    resolved = load(scenario, overrides or (), seed)
    require_rows(build_swarm(resolved))  # what is impossible is said here, not in five log files
    try:
        folder = new_folder(out, resolved.name)
    except OSError as error:
        raise typer.BadParameter(f"--out: cannot create a folder in {out}: {error}") from error
    page = _page(view, control, port)
    policy = CommandPolicy(secret=secrets.token_bytes(16) if control else b"")
    try:
        with progress(resolved) as show:
            summary = launch(
                resolved,
                folder,
                listen or free_endpoint(),
                show,
                secret.encode(),
                policy=policy,
                viewer=page,
            )
    except LaunchError as error:
        print(f"broken: {error}", file=sys.stderr)
        print(f"what was recorded: {folder}", file=sys.stderr)
        return 3
    print_summary(summary)
    if report:
        _write_report(folder)
    print(f"{summary.outcome}: {summary.reason} ({folder})")
    if page is not None:
        print("replaying on the same page; Ctrl-C ends it")
        run_program("viewer", resolved, {"recording": folder, **page})
    return exit_status(summary.outcome, strict)


def _page(view: bool, control: bool, port: int | None) -> dict[str, Any] | None:
    """Options of the viewer, its port chosen beforehand: live and replay share the page."""
    if not view:
        if control or port is not None:
            raise typer.BadParameter("--control, --port: expected --view with them")
        return None
    try:
        choose: Callable[..., int] = pkgutil.resolve_name("phalanx.viewer.page.server:choose_port")
        chosen = choose("127.0.0.1", port)
    except ImportError as error:
        raise typer.BadParameter(
            f"--view needs: pip install 'phalanx[viewer]' ({error})"
        ) from error
    except OSError as error:
        raise typer.BadParameter(f"--port: {error}") from error
    print(f"viewer: http://127.0.0.1:{chosen}")
    return {"port": chosen}


def _write_report(folder: Path) -> None:
    from phalanx.recording.read import UnreadableRecordingError
    from phalanx.report.write import write_report

    try:
        print(f"report: {write_report(folder)}")
    except (UnreadableRecordingError, OSError) as error:
        print(f"no report: {error}", file=sys.stderr)
