"""phalanx compile: a scenario's functions as machine code."""

import typer

from phalanx.cli.options import Overrides, ScenarioArgument, Seed, Trust
from phalanx.launcher.streams import echo


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("compile")(compile_scenario)


def compile_scenario(
    scenario: ScenarioArgument, seed: Seed = None, overrides: Overrides = None, trust: Trust = False
) -> int:
    """Before many runs: compile a scenario's functions with a C compiler, once.

    Later runs of it, with any seed and engine, load them from the cache: ~/.cache/phalanx, or
    PHALANX_CACHE. They give the same bits in less time. The compiler is cc, that of the wheel
    ziglang, or PHALANX_CC; empty values of both variables switch all of it off.
    """
    import phalanx
    from phalanx.cli.display import spinner
    from phalanx.launcher.compile import compile_scenario
    from phalanx.schema.user_code import code_trusted

    with code_trusted(trust):
        resolved = phalanx.load(scenario, overrides or (), seed)
    with spinner("compiling") as show:
        count = compile_scenario(resolved, lambda done, of: show(f"{done} of {of} functions"))
    known = "; those that it shares with earlier ones were known" if count else ": all were known"
    echo(f"{resolved.name}: {count} functions compiled{known}")
    return 0
