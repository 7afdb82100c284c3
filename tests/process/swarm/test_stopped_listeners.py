"""A listener that stops reading blocks neither a run nor the hub's end."""

import contextlib
import subprocess
import sys
import time
from pathlib import Path

import pytest

from phalanx.messages.keys import Keys
from phalanx.scenario.load import load
from phalanx.wire.pubsub import Addressed, Delivery, publisher
from phalanx.wire.session import free_endpoint, open_hub
from tests.process.runs import SECRET, live_run, wait_for

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]

KEYS = Keys("r")
FRAME = bytes(10_000)
FLUSH = 2.5
"""Zenoh tries for so long to get rid of what waits for a listener [s]."""
LISTENER = """
import json, os, signal, sys, threading, zenoh
link = {"tcp": {"so_rcvbuf": 131072}}
config = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "transport": {"link": link}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
session.declare_subscriber(sys.argv[2], lambda sample: os.kill(os.getpid(), signal.SIGSTOP))
threading.Event().wait()
"""


PATIENT = """
from phalanx.wire import session
parsed = session._parsed
def patient(config):
    config["transport"]["link"]["tx"]["lease"] = 600_000
    return parsed(config)
session._parsed = patient
"""
"""A listener announces for how long it may be silent [ms]; the hub gives it up no earlier. By
default that is ten seconds, in which a busy machine makes few steps."""
TAP = """
import os, signal, sys, threading
from phalanx.messages.membership import Membership
from phalanx.wire.pubsub import subscribe
from phalanx.wire.session import open_client
run, endpoint, secret = sys.argv[1:]
own = Membership(run, endpoint, secret.encode())
with open_client(endpoint, own.timeout, own.credentials) as session:
    for key in own.keys.to_viewers:
        subscribe(session, key, lambda *_: os.kill(os.getpid(), signal.SIGSTOP))
    threading.Event().wait()
"""
VIEWER = """
import os, signal, sys
from phalanx_viewer.feeds.live import Live
from phalanx.messages.membership import Membership
run, endpoint, secret = sys.argv[1:]
live = Live(Membership(run, endpoint, secret.encode()))
while not live.take():
    pass
os.kill(os.getpid(), signal.SIGSTOP)
"""
FULL = 200_000
"""What the kernel holds for a listener that takes nothing, at least [bytes]."""
STEPS = 1000
"""So many say more than all that can wait for a listener, before somebody has to wait for it."""


@contextlib.contextmanager
def listener(program: str, *arguments: str):
    """A process that stops as soon as it hears anything."""
    started = subprocess.Popen([sys.executable, "-c", program, *arguments])
    try:
        yield
    finally:
        started.kill()
        started.wait()


def test_messages_that_may_be_dropped_wait_for_no_listener():
    """A broadcast in real time, where a peer may stop reading."""
    with open_hub(endpoint := free_endpoint()) as hub, listener(LISTENER, endpoint, "frame"):
        broadcasts = Addressed(hub, Delivery.NOTICE)
        wait_for(lambda: broadcasts.put("frame", FRAME) or unsent(endpoint) > FULL)
        for _ in range(1000):
            broadcasts.put("frame", FRAME)
        assert unsent(endpoint) > FULL, "it is still connected: nobody waited until it was not"


def test_a_hub_closes_at_once_despite_a_stopped_listener():
    """Otherwise a thread that serves all connections blocks for ten seconds at the close."""
    endpoint = free_endpoint()
    hub = open_hub(endpoint)
    frames = publisher(hub, KEYS.frames, Delivery.VIEW)
    with listener(LISTENER, endpoint, KEYS.frames):
        wait_for(lambda: frames.put(FRAME) or unsent(endpoint) > FULL)
        for _ in range(100):
            frames.put(FRAME)
        began = time.monotonic()
        hub.close()
        assert time.monotonic() - began < FLUSH + 3.0


@pytest.mark.parametrize("real_time", [None, 1.0], ids=["lockstep", "real time"])
@pytest.mark.parametrize("readers", [(TAP,), (TAP, TAP, VIEWER)], ids=["one", "three"])
def test_a_run_goes_on_while_readers_are_stopped(readers, real_time, tmp_path: Path):
    """They are still connected: no program has to wait until the hub closes their connections."""
    scenario = load("unicycles", ["duration=500.0"])
    with contextlib.ExitStack() as stack:
        run = stack.enter_context(live_run(scenario, tmp_path / "run", real_time=real_time))
        wait_for(lambda: run.status is not None and run.status.steps > 0)
        for reader in readers:
            member = run.folder.name, run.endpoint, SECRET.decode()
            stack.enter_context(listener(PATIENT + reader, *member))
        full = readers.count(TAP) * FULL
        wait_for(lambda: unsent(run.endpoint) > full)
        steps = run.status.steps
        wait_for(lambda: run.status.steps > steps + STEPS)
        assert unsent(run.endpoint) > full
        run.stop()


def unsent(endpoint: str) -> int:
    """Return how much of a hub's output its clients have not read yet [bytes]."""
    port = f":{int(endpoint.rsplit(':', 1)[1]):04X}"
    connections = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()]
    established = [c for c in connections if c[1].endswith(port) and c[3] == "01"]
    return sum(int(c[4].split(":")[0], 16) for c in established)
