"""phalanx view, viewer and export: a run on a page, live or recorded, and as one file."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from phalanx.cli.option_checks import (
    endpoint_for,
    identity_for,
    live_run,
    require_file,
    require_folder,
    require_other,
    require_png,
    require_port,
    require_run,
)
from phalanx.cli.options import (
    CommandSecret,
    Connect,
    Insecure,
    KeysFolder,
    RunArgument,
    RunId,
    Secret,
    Timeout,
    Trust,
)
from phalanx.launcher.streams import echo, echo_error

RunOrRecording = Annotated[
    Path | None,
    typer.Argument(metavar="RUN", help="A run's folder, live or over, or its recording."),
]
LiveRun = Annotated[
    str,
    typer.Option("--run", envvar="PHALANX_RUN", callback=require_run, help="Name of the live run."),
]
Host = Annotated[str, typer.Option(envvar="PHALANX_HOST", help="Address to serve the page on.")]
Port = Annotated[
    int | None,
    typer.Option(
        callback=require_port,
        envvar="PHALANX_PORT",
        help="Port to serve the page on; by default 8080 or the next free one.",
        show_default=False,
    ),
]
Origins = Annotated[
    list[str] | None,
    typer.Option("--origin", help="Another origin whose pages may connect, such as a proxy's."),
]


def require_either(recording: Path | None, connect: str, run: str) -> None:
    """Raise BadParameter unless a run is named either by its folder or by its hub."""
    if (recording is None) != bool(connect and run):
        raise typer.BadParameter("expected either RUN, or --connect and --run")


def register(app: typer.Typer) -> None:
    app.command()(view)
    app.command()(export)
    app.command(rich_help_panel="Programs of a run")(viewer)


def view(
    recording: RunOrRecording = None,
    connect: Connect = "",
    run: LiveRun = "",
    secret: Secret = "",
    keys: KeysFolder = None,
    insecure: Insecure = False,
    command_secret: CommandSecret = "",
    host: Host = "127.0.0.1",
    port: Port = None,
    origins: Origins = None,
    timeout: Timeout = 60.0,
    trust: Trust = False,
) -> int:
    """Show a run on a page: a recording, or a live one over Zenoh. Ctrl-C ends it.

    Examples:

      phalanx view runs/unicycles-1
      phalanx view --connect tcp/127.0.0.1:7447 --run r1
    """
    require_either(recording, connect, run)
    page = {"host": host, "port": port, "origins": tuple(origins or ()), "trust": trust}
    if recording is not None:
        return _show_folder(recording, insecure, command_secret, page)
    identity_folder = identity_for(keys, connect, insecure)
    return _show_live(run, connect, secret, identity_folder, command_secret, timeout, page)


def viewer(
    run: RunId,
    connect: Connect = "",
    secret: Secret = "",
    keys: KeysFolder = None,
    insecure: Insecure = False,
    command_secret: CommandSecret = "",
    host: Host = "127.0.0.1",
    port: Port = None,
    origins: Origins = None,
    timeout: Timeout = 60.0,
    trust: Trust = False,
) -> int:
    """Run the viewer alone, as plant and agents are run in containers and on many hosts."""
    page = {"host": host, "port": port, "origins": tuple(origins or ()), "trust": trust}
    endpoint = endpoint_for(connect, keys)
    identity_folder = identity_for(keys, endpoint, insecure)
    return _show_live(run, endpoint, secret, identity_folder, command_secret, timeout, page)


def export(
    run: RunArgument,
    html: Annotated[
        Path | None,
        typer.Option(callback=require_file, help="Write one HTML file with scene and plots there."),
    ] = None,
    png: Annotated[
        Path | None, typer.Option(callback=require_png, help="Write a picture there, a PNG file.")
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(help="Time of the picture, in seconds; by default the worst moment."),
    ] = None,
    mcap: Annotated[
        Path | None,
        typer.Option(
            callback=require_file, help="Write a recording for Foxglove and others there."
        ),
    ] = None,
    rerun: Annotated[
        Path | None,
        typer.Option(
            callback=require_file, help="Write a recording for rerun there; needs rerun-sdk."
        ),
    ] = None,
    parquet: Annotated[
        Path | None,
        typer.Option(callback=require_folder, help="Write the run's tables there, a folder."),
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(callback=require_folder, help="The same as CSV.")
    ] = None,
    trust: Trust = False,
) -> int:
    """Export a run: HTML that plays without a server, a picture, or data for other tools.

    Examples:

      phalanx export runs/unicycles-1 --html run.html
      phalanx export runs/unicycles-1 --mcap shown.mcap
      phalanx export runs/unicycles-1 --rerun shown.rrd
      phalanx export runs/unicycles-1 --parquet tables
    """
    from phalanx.cli.display import spinner
    from phalanx.launcher.programs import configure_logging
    from phalanx.launcher.streams import warn_of_damage
    from phalanx.recording.read import UnreadableRecordingError, find, read
    from phalanx_viewer.export.write import run as write

    files = {"html": html, "png": png, "mcap": mcap, "rerun": rerun}
    wanted = files | {"parquet": parquet, "csv": csv}
    if not any(wanted.values()):
        raise typer.BadParameter(f"expected one of {', '.join(f'--{name}' for name in wanted)}")
    if at is not None and png is None:
        raise typer.BadParameter("--at: expected --png with it")
    if rerun is not None and importlib.util.find_spec("rerun") is None:
        raise typer.BadParameter("--rerun: needs rerun-sdk: pip install 'phalanx-swarm[rerun]'")
    configure_logging()
    try:
        for option, path in files.items():
            require_other(f"--{option}", path, [find(run)])
        with spinner("exporting") as show:
            show("reading the recording")
            recorded = read(run, trust)
            warn_of_damage(recorded)
            written = write(recorded, at=at, progress=show, **wanted)
        echo(*written)
    except (UnreadableRecordingError, OSError) as error:
        echo_error(error)
        return 3
    except ValueError as error:  # a time outside the run
        raise typer.BadParameter(str(error)) from error
    return 0


def _show_folder(run: Path, insecure: bool, command_secret: str, page: dict[str, Any]) -> int:
    """Show a live run and then its recording, or a recording."""
    from phalanx_viewer.main import run_live, run_replay

    found = live_run(run, insecure)
    if found is None:
        return _run_page(lambda: run_replay(run, **page))
    commands = command_secret.encode()
    return _run_page(
        lambda: run_live(found.membership, recording=run, command_secret=commands, **page)
    )


def _show_live(
    run: str,
    connect: str,
    secret: str,
    identity_folder: Path | None,
    command_secret: str,
    timeout: float,
    page: dict[str, Any],
) -> int:
    from phalanx.wire.keys import OPERATOR, VIEWER
    from phalanx.wire.membership import Membership
    from phalanx_viewer.main import run_live

    identity = OPERATOR if identity_folder and command_secret else VIEWER
    membership = Membership(run, connect, secret.encode(), identity, timeout, identity_folder)
    commands = command_secret.encode()
    return _run_page(lambda: run_live(membership, command_secret=commands, **page))


def _run_page(show: Callable[[], int]) -> int:
    """Show a page until SIGINT or SIGTERM; print a failure as one line."""
    from phalanx.launcher.programs import configure_logging

    configure_logging()
    try:
        return show()
    except (RuntimeError, ValueError, OSError) as error:
        echo_error(error)
        return 3
