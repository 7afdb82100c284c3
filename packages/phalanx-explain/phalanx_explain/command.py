"""phalanx explain: the reasons of an input that is not the one that an agent wanted."""

import json
from typing import Annotated

import typer
from msgspec.structs import asdict

from phalanx.cli.jobs import Job
from phalanx.cli.options import RunArgument, Trust
from phalanx.guarantee.verdict import Deadlock
from phalanx.launcher.streams import echo


def register(app: typer.Typer) -> None:
    app.command(rich_help_panel=Job.CHECK)(explain)


def explain(
    run: RunArgument,
    agent: Annotated[str | None, typer.Option(help="The name of a normal agent.")] = None,
    at: Annotated[
        float | None,
        typer.Option(min=0.0, help="Virtual time in seconds: its last sample up to then."),
    ] = None,
    worst: Annotated[
        bool, typer.Option("--worst", help="When an input was farthest from what the law wanted.")
    ] = False,
    stuck: Annotated[
        bool,
        typer.Option(
            "--stuck", help="Amid the longest time that one stood though it wanted to move."
        ),
    ] = False,
    changes: Annotated[
        bool, typer.Option(help="Look for changes that would free it: seconds for each field.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print all numbers as JSON.")] = False,
    trust: Trust = False,
) -> int:
    """Explain why an agent did not do what its law wanted: rows, their costs, what would free it.

    The run is repeated up to then, and the agent's own controller decides again.

    Examples:

      phalanx explain runs/crossing-1 --agent west --at 4
      phalanx explain runs/crossing-1 --stuck
    """
    import phalanx
    from phalanx.cli.display import TextTable, spinner
    from phalanx_explain import moments
    from phalanx_explain.explanation import explain as explanation_of

    if (at is not None) + worst + stuck != 1:
        raise typer.BadParameter("expected one of --at, --worst and --stuck")
    if at is not None and agent is None:
        raise typer.BadParameter("expected --agent with --at")
    recording = phalanx.open(run, trust=trust).recording
    deadlocks: list[Deadlock] = []
    if stuck:
        agent, at, deadlocks = moments.stuck(recording, agent)
    elif at is None:
        agent, at = moments.worst(recording, agent)
    assert agent is not None
    with spinner(f"explaining agent {agent} at {at:g} s"):
        explanation = explanation_of(recording, agent, at, changes)
    if as_json:
        waiting = {"deadlocks": [asdict(d) | {"waits_for": d.waits_for} for d in deadlocks]}
        numbers = explanation.as_json() | (waiting if stuck else {})
        echo(*json.dumps(numbers, indent=2).splitlines())
        return 0
    if deadlocks:
        echo(*moments.who_waits(recording, deadlocks))
    echo(*explanation.sentences())
    if explanation.binding:
        from rich.console import Console

        table = TextTable("row of", "part", "term", "cost", "as distance")
        for row in explanation.table():
            table.add_row(*row)
        Console().print(table)
    return 0
