"""Live commands: sealed with the command secret, once, and only possible ones."""

import numpy as np
import pytest
from phalanx_plant.clock.commands import CommandQueue

from phalanx.faults.commands import Command, CommandKind, CommandPolicy
from phalanx.wire.keys import Keys
from phalanx.wire.messages import CommandMessage
from phalanx.wire.seal import Sealer
from tests.unit.plant.signals import outlasting_a_wait

KEY, SECRET = Keys("run").command, b"the command secret"
LOSS = Command(t=0.0, kind=CommandKind.LOSS, value=0.5)


@pytest.fixture
def commands() -> CommandQueue:
    return CommandQueue(CommandPolicy(secret=SECRET), ("1", "2"))


def put(commands: CommandQueue, number: int, command: Command = LOSS, secret: bytes = SECRET):
    message = CommandMessage(number=number, command=command)
    commands.on_command(KEY, Sealer(secret).seal(KEY, message))


def applied(commands: CommandQueue) -> list[str]:
    return [
        command.kind for command in commands.wait_until(np.nextafter(0.0, 1.0), 0.0, lambda: None)
    ]


@pytest.mark.parametrize("number", [5, 4])
def test_a_command_is_applied_once_and_no_earlier_one_after_it(commands: CommandQueue, number: int):
    put(commands, 5)
    put(commands, number)
    assert applied(commands) == ["loss"]
    assert commands.refusals.counts == {"command: out of order": 1}


def test_a_command_without_the_secret_is_refused(commands: CommandQueue):
    put(commands, 5, secret=b"guessed")
    assert applied(commands) == []
    assert commands.refusals.counts == {"command: bad seal": 1}


@pytest.mark.parametrize(
    "command",
    [
        Command(0.0, CommandKind.FREEZE, "9"),
        Command(0.0, "explode"),
        Command(0.0, CommandKind.LOSS, value=2.0),
        Command(0.0, CommandKind.DELAY, value=-1.0),
        Command(0.0, CommandKind.DELAY, value=float("nan")),
    ],
)
def test_an_impossible_command_is_refused(commands: CommandQueue, command: Command):
    put(commands, 5, command)
    assert applied(commands) == []
    assert commands.refusals.counts == {"command: wrong command": 1}


def test_a_signal_that_outlasts_a_wait_for_the_wall_clock_leaves_it_its_end():
    paced = CommandQueue(CommandPolicy(secret=SECRET, speed=1.0), ("1", "2"))
    paced.pace.restart(0.0)
    with outlasting_a_wait(lambda: put(paced, 1)):
        assert paced.wait_until(0.1, 0.0, lambda: None) == []
