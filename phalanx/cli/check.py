"""phalanx check: what a scenario guarantees, before any run."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from phalanx.cli.options import Overrides, ScenarioArgument, Seed, Trust

if TYPE_CHECKING:
    from phalanx.guarantee.check import CheckReport
    from phalanx.guarantee.formula import Formula

_LARGEST = 1e9
"""A margin from here on is no number to compare with."""
_HOW = {"interval": "proven by intervals", "sampled": "largest sampled"}


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(check)


def check(
    scenario: ScenarioArgument,
    seed: Seed = None,
    overrides: Overrides = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="Save a picture of where the backup control still suffices (PNG)."),
    ] = None,
    strict: Annotated[
        bool, typer.Option(help="Exit with 1 if no run of it could end guaranteed.")
    ] = False,
    trust: Trust = False,
) -> int:
    """Say what a scenario guarantees and what it does not, and what to change.

    Examples:

      phalanx check unicycles
      phalanx check unicycles --set safety.margin=local --set safety.composition=pairs
      phalanx check guaranteed --plot backup.png
    """
    import phalanx
    from phalanx.report.backup import backup_plate, backup_slice
    from phalanx.scenario.user_code import code_trusted
    from phalanx.swarm.rows import build_rows
    from phalanx.swarm.swarm import build_swarm

    with code_trusted(trust):
        resolved = phalanx.load(scenario, overrides or (), seed)
    report = phalanx.check(resolved)
    _show(resolved.name, report)
    if plot is not None:
        found = backup_slice(build_rows(build_swarm(resolved)))
        if found is None:
            print("no picture: it needs two agents with states x and y; this scenario has others")
        else:
            backup_plate(found).figure.savefig(plot, dpi=110)
            print(f"picture: {plot}")
    return 1 if strict and not report.may_be_guaranteed else 0


def _show(name: str, report: "CheckReport") -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    may = "[green]yes[/]" if report.may_be_guaranteed else "[yellow]no[/]"
    table.add_row("scenario", name)
    table.add_row("can end guaranteed", may)
    table.add_row("relative degree q", str(report.relative_degree))
    inside = (
        "inside the set that can be kept (S_I)"
        if report.worst_at_start <= 0
        else "[red]outside the set that can be kept (S_I)[/]"
    )
    table.add_row("start", f"{inside}, largest ψ {report.worst_at_start:.4g}, allowed 0")
    stuck = [agent for agent, holds in report.rows_at_start.items() if not holds]
    rows = f"[yellow]empty for {', '.join(stuck)}[/]" if stuck else "non-empty for every agent"
    waiting = [agent for agent, holds in report.certified.agents.items() if not holds]
    issued = f"[yellow]none for {', '.join(waiting)}[/]" if waiting else "found for every agent"
    table.add_row("inputs with certificates at the start", issued)
    theorem = "[yellow]proves nothing here[/]" if report.gaps else "may apply: the run checks"
    table.add_row("the paper's theorem", theorem)
    table.add_row("inputs that keep the rows at the start (K_i)", rows)
    table.add_row("margin η in force", _by_agent(report.eta_paper))
    table.add_row("margin η by the paper's formula", _formula(report.formula))
    table.add_row("- for the worst pair", _formula(report.pair_formula))
    table.add_row("margin η as a local bound, at the start", _by_agent(report.eta_local))
    table.add_row("Theorem 4", _theorem(report))
    gap = "none" if report.largest_gap is None else f"{report.largest_gap * 1e3:.3g} ms"
    table.add_row("largest sampling gap", f"{gap}, with proven rows at the start")
    delay = "any" if math.isinf(report.largest_delay) else f"{report.largest_delay * 1e3:.3g} ms"
    table.add_row("largest delay", f"{delay}, for what the rows count on")
    Console().print(table)
    for words in report.words:
        print(f"- {words}")


def _theorem(report: "CheckReport") -> str:
    four = report.theorem_4
    if four is None:
        return "not asked: give [workspace], and start inside"
    said = "refuted" if four.holds is False else "not refuted"
    return f"{said} at {four.states} boundary states, largest sum {four.worst:.4g}, allowed 0"


def _formula(found: "Formula | None") -> str:
    if found is None:
        return "unknown: no workspace"
    how = _HOW["interval" if found.proven else "sampled"]
    return f"{found.eta:.4g}, corrected {found.corrected:.4g} ({how})"


def _by_agent(values: "dict[str, float | None] | dict[str, float]") -> str:
    known = {agent: value for agent, value in values.items() if value is not None}
    if not known:
        return "none given: computed at each sample"
    if len({round(value, 9) for value in known.values()}) == 1:
        return _margin(next(iter(known.values())))
    return ", ".join(f"{agent}: {_margin(value)}" for agent, value in known.items())


def _margin(value: float) -> str:
    if value < _LARGEST:
        return f"{value:.4g}"
    return "larger than any input can pay for" if math.isfinite(value) else "unknown"
