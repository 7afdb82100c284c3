"""phalanx: the command, its subcommands and its exit statuses."""

from typing import Annotated

import typer
from typer.main import get_command, get_command_name

from phalanx.cli import check, network, programs, run, runs, tap
from phalanx.cli.allowed import refuse_secrets, require_values
from phalanx.cli.options import with_factor
from phalanx.cli.terminal import complain, say
from phalanx.extensions.registered import AGAIN, Registered, commands
from phalanx.launcher import interrupt

USAGE_ERROR, STOPPED = 64, 130
_HELP = """Robot swarms that stay safe over a bad network while some of their members attack.

    [bold]phalanx run unicycles[/bold] runs a scenario: every agent, every adversary and the plant
    is a process of its own, and they meet over Zenoh.

    Exit status: 0 guaranteed or safe (1 for safe with --strict), 2 violated, 3 the run broke,
    64 wrong usage or scenario, 130 stopped by Ctrl-C or SIGTERM.
    """


def core() -> typer.Typer:
    """The command with what the core brings."""
    app = typer.Typer(
        no_args_is_help=True, add_completion=False, rich_markup_mode="rich", help=_HELP
    )
    app.callback()(options)
    for module in (run, check, runs, tap, network, programs):
        module.register(app)
    return app


def extended() -> typer.Typer:
    """The command with that, and what extensions register."""
    app, found = core(), commands()
    if not any(entry.ours for entry in found):
        complain(f"no commands of extensions are registered: {AGAIN}")
    for entry in found:
        try:
            _extend(app, entry)
        except (Exception, SystemExit) as error:  # another package's code
            complain(f"{entry.name} of {entry.package} brings no commands: {error}")
    return app


def _extend(app: typer.Typer, entry: Registered) -> None:
    """Have the app know an extension's commands. Raises ValueError for a name that is taken."""
    if isinstance(entry.register, BaseException):
        raise entry.register
    known = len(app.registered_commands)
    entry.register(app)
    names = [
        each.name or get_command_name(each.callback.__name__)
        for each in app.registered_commands
        if each.callback
    ]
    if taken := set(names[known:]) & set(names[:known]):
        del app.registered_commands[known:]
        raise ValueError(f"there is a command {sorted(taken)[0]!r} already")


def _print_version(asked: bool) -> None:
    if asked:
        from phalanx import __version__

        say(f"phalanx {__version__}")
        raise typer.Exit


def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and exit.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """What holds for every command."""


def status(arguments: list[str]) -> int:
    """Run the command and return its exit status; errors are one readable message."""
    try:
        require_values(arguments)
        refuse_secrets(arguments)
        app = core()
        # What the core brings does not wait for extensions to be looked for, nor break by them.
        if arguments[:1] != ["--version"] and not _brings(app, arguments):
            app = extended()
        found = int(app(with_factor(arguments), standalone_mode=False) or 0)
        if found == STOPPED:
            interrupt.raise_unanswered()  # typer made an exit status of it
        return found
    except typer.TyperException as error:
        complain(error.format_message())
        complain("See phalanx --help, or phalanx COMMAND --help.")
        return USAGE_ERROR
    except ValueError as error:
        # It takes long to import, and a run has better use for the time.
        from phalanx.scenario.load import ScenarioError

        if not isinstance(error, ScenarioError):
            raise
        complain(error)
        return USAGE_ERROR
    except (MemoryError, ImportError, SystemError) as error:
        # Under a tight limit it is often a library's file that cannot be mapped; now and then
        # CPython fails without saying that it was memory.
        complain(f"too little memory, or a broken installation: {error}")
        return 3
    except OSError as error:  # of the reader of what is printed: a full disk, say
        complain(error)
        return 3
    except (KeyboardInterrupt, typer.Abort):
        complain("stopped")
        return STOPPED


def _brings(app: typer.Typer, arguments: list[str]) -> bool:
    """Whether the first argument is one of the app's commands."""
    return bool(arguments) and arguments[0] in get_command(app).commands  # type: ignore[attr-defined]
