"""phalanx test-agent: whether a user's own program keeps the rules of an agent."""

import shlex
from collections.abc import Iterator
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phalanx.cli.jobs import Job
from phalanx.cli.options import Overrides
from phalanx.launcher.streams import echo

if TYPE_CHECKING:
    from phalanx.launcher.run import Run
    from phalanx.recording.records import Step
    from phalanx.scenario.agents import AgentGroup, Clock

_LONGEST, _TIMEOUT = 1.0, 4.0
"""Longest run [s of virtual time], and the plant's wait in it [s]."""
_MOST_LATE = 0.1
"""Share of answers that may take longer than a period: the machine has other work too."""


class Protocol(StrEnum):
    """The protocols of programs."""

    STDIO = "stdio"
    ZENOH = "zenoh"


def register(app: typer.Typer) -> None:
    """Add the command."""
    settings = {"allow_interspersed_args": False}  # what follows is the program's
    app.command("test-agent", rich_help_panel=Job.EXTEND, context_settings=settings)(conform)


def conform(
    command: Annotated[list[str], typer.Argument(help="The program, and its arguments.")],
    scenario: Annotated[
        str, typer.Option(help="A scenario, whose first group of normal agents it makes up.")
    ] = "one-on-one",
    protocol: Annotated[Protocol, typer.Option(help="How it speaks.")] = Protocol.STDIO,
    overrides: Overrides = None,
) -> int:
    """Test whether your own program keeps the rules of an agent, and print those that it breaks.

    It is run for a second of the scenario, without a filter; by Zenoh once more in real time, which
    shows who is late. Exit status: 1 if it breaks a rule.

      phalanx test-agent ./my_agent
      phalanx test-agent --scenario warehouse python examples/programs/cart.py
    """
    import phalanx
    from phalanx.scenario.load import field_and_value

    table: dict[str, Any] = dict(map(field_and_value, overrides or ()))
    plain = phalanx.load(scenario, table)
    index = next(n for n, group in enumerate(plain.agents) if group.role == "normal")
    group = plain.agents[index]
    fields: dict[str, Any] = {"program": command, "protocol": str(protocol), "filter": False}
    fields |= {"controller": None}
    fields["keeps"] = group.radio.rows if group.radio else "halves"
    table |= {f"agents.{index}.{field}": value for field, value in fields.items()}
    table |= {"duration": min(plain.duration, _LONGEST), "time.timeout": _TIMEOUT}
    engine = "in-process" if protocol is Protocol.STDIO else "processes"
    tested, name = phalanx.load(scenario, table), shlex.join(command)
    steps, mistakes = _steps(phalanx.run(tested, engine=engine), group)
    waits = [step.solve_time for step in steps if step.k > 0]  # to start takes longer
    if protocol is Protocol.ZENOH and not mistakes:
        timed, mistakes = _steps(phalanx.run(tested, real_time=1.0), group)
        waits = [gap for agent in group.names for gap in _gaps(timed, agent, group.clock)]
    mistakes += _late(waits, group.clock.period)
    echo(*(f"{name} breaks a rule: {words}" for words in mistakes))
    if not mistakes:
        slowest = f"the slowest after {1e3 * max(waits, default=0.0):.3g} ms"
        echo(f"{name} keeps the rules: {len(steps)} answers, {slowest}")
    return 1 if mistakes else 0


def _steps(run: "Run", group: "AgentGroup") -> "tuple[list[Step], list[str]]":
    """Return the answers of a group in a run, and in words the rules that they break."""
    steps, summary = (
        [step for step in run.recording.steps if step.agent in group.names],
        run.summary,
    )
    assert summary is not None
    if summary.outcome == "stopped":
        raise KeyboardInterrupt
    mistakes = [summary.reason] if summary.outcome == "broken" else []
    if not steps and not mistakes:
        mistakes = ["expected an answer to a sample, got none"]
    if outside := [step.t for step in steps if step.origin == "controller-projected"]:
        where = f"the first at t = {outside[0]:g} s"
        mistakes.append(f"{len(outside)} of {len(steps)} inputs are outside U, {where}")
    refused = summary.rejected.items()
    return steps, mistakes + [f"{n} of its messages were refused: {why}" for why, n in refused]


def _gaps(steps: "list[Step]", agent: str, clock: "Clock") -> Iterator[float]:
    """Yield for each answer in real time how long it took, by the sample after it [s].

    None is taken while an answer is missing: so it is known to half a period.
    """
    times = [step.t for step in steps if step.agent == agent]
    yield from (b - a - clock.jitter - 0.5 * clock.period for a, b in pairwise(times))


def _late(waits: list[float], period: float) -> list[str]:
    """Return in words that too many answers take longer than a period [s], if they do."""
    late = [wait for wait in waits if wait > period]
    if len(late) <= _MOST_LATE * len(waits):
        return []
    allowed = f"expected within {1e3 * period:g} ms"
    return [f"{len(late)} of {len(waits)} answers are late, {allowed}, got {1e3 * max(late):.3g}"]
