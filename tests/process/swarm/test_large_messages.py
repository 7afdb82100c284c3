"""A program may put in a callback as much as messages may hold: nothing there waits for itself."""

import queue
import subprocess
import sys

import pytest

from phalanx.messages.kinds import MAX_BYTES
from phalanx.wire.pubsub import publisher, subscribe, wait_for_listener
from phalanx.wire.session import free_endpoint, open_hub

pytestmark = pytest.mark.swarm

ANSWERING = """
import sys, threading
from phalanx.wire.pubsub import Addressed, publisher, subscribe, wait_for_listener
from phalanx.wire.session import open_client
endpoint, size = sys.argv[1], int(sys.argv[2])
with open_client(endpoint, 60.0) as session:
    report, broadcasts = publisher(session, "report"), Addressed(session)
    wait_for_listener(report, 60.0)
    def answer(key, payload):
        for peer in range(255):
            broadcasts.put(f"broadcast/{peer}", bytes(100))
        report.put(bytes(size))
    subscribe(session, "sample", answer)
    threading.Event().wait()
"""


# Beyond some 48 kB a message is sent in several parts.
@pytest.mark.parametrize("size", [47_000, 50_000, MAX_BYTES])
def test_a_report_of_any_size_is_sent_from_a_callback(size: int):
    endpoint, reported = free_endpoint(), queue.Queue[bytes]()
    with open_hub(endpoint) as hub:
        subscribe(hub, "report", lambda _, payload: reported.put(payload))
        samples = publisher(hub, "sample")
        agent = subprocess.Popen([sys.executable, "-c", ANSWERING, endpoint, str(size)])
        try:
            wait_for_listener(samples, 60.0)
            for _ in range(3):
                samples.put(b"")
                assert len(reported.get(timeout=60.0)) == size
        finally:
            agent.kill()
            agent.wait()
