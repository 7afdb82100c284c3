"""Live commands: sealed with the command secret, once, and only possible ones."""

import msgspec
import numpy as np
import pytest
from phalanx_plant.clock.commands import CommandQueue, Pace, declared

from phalanx.faults.commands import Command, CommandKind, CommandPolicy, Condition, FaultState
from phalanx.messages.frames import CommandMessage
from phalanx.messages.keys import Keys
from phalanx.messages.seal import Sealer
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
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


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_run_waits_for_ever_where_it_pauses(speed: float):
    pace = Pace(speed)
    pace.stop_at(0.5, 0.0)
    assert pace.wait(0.5) < pace.wait(np.nextafter(0.5, 1.0)) == np.inf
    pace.stop_at(np.inf, 0.5)
    assert pace.wait(0.6) < np.inf


def test_a_signal_that_outlasts_a_wait_for_the_wall_clock_leaves_it_its_end():
    paced = CommandQueue(CommandPolicy(secret=SECRET, speed=1.0), ("1", "2"))
    paced.pace.restart(0.0)
    with outlasting_a_wait(lambda: put(paced, 1)):
        assert paced.wait_until(0.1, 0.0, lambda: None) == []


def fault(kind: str, at: float, until: float | None = None, agent: str = "1") -> dict[str, object]:
    lasts = {} if until is None else {"for": until - at}
    return {"kind": kind, "at": at, "agents": [agent], **lasts}


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ([fault("pause", 1, 4), fault("pause", 2, 3)], ".fff..."),
        ([fault("pause", 3, 5), fault("pause", 1, 4)], ".ffff.."),
        ([fault("pause", 2, 4), fault("pause", 1, 2)], ".fff..."),
        ([fault("pause", 1, 3), fault("pause", 2, 4, agent="2")], ".ff...."),
        ([fault("restart", 1, 3), fault("restart", 2, 5)], ".dddd.."),
        ([fault("kill", 2), fault("restart", 1, 3)], ".dddddd"),
        ([fault("restart", 1, 3), fault("kill", 4)], ".dd.ddd"),
        ([fault("pause", 1, 5), fault("restart", 2, 3)], ".fdff.."),
        ([fault("restart", 1, 3), fault("pause", 2, 5)], ".ddff.."),
        ([fault("pause", 3, 5), fault("restart", 1, 3)], ".ddff.."),
        ([fault("restart", 1, 5), fault("pause", 2, 3)], ".dddd.."),
    ],
)
def test_of_faults_that_overlap_none_ends_another(faults, expected):
    queue = CommandQueue(CommandPolicy(), ("1", "2", "3", "4", "5"))
    queue.declare(declared(build_swarm(load("unicycles", {"faults": faults}))))
    state, letters = FaultState(("1", "2", "3", "4", "5")), ""
    letter = {Condition.FINE: ".", Condition.FROZEN: "f", Condition.DEAD: "d"}
    for t in range(7):
        for command in queue.due(t):
            state.apply(command)
        letters += letter[state.condition[0]]
    assert letters == expected


@pytest.mark.parametrize(("real_time", "expected"), [(False, ["speed"]), (True, [])])
def test_speed_0_is_refused_in_words_in_real_time_alone(real_time, expected):
    policy = CommandPolicy(secret=SECRET, speed=1.0, real_time=real_time)
    queue = CommandQueue(policy, ("1", "2"))
    put(queue, 5, Command(0.0, CommandKind.SPEED))
    assert [command.kind for command in queue.due(0.0)] == expected
    assert queue.pace.speed == float(real_time)
    assert queue.refusals.counts == ({"command: speed 0 in real time": 1} if real_time else {})


def test_in_real_time_commands_are_due_now_and_none_passes_for_a_declared_fault():
    queue = CommandQueue(CommandPolicy(secret=SECRET, speed=1.0, real_time=True), ("1", "2"))
    of_agent = [CommandKind.TURN, CommandKind.THAW, CommandKind.KILL]
    of_all = [LOSS.kind, CommandKind.DELAY, CommandKind.STEP, CommandKind.PAUSE]
    sent = [Command(0.0, kind, "2") for kind in of_agent] + [Command(0.0, k, "") for k in of_all]
    for number, command in enumerate(sent, 1):
        put(queue, number, msgspec.structs.replace(command, fault=5))
    assert queue.due(0.25) == [msgspec.structs.replace(c, t=0.25) for c in sent]
    assert not queue.refusals.counts


def test_declared_faults_come_before_other_commands_of_their_time_and_added_ones_after():
    declared_one, scheduled, added = (
        Command(1.0, CommandKind.LOSS, value=value) for value in (0.1, 0.2, 0.3)
    )
    queue = CommandQueue(CommandPolicy(schedule=(scheduled,)), ("1",))
    queue.add(added)
    queue.declare([declared_one])
    assert queue.due(1.0) == [declared_one, scheduled, added]
