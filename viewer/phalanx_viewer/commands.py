"""phalanx view, viewer and export: a run on a page, live or recorded, and as one file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from phalanx.cli import option_checks as checks
from phalanx.cli import options
from phalanx.cli.jobs import Job
from phalanx.launcher.streams import echo, echo_error

if TYPE_CHECKING:
    from phalanx.messages.membership import Membership

_FILE, _FOLDER = checks.require_file, checks.require_folder

RunOrRecording = Annotated[
    Path | None,
    typer.Argument(metavar="RUN", help="A run's folder, live or over, or its recording."),
]
LiveRun = Annotated[
    str,
    typer.Option(
        "--run", envvar="PHALANX_RUN", callback=checks.require_run, help="Name of the live run."
    ),
]
Host = Annotated[str, typer.Option(envvar="PHALANX_HOST", help="Address to serve the page on.")]
Port = Annotated[
    int | None,
    typer.Option(
        callback=checks.require_port,
        envvar="PHALANX_PORT",
        help="Port to serve the page on; by default 8080 or the next free one.",
        show_default=False,
    ),
]
Origins = Annotated[
    list[str] | None,
    typer.Option("--origin", help="Another origin whose pages may connect, such as a proxy's."),
]


def live_membership(
    recording: Path | None, run: str, connect: str, secret: str, keys: Path | None,
    insecure: bool, timeout: float, identity: str,
) -> "Membership | None":  # fmt: skip
    """Return the membership of a live run, by its folder or its name; None if it is over.

    identity: of the program, if its run has keys. Raises BadParameter unless either is given.
    """
    from phalanx.messages.keys import VIEWER
    from phalanx.messages.membership import Membership

    if (recording is None) != bool(run):
        raise typer.BadParameter("expected either RUN or --run")
    if recording is not None:
        return checks.live_run(recording, insecure)
    endpoint = checks.endpoint_for(connect, keys)
    folder = checks.identity_for(keys, endpoint, insecure)
    return Membership(
        run, endpoint, secret.encode(), identity if folder else VIEWER, timeout, folder
    )


def register(app: typer.Typer) -> None:
    app.command(rich_help_panel=Job.LOOK)(view)
    app.command(rich_help_panel=Job.LOOK)(export)
    alone = "Run the viewer alone, as plant and agents are run in containers and on many hosts."
    app.command("viewer", help=alone, rich_help_panel=Job.DEPLOY)(view)


def view(
    recording: RunOrRecording = None,
    connect: options.Connect = "",
    run: LiveRun = "",
    secret: options.Secret = "",
    keys: options.KeysFolder = None,
    insecure: options.Insecure = False,
    command_secret: options.CommandSecret = "",
    host: Host = "127.0.0.1",
    port: Port = None,
    origins: Origins = None,
    timeout: options.Timeout = 60.0,
    trust: options.Trust = False,
    effect: Annotated[
        bool, typer.Option("--effect", help="Repeat a run's scenario, and plot its network effect.")
    ] = False,
) -> int:
    """Show a run on a page: a recording, or a live one over Zenoh. Ctrl-C ends it.

    Examples:

      phalanx view runs/unicycles-1
      phalanx view --connect tcp/127.0.0.1:7447 --run r1
    """
    from phalanx.launcher.programs import configure_logging
    from phalanx.messages.keys import OPERATOR, VIEWER

    identity = OPERATOR if command_secret else VIEWER
    membership = live_membership(recording, run, connect, secret, keys, insecure, timeout, identity)
    configure_logging()
    from phalanx_viewer.main import run as show

    try:
        return show(
            membership, recording, command_secret=command_secret.encode(), host=host, port=port,
            origins=tuple(origins or ()), trust=trust, effect=effect,
        )  # fmt: skip
    except (RuntimeError, ValueError, OSError) as error:
        echo_error(error)
        return 3


def export(
    run: options.RunArgument,
    html: Annotated[
        Path | None,
        typer.Option(callback=_FILE, help="Write one HTML file with scene and plots there."),
    ] = None,
    mcap: Annotated[
        Path | None,
        typer.Option(callback=_FILE, help="Write a recording for Foxglove and others there."),
    ] = None,
    parquet: Annotated[
        Path | None, typer.Option(callback=_FOLDER, help="Write the run's tables there, a folder.")
    ] = None,
    csv: Annotated[Path | None, typer.Option(callback=_FOLDER, help="The same as CSV.")] = None,
    trust: options.Trust = False,
) -> int:
    """Export a run: HTML that plays without a server, or data for other tools.

    Examples:

      phalanx export runs/unicycles-1 --html run.html
      phalanx export runs/unicycles-1 --mcap shown.mcap
      phalanx export runs/unicycles-1 --parquet tables
    """
    from phalanx.cli.display import spinner
    from phalanx.launcher.programs import configure_logging
    from phalanx.launcher.streams import warn_of_damage
    from phalanx.recording.read import UnreadableRecordingError, find, read
    from phalanx_viewer.export.write import run as write

    files = {"html": html, "mcap": mcap}
    paths = files | {"parquet": parquet, "csv": csv}
    if not any(paths.values()):
        raise typer.BadParameter(f"expected one of {', '.join(f'--{name}' for name in paths)}")
    configure_logging()
    try:
        for option, path in files.items():
            checks.require_other(f"--{option}", path, [find(run)])
        with spinner("exporting") as show:
            show("reading the recording")
            recorded = read(run, trust)
            warn_of_damage(recorded)
            written = write(recorded, progress=show, **paths)
        echo(*written)
    except (UnreadableRecordingError, OSError) as error:
        echo_error(error)
        return 3
    return 0
