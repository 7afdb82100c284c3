"""The token of a page's address: without it a visitor sees a live run, and cannot command it."""

from pathlib import Path

import msgspec
import pytest
from websockets.sync.client import connect

from phalanx.recording.read import read
from phalanx.scenario.load import load
from tests.process.runs import COMMAND_SECRET, HELD, live_run
from tests.process.viewer.pages import Client, viewer, visitor

pytestmark = pytest.mark.swarm


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
            ours, other = Client(first), Client(second)
            acting.send(msgspec.json.encode({"visitor": other.name, "token": "guessed"}))
            acting.send(msgspec.json.encode({"visitor": ours.name, "token": token}))
            groups = {button: ours.group(button) for button in ("Pause", "Kill 1")}
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
