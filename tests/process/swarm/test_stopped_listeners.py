"""A listener that stops to take anything holds up nobody, not even at the hub's end."""

import contextlib
import subprocess
import sys
import time
from pathlib import Path

import pytest

from phalanx.wire.endpoints import free_endpoint
from phalanx.wire.pubsub import view_publisher
from phalanx.wire.session import open_hub
from tests.process.runs import wait_for

pytestmark = pytest.mark.swarm

FRAME = bytes(10_000)
FLUSH = 2.5
"""Zenoh tries for so long to get rid of what waits for a listener [s]."""
LISTENER = """
import json, os, signal, sys, threading, zenoh
link = {"tcp": {"so_rcvbuf": 131072}}
config = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "transport": {"link": link}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
session.declare_subscriber("frame", lambda sample: os.kill(os.getpid(), signal.SIGSTOP))
threading.Event().wait()
"""


@contextlib.contextmanager
def listener(endpoint: str):
    """A process that stops at the first frame that it hears."""
    started = subprocess.Popen([sys.executable, "-c", LISTENER, endpoint])
    try:
        yield
    finally:
        started.kill()
        started.wait()


def test_a_hub_closes_at_once_beside_a_stopped_listener():
    """Else a thread that serves everybody stands still for ten seconds when it is given up."""
    endpoint = free_endpoint()
    hub = open_hub(endpoint)
    frames = view_publisher(hub, "frame")
    with listener(endpoint):
        wait_for(lambda: frames.put(FRAME) or unsent(endpoint) > 200_000)
        began = time.monotonic()
        hub.close()
        assert time.monotonic() - began < FLUSH + 3.0


def unsent(endpoint: str) -> int:
    """How much of what a hub put is not taken yet [bytes]."""
    port = f":{int(endpoint.rsplit(':', 1)[1]):04X}"
    connections = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()]
    return sum(int(c[4].split(":")[0], 16) for c in connections if c[1].endswith(port))
