"""Messages to an agent, compared with the true positions of all."""

from collections.abc import Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import msgspec
import numpy as np
import pytest

import phalanx
from phalanx.messages.keys import PLANT
from phalanx.messages.membership import Membership
from phalanx.messages.seal import SEAL_BYTES
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import build_swarm
from phalanx.wire.liveliness import is_announced, watch
from phalanx.wire.pubsub import subscribe
from phalanx.wire.session import open_client
from tests.process.runs import PACED, SECRET, live_run

pytestmark = pytest.mark.swarm

RADIUS = {"1": 4.7, "2": 4.7, "3": 4.7, "4": 7.6, "5": 7.6}
"""Next to what is between neighbours in the formation, so that they come and go."""
FORMATION = ("1", "2", "3")
CHANGES = {"duration": 1.0, "safety.neighbourhood": 4.7, "agents.1.sensing": 7.6}


def test_no_agent_is_sent_a_state_or_a_broadcast_from_beyond_its_radius(tmp_path: Path) -> None:
    scenario = phalanx.load("unicycles", CHANGES)
    with live_run(scenario, tmp_path / "live", PACED) as run:
        messages = list(messages_of(Membership("live", run.endpoint, SECRET)))
    swarm = build_swarm(scenario)
    states, names = StateCodec(swarm), swarm.names
    table = phalanx.open(tmp_path / "live").states
    truth = dict(
        zip(table["t"], table.drop("run", "scenario", "seed", "t", "h_tot").to_numpy(), strict=True)
    )
    sampled: dict[tuple[str, int], float] = {}
    samples = broadcasts = left_out = 0
    for key, fields in messages:
        _, _, kind, *who = key.split("/")
        if kind == "sample":
            _, k, t, visible, x, *_ = fields
            near = within(truth[t], names, who[0])
            assert [names[l] for l in visible] == near
            states_held = states.unpack(x, tuple(visible)).reshape(5, 3)
            assert all(np.array_equal(states_held[l], truth[t].reshape(5, 3)[l]) for l in visible)
            sampled[who[0], k] = t
            samples += 1
            left_out += len(names) - len(near)
        elif kind == "broadcast":
            sender, receiver = who
            if (t := sampled.get((sender, fields[1]))) is not None:
                assert sender in within(truth[t], names, receiver)
                broadcasts += 1
    assert min(samples, broadcasts, left_out) > 100


def test_what_an_agent_is_sent_does_not_depend_on_who_is_out_of_its_sight(tmp_path: Path) -> None:
    few, many = (sent_to_the_formation(tmp_path / str(n), far_away=n) for n in (1, 6))
    common = few.keys() & many.keys()
    assert len(common) > 100
    assert {kind for kind, *_ in common} == {"sample", "broadcast"}
    assert {which: few[which] for which in common} == {which: many[which] for which in common}


def sent_to_the_formation(folder: Path, far_away: int) -> dict[tuple[str | int, ...], object]:
    """Return all messages to agents 1, 2 and 3, by key and number, with adversaries at 500 m.

    Of states and inputs their lengths alone: the events of all agents divide the integration's
    steps, so that last digits differ.
    """
    scenario = phalanx.load(
        "unicycles",
        {
            "duration": 0.5,
            "safety.neighbourhood": 9.0,
            "agents.1.names": [str(4 + n) for n in range(far_away)],
            "agents.1.slots": [],
            "agents.1.start": [[-500.0, 9.0 * n, 0.0] for n in range(far_away)],
        },
    )
    messages = {}
    with live_run(scenario, folder, PACED) as run:
        for key, fields in messages_of(Membership(folder.name, run.endpoint, SECRET)):
            _, _, kind, *who = key.split("/")
            if kind == "sample" and who[0] in FORMATION:
                _, k, t, visible, x, *rest = fields
                messages[kind, *who, k] = [t, visible, len(x), *rest]
            elif kind == "broadcast" and who[1] in FORMATION:
                _, k, t_apply, u, *rest = fields
                messages[kind, *who, k] = [t_apply, len(u), *rest]
    return messages


def messages_of(viewer: Membership) -> Iterator[tuple[str, Any]]:
    """Yield key expression and fields of each message of a run, until its plant leaves."""
    keys, arrived = viewer.keys, SimpleQueue[tuple[str, bytes] | None]()
    with open_client(viewer.endpoint, viewer.timeout, viewer.credentials) as session:
        for key in keys.to_viewers:
            subscribe(session, key, lambda *message: arrived.put(message))
        watch(session, keys.alive(PLANT), lambda _, alive: None if alive else arrived.put(None))
        assert is_announced(session, keys.alive(PLANT), viewer.timeout)
        while (message := arrived.get()) is not None:
            yield keys.original(message[0]), msgspec.msgpack.decode(message[1][SEAL_BYTES:])


def within(x: np.ndarray, names: tuple[str, ...], agent: str) -> list[str]:
    """Return the agents within an agent's radius, itself included."""
    pose = x.reshape(5, 3)
    p = pose[:, :2] + 0.25 * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
    distances = np.linalg.norm(p - p[names.index(agent)], axis=1)
    return [name for name, d in zip(names, distances, strict=True) if d <= RADIUS[agent]]
