"""Each visitor has an agent, a camera and options of its own, and commands if it has the token."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from phalanx_viewer.feeds.replay import open_replay
from phalanx_viewer.page.page import Page
from websockets.sync.client import ClientConnection, connect

from phalanx.recording.read import read
from phalanx.scenario.load import load
from tests.process.runs import COMMAND_SECRET, HELD, LiveRun, live_run, wait_for
from tests.process.viewer.pages import Client, served, viewer, visitor

pytestmark = pytest.mark.swarm


@contextlib.contextmanager
def two_visitors(port: int) -> Iterator[tuple[Client, Client, ClientConnection]]:
    """Two visitors of a page, and a connection for actions."""
    with (
        visitor(port) as first,
        visitor(port) as second,
        connect(f"ws://127.0.0.1:{port}/actions") as acting,
    ):
        yield Client(first), Client(second), acting


@contextlib.contextmanager
def operated(folder: Path) -> Iterator[tuple[LiveRun, Client, Client, str]]:
    """A live run, visitors with and without the page's token, and the token."""
    with (
        live_run(load("unicycles", ["duration=1.0"]), folder, HELD) as run,
        viewer("--connect", run.endpoint, "--run", "live", command_secret=COMMAND_SECRET) as page,
    ):
        address, _, token = page.url.partition("/?token=")
        with two_visitors(int(address.rpartition(":")[2])) as (operator, other, acting):
            acting.send(msgspec.json.encode({"visitor": other.name, "token": "guessed"}))
            acting.send(msgspec.json.encode({"visitor": operator.name, "token": token}))
            yield run, operator, other, token


def test_a_page_without_the_token_shows_and_cannot_command(tmp_path: Path) -> None:
    with operated(tmp_path / "live") as (run, operator, other, token):
        groups = {button: operator.group(button) for button in ("Pause", "Kill 1")}
        other.until("(t = )")  # it sees the run
        for button, uuid in groups.items():
            other.click(uuid, button)
        operator.click(groups["Pause"], "Pause")
        operator.until("(· paused)")
        operator.click(groups["Pause"], "Resume")
        operator.until("(× real time)")
        run.set_speed(0.0)
        other.until("(the run is over)")
        run.summary()
        for secret in ("Kill", token):
            assert secret not in other.received
    kinds = [command.kind for command in read(tmp_path / "live").commands]
    assert kinds == ["pause", "resume", "speed"]


def test_a_command_is_for_the_agent_on_its_button_whatever_others_choose(tmp_path: Path) -> None:
    with operated(tmp_path / "live") as (run, operator, other, _):
        ours, theirs = operator.field("Agent"), other.field("Agent")
        operator.click(ours, "5")
        buttons = operator.group("Kill 5")
        for chosen in (theirs, ours):  # the operator's is not there for others
            other.click(chosen, "2")
        operator.click(buttons, "Kill 5")
        operator.until("(agent 5 killed)")
        assert "'Kill 2'" not in operator.received
        run.set_speed(0.0)
        run.summary()
    commands = read(tmp_path / "live").commands
    assert [(c.kind, c.agent) for c in commands] == [("kill", "5"), ("speed", "")]


def settings(page: Page) -> list[tuple[int, str, bool]]:
    """Return each visitor's agent, framing, and whether inputs are drawn, the first one first."""
    return [
        (v.selected, v.scene.camera.framing.value, v.scene.arrows.applied.visible)
        for v in page.visitors.values()
    ]


def test_what_a_visitor_sets_is_not_set_for_others(finished: Path) -> None:
    replay = open_replay(finished)
    with served(replay) as page, two_visitors(page.server.get_port()) as (ours, other, acting):
        ours.until("(t = 0.000 s)")
        set_by_other = {"Agent": "4", "Keep in sight": "the swarm", "Dark": True}
        set_by_other |= dict.fromkeys(("Inputs", "Recent paths", "Goals"), False)
        fields = {label: other.field(label) for label in set_by_other}
        ours.clicked, before = len(ours.received), settings(page)
        for label, value in set_by_other.items():
            other.click(fields[label], value)
        acting.send(msgspec.json.encode({"seek": replay.end}))
        for client in (ours, other):
            client.until(f"(t = {replay.end:.3f} s)")
        after = settings(page)
    assert after[0] == before[0] == before[1] == (0, "the whole run", True)
    assert after[1] == (3, "the swarm", False)
    assert "dark_mode': True" in other.received
    messages = ours.received[ours.clicked :]
    assert "dark_mode': True" not in messages
    assert not any(uuid in messages for uuid in fields.values())


def test_nothing_is_kept_for_visitors_who_left(finished: Path) -> None:
    with served(open_replay(finished)) as page:
        for _ in range(5):
            with visitor(page.server.get_port()):
                pass
        with visitor(page.server.get_port()) as last:
            Client(last).until("(t = 0.000 s)")
            wait_for(lambda: len(page.visitors) == 1)
        wait_for(lambda: not page.visitors)
