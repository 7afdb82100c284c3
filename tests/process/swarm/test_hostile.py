"""A hostile agent: every payload of its is dropped and counted, and changes nothing.

The hub lets it speak for itself, and it even knows the run's secret, so what the seal would refuse
is put to the checks behind it.
"""

import math
import os
import queue
import threading
from collections import Counter
from typing import Any

import msgspec
import pytest
import zenoh
from phalanx_plant.hub.hub import LockstepHub
from phalanx_plant.world.events import SwarmBrokenError

from phalanx import run
from phalanx.faults.commands import CommandKind, CommandPolicy
from phalanx.messages.keys import ROUTER, Keys
from phalanx.messages.kinds import MAX_BYTES, Actuation, Sample, Telemetry
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Sealer
from phalanx.messages.step_report import StepReport
from phalanx.network.inbox import DeliveryReport
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import Origin
from phalanx.wire.liveliness import announce
from phalanx.wire.pubsub import subscribe
from phalanx.wire.session import free_endpoint, open_client
from tests.process.runs import COMMAND_SECRET, SECRET, live_run, wait_for

pytestmark = pytest.mark.swarm

VICTIM = "4"  # an adversary: the plant alone listens to its inputs
AGENTS = 5
SCENARIO = load("unicycles", ["duration=0.5"])
SLOW = CommandPolicy(secret=COMMAND_SECRET, speed=0.01)
TIMES_SENT = 3
BLOCK = zenoh.CongestionControl.BLOCK

RUN = "assailed"
KEYS = Keys(RUN)
KEY = KEYS.actuation(VICTIM)
REPORT = KEYS.telemetry(VICTIM)
ROOT = Membership(RUN, "", SECRET)
INSIDER, ITSELF = ROOT.sealer, ROOT.of(VICTIM).credentials
LAST = b"the last one"


def an_input(**changes: Any) -> Actuation:
    message = Actuation(k=10**9, t_apply=1.0, u=(0.0, 0.0))
    return msgspec.structs.replace(message, **changes)


def a_report(**changes: Any) -> Telemetry:
    return msgspec.structs.replace(Telemetry(k=10**9, report=step(), ages=()), **changes)


def step(**changes: Any) -> StepReport:
    report = StepReport(origin=Origin.ATTACK, residual=0.0, u_nom=(0.0, 0.0), solve_time=0.0)
    return msgspec.structs.replace(report, **changes)


def a_sample(k: int, x: bytes = bytes(8 * 15)) -> Sample:
    seen = tuple(range(AGENTS))
    return Sample(k=k, t=0.0, seen=seen, x=x, hearers=())


def sealed(body: bytes, key: str = KEY) -> bytes:
    return INSIDER._mac(key, body) + body


def fields(**changes: Any) -> list[Any]:
    """An input as the list of its fields, some of them spoilt."""
    message = an_input()
    names = message.__struct_fields__
    return [changes.get(name, getattr(message, name)) for name in names]


def packed(value: Any) -> bytes:
    return sealed(msgspec.msgpack.encode(value))


GOOD = INSIDER.seal(KEY, an_input())
TO_PLANT = {
    "nothing": (KEY, b"", "truncated"),
    "one byte": (KEY, b"\x00", "truncated"),
    "a seal without a body": (KEY, GOOD[:16], "truncated"),
    "just too large": (KEY, bytes(MAX_BYTES + 1), "oversized"),
    "far too large": (KEY, bytes(200_000), "oversized"),
    "noise": (KEY, os.urandom(100), "bad seal"),
    "text": (KEY, b"{'u': [1, 2]}" * 9, "bad seal"),
    "a body cut short": (KEY, GOOD[:-5], "bad seal"),
    "one flipped bit": (KEY, GOOD[:-1] + bytes([GOOD[-1] ^ 1]), "bad seal"),
    "sealed with another secret": (KEY, Sealer(b"guess").seal(KEY, an_input()), "bad seal"),
    "sealed without a secret": (KEY, Sealer().seal(KEY, an_input()), "bad seal"),
    "meant for another agent": (KEY, INSIDER.seal(KEYS.actuation("5"), an_input()), "bad seal"),
    "meant for another run": (
        KEY, INSIDER.seal(Keys("other").actuation(VICTIM), an_input()), "bad seal"),
    "not msgpack": (KEY, sealed(b"\xc1\xc1\xc1"), "not msgpack"),
    "msgpack cut short": (KEY, sealed(msgspec.msgpack.encode(fields())[:-3]), "not msgpack"),
    "nested beyond measure": (KEY, sealed(b"\x91" * 20_000), "wrong fields"),
    "nil": (KEY, packed(None), "wrong fields"),
    "a map": (KEY, packed({"k": 1}), "wrong fields"),
    "too few fields": (KEY, packed(fields()[:3]), "wrong fields"),
    "a field too many": (KEY, packed([*fields(), "more"]), "wrong fields"),
    "a number as text": (KEY, packed(fields(k="7")), "wrong fields"),
    "a sample for an input": (
        KEY, INSIDER.seal(KEY, a_sample(0, x=b"")), "wrong fields"),
    "another version": (KEY, INSIDER.seal(KEY, an_input(version=99)), "other version"),
    "a time that is no number": (KEY, INSIDER.seal(KEY, an_input(t_apply=math.nan)), "not finite"),
    "an infinite input": (KEY, INSIDER.seal(KEY, an_input(u=(math.inf, 0.0))), "not finite"),
    "an input too many": (KEY, INSIDER.seal(KEY, an_input(u=(0.0,) * 3)), "wrong size"),
    "from the past": (KEY, INSIDER.seal(KEY, an_input(k=0)), "out of order"),
    "from the future": (KEY, INSIDER.seal(KEY, an_input()), "out of order"),
    "before the beginning": (KEY, INSIDER.seal(KEY, an_input(k=-1)), "out of order"),
    "a report for an input": (KEY, INSIDER.seal(KEY, a_report()), "wrong fields"),
    "an input for a report": (REPORT, INSIDER.seal(REPORT, an_input()), "wrong fields"),
    "an unknown origin": (
        REPORT, INSIDER.seal(REPORT, a_report(report=step(origin="divine"))), "wrong fields"),
    "an age of nobody's input": (
        REPORT, INSIDER.seal(REPORT, a_report(ages=((77, 0.1),))), "unknown sender"),
    "a residual that is no number": (
        REPORT, INSIDER.seal(REPORT, a_report(report=step(residual=math.nan))), "not finite"),
    "an enormous residual": (
        REPORT, INSIDER.seal(REPORT, a_report(report=step(residual=1.7e308))), "too large"),
    "fates of nobody's messages": (
        REPORT,
        INSIDER.seal(REPORT, a_report(fates=(DeliveryReport(77, 0, 0.0),))),
        "unknown sender",
    ),
    "fates of faults that nobody declared": (
        REPORT,
        INSIDER.seal(REPORT, a_report(fates=(DeliveryReport(0, 0, 0.0, (9,)),))),
        "unknown fault",
    ),
    "a report from the past": (REPORT, INSIDER.seal(REPORT, a_report(k=-1)), "out of order"),
    "a report from the future": (REPORT, INSIDER.seal(REPORT, a_report()), "out of order"),
}  # fmt: skip


def test_nothing_a_hostile_client_sends_changes_the_trajectory_and_all_of_it_is_counted(tmp_path):
    assert len(TO_PLANT) >= 25
    calm = run(SCENARIO, engine="in-process").summary
    with (
        live_run(SCENARIO, tmp_path / RUN, SLOW) as assailed,
        assailed.watch() as live,
        open_client(assailed.endpoint, 60.0, ITSELF) as session,
        open_client(assailed.endpoint, 60.0, ROOT.of(ROUTER).credentials) as witness,
    ):
        wait_for(lambda: (frame := live.take()) and frame.t > 0.02)
        live.command(CommandKind.PAUSE)
        wait_for(lambda: (frame := live.take()) and frame.paused)
        passed = queue.SimpleQueue()
        subscribe(witness, REPORT, lambda _, payload: passed.put(payload))
        for _ in range(TIMES_SENT):
            assail(session)
        announce(session, KEYS.alive(VICTIM, "0123456789abcdef")).undeclare()
        session.put(REPORT, LAST, congestion_control=BLOCK)
        # What is put last passes the hub last: the plant has all of it by now.
        assert LAST in iter(lambda: passed.get(timeout=60.0), b"")
        live.command(CommandKind.SPEED, value=0.0)
        live.command(CommandKind.RESUME)
        hostile = assailed.summary()
    assert hostile.trajectory == calm.trajectory
    expected = Counter(reason for _, _, reason in TO_PLANT.values() for _ in range(TIMES_SENT))
    expected["truncated"] += 1  # the last
    assert hostile.rejected == expected
    assert calm.rejected == {}


def assail(session: zenoh.Session) -> None:
    """Put every payload once. BLOCK: by default Zenoh drops what a full queue cannot take."""
    assaults = [(key, payload) for key, payload, _ in TO_PLANT.values()]
    assaults += [(f"phalanx/{RUN}/nonsense/1", b"?"), (KEYS.actuation("5"), GOOD)]
    assaults += [(KEYS.verdict, b"violated!"), (KEYS.status, GOOD), ("**", GOOD)]
    for key, payload in assaults:
        session.put(key, payload, congestion_control=BLOCK)


def test_a_flood_of_rubbish_does_not_hold_off_the_end_of_a_wait():
    """Not even one that comes faster than the plant looks up."""
    swarm = build_swarm(load("unicycles", ["time.timeout=1.0"]))
    endpoint, over = free_endpoint(), threading.Event()
    with (
        LockstepHub(swarm, Membership(RUN, endpoint, SECRET), lambda: None) as hub,
        open_client(endpoint, 20, ITSELF) as session,
    ):
        flood = threading.Thread(target=put_until, args=(session, over), daemon=True)
        flood.start()
        try:
            with pytest.raises(SwarmBrokenError, match=r"did not join within 1 s"):
                hub.wait_for_agents(lambda _: None)
        finally:
            over.set()
            flood.join()
        assert hub.refusals.counts["truncated"] > 0


def put_until(session: zenoh.Session, over: threading.Event) -> None:
    while not over.wait(0.01):
        session.put(KEY, b"?")
