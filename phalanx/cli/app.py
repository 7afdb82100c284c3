"""phalanx: the command, its subcommands and its exit statuses."""

from typing import Annotated

import typer
from typer.main import get_command, get_command_name

from phalanx.cli.check import check, compile_scenario
from phalanx.cli.jobs import Job, group_by_job
from phalanx.cli.option_checks import refuse_secrets, require_values
from phalanx.cli.options import with_factor
from phalanx.cli.programs import agent, plant
from phalanx.cli.run import run
from phalanx.cli.runs import runs, scenarios, schema, verify
from phalanx.launcher import interrupt
from phalanx.launcher.streams import echo, echo_error
from phalanx.schema import extensions

FAILED, USAGE_ERROR, STOPPED = 3, 64, 130
_HELP = (
    "Robot swarms that stay safe over a bad network while some of their members attack.\n\n"
    "[bold]phalanx run unicycles[/bold] runs a scenario: every agent, every adversary and the "
    "plant is a process of its own, and they meet over Zenoh.\n\n"
    "Exit status: 0 guaranteed or safe (1 for safe with --strict), 2 violated, 3 the run broke, "
    "64 wrong usage or scenario, 130 stopped by Ctrl-C or SIGTERM."
)


def core() -> typer.Typer:
    """Make the command with the core's subcommands."""
    app = typer.Typer(
        no_args_is_help=True, add_completion=False, rich_markup_mode="rich", help=_HELP
    )
    app.callback()(options)
    app.command(rich_help_panel=Job.RUN)(run)
    app.command(rich_help_panel=Job.RUN)(scenarios)
    app.command("compile", rich_help_panel=Job.RUN)(compile_scenario)
    app.command(rich_help_panel=Job.LOOK)(runs)
    app.command(rich_help_panel=Job.CHECK)(check)
    app.command(rich_help_panel=Job.CHECK)(verify)
    app.command(rich_help_panel=Job.DEPLOY)(plant)
    app.command(rich_help_panel=Job.DEPLOY)(agent)
    app.command(rich_help_panel=Job.EXTEND)(schema)
    return app


def extended() -> typer.Typer:
    """Make the command with the core's subcommands and those of extensions."""
    app, entries = core(), extensions.commands()
    if not any(entry.ours for entry in entries):
        echo_error(f"no commands of extensions are registered: {extensions.REINSTALL}")
    for entry in entries:
        try:
            _extend(app, entry)
        except (Exception, SystemExit) as error:  # another package's code
            echo_error(f"cannot load the commands {entry.name!r} of {entry.package}: {error}")
    group_by_job(app)
    return app


def _extend(app: typer.Typer, entry: extensions.Registered) -> None:
    """Add an extension's commands to the app. Raises ValueError for a name that is taken."""
    if isinstance(entry.register, BaseException):
        raise entry.register
    first = len(app.registered_commands)
    entry.register(app)
    names = [
        command.name or get_command_name(command.callback.__name__)
        for command in app.registered_commands
        if command.callback
    ]
    if duplicates := set(names[first:]) & set(names[:first]):
        del app.registered_commands[first:]
        raise ValueError(f"there is a command {sorted(duplicates)[0]!r} already")


def _print_version(requested: bool) -> None:
    if requested:
        from phalanx import __version__

        echo(f"phalanx {__version__}")
        raise typer.Exit


def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and exit.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Handle the options of the command itself."""


def status(arguments: list[str]) -> int:
    """Run the command, print errors as one message, and return its exit status."""
    try:
        require_values(arguments)
        refuse_secrets(arguments)
        app = core()
        # The core's commands need not wait for extensions, and work if an extension is broken.
        if arguments[:1] != ["--version"] and not _has_command(app, arguments):
            app = extended()
            known = arguments[:1] and arguments[0] in extensions.PACKAGES
            if known and not _has_command(app, arguments):
                raise extensions.missing(arguments[0])
        with extensions.extras_named():
            code = int(app(with_factor(arguments), standalone_mode=False) or 0)
        if code == STOPPED:
            interrupt.raise_pending()  # typer turned the KeyboardInterrupt into a status
        return code
    except (KeyboardInterrupt, typer.Abort):  # an Abort is a RuntimeError
        echo_error("stopped")
        return STOPPED
    except typer.TyperException as error:
        echo_error(error.format_message())
        echo_error("See phalanx --help, or phalanx COMMAND --help.")
        return USAGE_ERROR
    except (ValueError, RuntimeError) as error:
        expected = _status_of(error)
        if expected is None:
            raise
        echo_error(error)
        return expected
    except extensions.MissingExtensionError as error:
        echo_error(error)
        return FAILED
    except (MemoryError, ImportError, SystemError) as error:
        # Under a tight limit often a library's file cannot be mapped, or CPython raises a
        # SystemError in place of a MemoryError.
        echo_error(f"too little memory, or a broken installation: {error}")
        return FAILED
    except OSError as error:  # also if the output cannot be written: the disk may be full
        echo_error(error)
        return FAILED


def _status_of(error: Exception) -> int | None:
    """Return the exit status for an error that a user can cause; None for any other."""
    # Imported here, because it takes long and most commands do not need it.
    from phalanx.launcher.engine import EngineError
    from phalanx.messages.kinds import StepFailedError
    from phalanx.recording.read import UnreadableRecordingError
    from phalanx.scenario.model import ScenarioError
    from phalanx.theory.models.world import WorldError
    from phalanx.wire.session import HubError

    if isinstance(error, ScenarioError):
        return USAGE_ERROR
    failed = EngineError | HubError | StepFailedError | UnreadableRecordingError | WorldError
    return FAILED if isinstance(error, failed) else None


def _has_command(app: typer.Typer, arguments: list[str]) -> bool:
    """Return whether the first argument is one of the app's commands."""
    return bool(arguments) and arguments[0] in get_command(app).commands  # type: ignore[attr-defined]
