"""phalanx run: run a scenario on this machine, to its verdict."""

import contextlib
import resource
import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phalanx.cli import option_checks as checks
from phalanx.cli import options
from phalanx.launcher import interrupt
from phalanx.launcher.engine import DEFAULT_ENGINE, ENGINES, prepare, silent
from phalanx.launcher.streams import echo, echo_error
from phalanx.schema.extensions import MissingExtensionError, extension

if TYPE_CHECKING:
    from phalanx import Outcome, Run

Out = Annotated[
    Path, typer.Option(callback=checks.require_folder, help="Parent of the runs' folders.")
]
Listen = Annotated[
    str | None,
    typer.Option(
        callback=checks.require_endpoint,
        help="Zenoh endpoint of the hub; by default a free port on 127.0.0.1.",
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Read robots and compute inputs, but send them nothing.")
]
Report = Annotated[bool, typer.Option(help="Make the report when the run is over.")]
Strict = Annotated[bool, typer.Option(help="Exit with 1 if the run was safe but not guaranteed.")]
View = Annotated[
    bool,
    typer.Option(
        "--view",
        help="Show the run on a page in real time, and replay it when it is over. Waits for no "
        "browser.",
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
        callback=checks.require_port,
        help="With --view: port of the page; by default 8080 or the next free one.",
    ),
]


def run(
    context: typer.Context,
    scenario: options.ScenarioArgument,
    seed: options.Seed = None,
    overrides: options.Overrides = None,
    engine: options.Engine = DEFAULT_ENGINE,
    out: Out = Path("runs"),
    real_time: options.RealTimeFactor = None,
    dry_run: DryRun = False,
    listen: Listen = None,
    secret: options.Secret = "",
    insecure: options.Insecure = False,
    report: Report = True,
    strict: Strict = False,
    view: View = False,
    speed: options.Speed = None,
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
      phalanx run unicycles --real-time --set time.latency=0.005
    """
    if not ENGINES[engine].hub:
        # The environment may be meant for programs that have one.
        secret = secret if _is_option(context, "secret") else ""
        real_time = real_time if _is_option(context, "real_time") else None
        if view or listen or secret or real_time or speed:
            names = "--view, --listen, --secret-file, --real-time or --speed"
            raise typer.BadParameter(f"--engine {engine}: expected no {names}")
    checks.require_here(listen, insecure, "--insecure; phalanx plant has --keys")
    # Under a limit of memory this process loads the libraries first, to report their failure.
    if resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        with contextlib.suppress(OSError):  # reported when the run begins
            prepare(engine)
    import phalanx
    from phalanx.launcher.streams import ignore_closed_pipes

    ignore_closed_pipes()
    resolved = phalanx.load(scenario, overrides or (), seed)
    checks.require_here(getattr(resolved.fresh_world(), "router", None), insecure, "--insecure")
    if dry_run:
        if not hasattr(resolved.fresh_world(), "dry_run"):
            raise typer.BadParameter("--dry-run: expected a world of robots, such as ros2")
        resolved = phalanx.load(scenario, [*(overrides or ()), "world.dry_run=true"], seed)
    from phalanx.cli.display import progress
    from phalanx.guarantee.verdict import exit_status
    from phalanx.recording.write import RecordingError

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
                    real_time=real_time,
                )
        except (phalanx.EngineError, RecordingError) as error:
            echo_error(f"broken: {error}")
            return 3
        except OSError as error:
            raise typer.BadParameter(
                f"--out: cannot create a folder in {out}: {error.strerror}"
            ) from error
        outcome = _show(finished, report)
        if dry_run:
            echo("dry run: nothing was sent to the robots")
        if page:
            _wait_for(page)
    return exit_status(outcome, strict)


def _is_option(context: typer.Context, name: str) -> bool:
    """Return whether a value is from the command line, not a default or from the environment."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _page(port: int | None, command_secret: bytes) -> Any:
    """Make the page of a run, and choose its port before anything is started."""
    token = secrets.token_urlsafe(16) if command_secret else ""
    try:
        page = extension("live-page")(port, command_secret, token)
    except OSError as error:
        raise typer.BadParameter(f"--port: {error}") from error
    echo(f"viewer: {page.url}", "the run waits for no browser, and is replayed when it is over")
    return page


def _show(finished: "Run", report: bool) -> "Outcome":
    """Print the key figures of the run, the verdict last."""
    from phalanx.cli.display import last_line, print_summary

    summary = finished.summary
    assert summary is not None
    print_summary(summary, _details(finished))
    if report:
        _write_report(finished)
    if summary.on_theorem:
        echo(summary.on_theorem)
    echo(f"{last_line(summary)} ({finished.folder})")
    return summary.outcome


def _details(finished: "Run") -> dict[str, str]:
    """Describe how a swarm did its task, and its traffic, unless the recording is too large."""
    from phalanx import UnreadableRecordingError
    from phalanx.guarantee.verdict import waiting_in_words
    from phalanx.messages.traffic import traffic_in_words
    from phalanx.recording.metrics.table import in_words, metrics_of
    from phalanx.recording.read import find, swarm_of
    from phalanx.theory.expressions.user_methods import MistakenMethodError

    try:
        if find(finished.folder).stat().st_size > _LARGE:
            return {"task": "a large recording: see metrics in the report"}
        swarm = swarm_of(finished.recording)
        normal = [swarm.names[i] for i in swarm.normal]
        task = in_words(metrics_of(finished.recording, swarm), normal)
        rows = {"task": task, "broadcasts": traffic_in_words(swarm)}
        summary = finished.summary
        if summary and summary.promise:
            rows["promise"] = str(summary.promise)
        if summary and summary.deadlocks:
            why = f"phalanx explain {finished.folder} --stuck"
            rows["waiting"] = f"{waiting_in_words(summary.deadlocks)}; why: {why}"
        return rows
    except (UnreadableRecordingError, MistakenMethodError, OSError) as error:
        return {"task": f"unknown: {error}"}


_LARGE = 16 * 2**20
"""Size of a recording that takes too many seconds to read after each run [bytes]."""


def _wait_for(page: Any) -> None:
    """Serve the page until Ctrl-C."""
    if interrupt.sigterm_received():
        return
    with contextlib.suppress(KeyboardInterrupt):
        if page.served:
            echo("the page replays the run; press Ctrl-C to end it")
        page.wait()


def _write_report(finished: "Run") -> None:
    from phalanx import UnreadableRecordingError
    from phalanx.cli.display import spinner

    try:
        with spinner("drawing the report") as show:
            written = finished.report(show)
        echo(f"report: {written}")
    except (UnreadableRecordingError, MissingExtensionError, OSError) as error:
        echo_error(f"no report: {error}")
