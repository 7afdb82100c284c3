"""Runs with readers that stop, and with an agent that withholds a broadcast."""

import os
import secrets
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import phalanx
from phalanx.guarantee.verdict import Summary
from phalanx.launcher.engine import RunOptions, execute
from phalanx.messages.membership import Membership
from phalanx.scenario.model import Scenario
from phalanx.wire.pubsub import subscribe
from phalanx.wire.session import free_endpoint, open_client
from tests.hostile.attacker import UNDER_WAY

_LONG = ("duration=8.0",)
"""Long enough for more than can wait for a reader [s]."""
_LAW = 'agents.0.law={ type = "tests.hostile.withholding:Withholding", gain = 1.0 }'
_WITHHELD = ("duration=0.5", "time.timeout=10.0", _LAW)
READERS: dict[str, tuple[int, float | None, tuple[str, ...]]] = {
    "viewers: none, in real time": (0, 1.0, _LONG),
    "viewers: one stops to read": (1, None, _LONG),
    "viewers: three stop to read": (3, None, _LONG),
    "viewers: one stops to read, in real time": (1, 1.0, _LONG),
    "viewers: three stop to read, in real time": (3, 1.0, _LONG),
    "insider: withholds a broadcast": (0, None, _WITHHELD),
}
"""How many readers, at how many virtual seconds per second of wall time, and what run it is."""


def scenario_of(attack: str) -> Scenario:
    """The run that it is tried on."""
    return phalanx.load("unicycles", READERS[attack][2])


def attacked(attack: str) -> tuple[list[str], Summary]:
    """Return the readers' output before they stopped, and the run's summary."""
    count, real_time, _ = READERS[attack]
    secret, endpoint = secrets.token_bytes(16), free_endpoint()
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "assailed"
        folder.mkdir()
        command = [sys.executable, __file__, folder.name, endpoint, secret.hex()]
        readers = [
            subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(count)
        ]
        try:
            summary = execute(
                scenario_of(attack),
                folder,
                RunOptions(listen=endpoint, secret=secret, real_time=real_time),
            )
        finally:
            for reader in readers:
                reader.kill()
        return [reader.communicate()[0].strip() for reader in readers], summary


def stop(*_: object) -> None:
    """Read nothing more."""
    print(UNDER_WAY, flush=True)
    os.kill(os.getpid(), signal.SIGSTOP)


def main() -> None:
    """Listen to a run as a viewer, and stop at the first message."""
    run, endpoint, secret = sys.argv[1:]
    own = Membership(run, endpoint, bytes.fromhex(secret))
    with open_client(endpoint, own.timeout, own.credentials) as session:
        for key in own.keys.to_viewers:
            subscribe(session, key, stop)
        threading.Event().wait()


if __name__ == "__main__":
    main()
