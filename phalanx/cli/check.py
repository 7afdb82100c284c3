"""phalanx check and compile: the guarantees of a scenario, and its functions as machine code."""

import textwrap
from typing import TYPE_CHECKING, Annotated

import typer

from phalanx.cli.options import Overrides, ScenarioArgument, Seed, Trust
from phalanx.launcher.streams import echo, printable

if TYPE_CHECKING:
    from phalanx.guarantee.check_report import CheckReport
    from phalanx.scenario.model import Scenario


def check(
    scenario: ScenarioArgument,
    seed: Seed = None,
    overrides: Overrides = None,
    strict: Annotated[
        bool, typer.Option(help="Exit with 1 if no run of it could end guaranteed.")
    ] = False,
    trust: Trust = False,
) -> int:
    """Before a run: print what a scenario guarantees, what it does not, and what to change.

    To compare a finished run with its repetition use `phalanx verify`; to prove a recording safe
    with independent code, `phalanx certify`.

    Examples:

      phalanx check unicycles
      phalanx check guaranteed --set safety.margin=local
      phalanx check unicycles --set network.loss=0.3 --set safety.information=in-flight
    """
    import phalanx
    from phalanx.cli.display import spinner

    resolved = phalanx.load(scenario, overrides or (), seed, trust=trust)
    with spinner(f"checking {resolved.name}") as show:
        report = phalanx.check(resolved, progress=show)
    _show(resolved, report)
    return 1 if strict and not report.may_be_guaranteed else 0


def _show(scenario: "Scenario", report: "CheckReport") -> None:
    from rich.console import Console

    from phalanx.cli.display import TextTable, styled

    echo(f"{scenario.name}: {report.answer}")
    table = TextTable("requirement", "found", "allowed", "paper")
    for row in report.table:
        value = styled(row.value, "" if row.holds else "yellow")
        table.add_row(row.name, value, row.allowed, row.equation)
    console = Console()
    console.print(table)
    bullet = textwrap.TextWrapper(
        console.width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    for sentence in report.words:
        echo(*bullet.wrap(f"- {printable(sentence)}"))


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
    from phalanx.launcher.simulation import compile_scenario

    resolved = phalanx.load(scenario, overrides or (), seed, trust=trust)
    with spinner("compiling") as show:
        count = compile_scenario(resolved, lambda count, of: show(f"{count} of {of} functions"))
    rest = "; those that it shares with earlier ones were known" if count else ": all were known"
    echo(f"{resolved.name}: {count} functions compiled{rest}")
    return 0
