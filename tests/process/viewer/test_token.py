"""The token of a page's address: without it a visitor sees a live run, and cannot command it."""

import re
from pathlib import Path

import msgspec
import pytest
import zstandard
from websockets.sync.client import ClientConnection, connect

from phalanx.recording.read import read
from phalanx.scenario.load import load
from tests.process.runs import COMMAND_SECRET, HELD, live_run
from tests.process.viewer.pages import viewer, visitor

pytestmark = pytest.mark.swarm

PATIENCE = 120.0
"""Time for a page on busy cores to say something [s]."""


class Visitor:
    """A visitor without a browser, and all that the page has sent."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.received, self.clicked = "", 0
        self.name = self.until(r'phalanxVisitor = "([^"]+)"')
        """Under which the page asks for the token."""

    def until(self, pattern: str) -> str:
        """Receive until this came since the last click, and return the pattern's group."""
        while not (found := re.search(pattern, self.received[self.clicked :])):
            for message in messages(bytes(self.connection.recv(PATIENCE))):
                self.received += f"{message}\n"
        return found[1]

    def group(self, button: str) -> str:
        """Return the id of the group that has this button."""
        return self.until(f"(?m)^(?=.*'{button}').*'uuid': '([^']+)'")

    def click(self, uuid: str, button: str) -> None:
        self.clicked = len(self.received)
        update = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": button}}
        self.connection.send(msgspec.msgpack.encode(update))
        assert self.connection.ping().wait(PATIENCE)


def messages(frame: bytes) -> list[dict[str, object]]:
    """The messages that viser sends a page at once."""
    packed = 16 + int.from_bytes(frame[8:16], "little")
    found = msgspec.msgpack.decode(zstandard.decompress(frame[16:packed]))["messages"]
    return [message for message in found if isinstance(message, dict)]


def test_a_page_without_the_token_shows_and_cannot_command(tmp_path: Path) -> None:
    with (
        live_run(load("unicycles", ["duration=1.0"]), tmp_path / "live", HELD) as run,
        viewer("--connect", run.endpoint, "--run", "live", command_secret=COMMAND_SECRET) as page,
    ):
        address, _, token = page.url.partition("/?token=")
        port = int(address.rpartition(":")[2])
        with (
            visitor(port) as first,
            visitor(port) as second,
            connect(f"ws://127.0.0.1:{port}/actions") as acting,
        ):
            ours, other = Visitor(first), Visitor(second)
            acting.send(msgspec.json.encode({"visitor": other.name, "token": "guessed"}))
            acting.send(msgspec.json.encode({"visitor": ours.name, "token": token}))
            groups = {button: ours.group(button) for button in ("Pause", "Kill")}
            other.until("(t = )")  # it sees the run
            for button, uuid in groups.items():
                other.click(uuid, button)
            ours.click(groups["Pause"], "Pause")
            ours.until("(· paused)")
            ours.click(groups["Pause"], "Resume")
            ours.until("(× real time)")
            run.set_speed(0.0)
            other.until("(the run is over)")
            run.summary()
        for secret in ("Kill", token):
            assert secret not in other.received
    kinds = [command.kind for command in read(tmp_path / "live").commands]
    assert kinds == ["pause", "resume", "speed"]
