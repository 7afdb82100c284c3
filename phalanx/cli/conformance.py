"""phalanx test-agent: whether a user's own program keeps the rules of an agent."""

import shlex
from collections.abc import Iterator
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phalanx.cli.options import Overrides
from phalanx.launcher.streams import echo

if TYPE_CHECKING:
    from phalanx.recording.records import Step
    from phalanx.scenario.agents import AgentGroup

_LONGEST, _TIMEOUT = 1.0, 4.0
"""Longest run [s of virtual time], and the plant's wait in it [s]."""
_MOST_LATE = 0.1
"""Share of answers that may take longer than a period: the machine has other work too."""


class Protocol(StrEnum):
    """The protocols of programs."""

    STDIO = "stdio"
    ZENOH = "zenoh"


def conform(
    command: Annotated[list[str], typer.Argument(help="The program, and its arguments.")],
    scenario: Annotated[
        str, typer.Option(help="A scenario, whose first group of normal agents it makes up.")
    ] = "one-on-one",
    protocol: Annotated[Protocol, typer.Option(help="How it speaks.")] = Protocol.STDIO,
    overrides: Overrides = None,
) -> int:
    """Test whether your own program keeps the rules of an agent, and print those that it breaks.

    It is run for a second of the scenario, without a filter. Exit status: 1 if it breaks a rule.

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
    run = phalanx.run(phalanx.load(scenario, table), engine=engine)
    steps = [step for step in run.recording.steps if step.agent in group.names]
    summary = run.summary
    assert summary is not None
    if summary.outcome == "stopped":
        raise KeyboardInterrupt
    reasons = [summary.reason] if summary.outcome == "broken" else []
    if not steps and not reasons:
        reasons = ["expected an answer to a sample, got none"]
    mistakes = [*reasons, *_mistakes(steps, group, summary.rejected)]
    name = shlex.join(command)
    echo(*(f"{name} breaks a rule: {words}" for words in mistakes))
    if not mistakes:
        slowest = max((1e3 * step.solve_time for step in steps), default=0.0)
        echo(f"{name} keeps the rules: {len(steps)} answers, the slowest after {slowest:.3g} ms")
    return 1 if mistakes else 0


def _mistakes(steps: "list[Step]", group: "AgentGroup", rejected: dict[str, int]) -> Iterator[str]:
    """Yield, in words, the rules broken by answers that did not end the run."""
    outside = [step for step in steps if step.origin == "controller-projected"]
    if outside:
        at = f"the first at t = {outside[0].t:g} s"
        yield f"{len(outside)} of {len(steps)} inputs are outside U, {at}"
    warm = [step for step in steps if step.k > 0]  # to start takes longer
    late = [step.solve_time for step in warm if step.solve_time > group.clock.period]
    if len(late) > _MOST_LATE * len(warm):
        allowed = f"expected within {1e3 * group.clock.period:g} ms"
        yield f"{len(late)} of {len(warm)} answers are late, {allowed}, got {1e3 * max(late):.3g}"
    for reason, count in rejected.items():
        yield f"{count} of its messages were refused: {reason}"
