"""phalanx run: a scenario from its file to its verdict, on this machine."""

import contextlib
import resource
import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phalanx.cli.allowed import require_folder, require_port
from phalanx.cli.endpoints import require_endpoint, require_here
from phalanx.cli.options import (
    Engine,
    Insecure,
    Overrides,
    RealTimeFactor,
    ScenarioArgument,
    Secret,
    Seed,
    Speed,
)
from phalanx.cli.terminal import complain, say
from phalanx.extensions.registered import extension
from phalanx.launcher import interrupt
from phalanx.launcher.engine import DEFAULT_ENGINE, ENGINES, prepare, silent

if TYPE_CHECKING:
    from phalanx import Outcome, Run

Out = Annotated[Path, typer.Option(callback=require_folder, help="Folder for the folders of runs.")]
Listen = Annotated[
    str | None,
    typer.Option(
        callback=require_endpoint,
        help="Zenoh endpoint of the hub; by default a free port on 127.0.0.1.",
    ),
]
Report = Annotated[bool, typer.Option(help="Make the report when the run is over.")]
Strict = Annotated[bool, typer.Option(help="Exit with 1 if the run was safe but not guaranteed.")]
Profile = Annotated[
    bool, typer.Option("--profile", help="Say where every program's wall time went.")
]
View = Annotated[
    bool,
    typer.Option(
        "--view", help="Show the run on a page at real time, and replay it when it is over."
    ),
]
Commands = Annotated[
    bool,
    typer.Option(
        "--commands",
        help="With --view: the page may pause, step, change the network, kill and so on.",
    ),
]
Port = Annotated[
    int | None,
    typer.Option(
        callback=require_port,
        help="With --view: of the page; by default 8080 or the next free one.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(run)


def run(
    scenario: ScenarioArgument,
    seed: Seed = None,
    overrides: Overrides = None,
    engine: Engine = DEFAULT_ENGINE,
    out: Out = Path("runs"),
    real_time: RealTimeFactor = None,
    listen: Listen = None,
    secret: Secret = "",
    insecure: Insecure = False,
    report: Report = True,
    strict: Strict = False,
    profile: Profile = False,
    view: View = False,
    speed: Speed = None,
    commands: Commands = False,
    port: Port = None,
) -> int:
    """Run a scenario: plant and agents, each in its own process, to a verdict.

    Ctrl-C or SIGTERM stops it, with a verdict and all that was recorded; one more ends it at once.

    Examples:

      phalanx run unicycles
      phalanx run unicycles --seed 7 --set safety.eta=0
      phalanx run unicycles --set network.loss=0.3 --set network.delay=0.01
      phalanx run unicycles --engine in-process --no-report
      phalanx run my-scenario.toml --out /data/runs --strict
      phalanx run unicycles --view --commands
      phalanx run formation3d --profile --no-report
      phalanx run unicycles --real-time --set time.latency=0.005
    """
    if not ENGINES[engine].hub and (view or listen or secret or real_time or speed):
        names = "--view, --listen, --secret-file, --real-time or --speed"
        raise typer.BadParameter(f"--engine {engine}: expected no {names}")
    if listen is not None:
        require_here(listen, insecure, "--insecure; phalanx plant has --keys")
    # Libraries that find no memory die in words of their own: there this process loads them first.
    if resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        with contextlib.suppress(OSError):  # said when the run begins
            prepare(engine)
    import phalanx
    from phalanx.launcher.streams import outlive_readers

    outlive_readers()
    resolved = phalanx.load(scenario, overrides or (), seed)
    from phalanx.cli.display import progress
    from phalanx.guarantee.verdict import exit_status

    if not view and (commands or port is not None):
        raise typer.BadParameter("--commands, --port: expected --view with them")
    policy = phalanx.CommandPolicy(
        secret=secrets.token_bytes(16) if commands else b"",
        speed=float(view) if speed is None else speed,
    )
    with _page(port, policy.secret) if view else contextlib.nullcontext() as page:
        try:
            with progress(resolved) as show:
                finished = phalanx.run(
                    resolved,
                    engine=engine,
                    out=out,
                    progress=show,
                    commands=policy,
                    listen=listen,
                    secret=secret.encode(),
                    announce=page.serve if page else silent,
                    profile=profile,
                    real_time=real_time,
                )
        except phalanx.EngineError as error:
            complain(f"broken: {error}")
            return 3
        except ConnectionError as error:
            # A signal to all ends what starts the programs, often before it is answered here.
            interrupt.raise_unanswered()
            complain(f"broken: the process that starts the programs is gone: {error.strerror}")
            return 3
        except OSError as error:
            raise typer.BadParameter(
                f"--out: cannot create a folder in {out}: {error.strerror}"
            ) from error
        outcome = _told(finished, profile, report)
        if page:
            _wait_for(page)
    return exit_status(outcome, strict)


def _page(port: int | None, command_secret: bytes) -> Any:
    """The page of a run, at a port that is chosen before anything is started."""
    token = secrets.token_urlsafe(16) if command_secret else ""
    try:
        page = extension("live-page")(port, command_secret, token)
    except OSError as error:
        raise typer.BadParameter(f"--port: {error}") from error
    say(f"viewer: {page.url}")
    return page


def _told(finished: "Run", profile: bool, report: bool) -> "Outcome":
    """Print the key figures of the run, the verdict last."""
    from phalanx.cli.display import last_line, print_profile, print_summary

    summary = finished.summary
    assert summary is not None
    print_summary(summary)
    if profile:
        print_profile(finished)
    if report:
        _write_report(finished)
    say(f"{last_line(summary)} ({finished.folder})")
    return summary.outcome


def _wait_for(page: Any) -> None:
    """Let the page go on until Ctrl-C."""
    if interrupt.terminated():
        return
    with contextlib.suppress(KeyboardInterrupt):
        if page.served:
            say("the page replays the run; Ctrl-C ends it")
        page.wait()


def _write_report(finished: "Run") -> None:
    from phalanx import UnreadableRecordingError
    from phalanx.cli.display import doing

    try:
        with doing("drawing the report") as show:
            written = finished.report(show)
        say(f"report: {written}")
    except (UnreadableRecordingError, OSError) as error:
        complain(f"no report: {error}")
