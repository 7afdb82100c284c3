"""phalanx run --view: the page is there during the run, and replays it afterwards."""

import contextlib
import signal
import socket
import urllib.request

import msgspec
import pytest

from phalanx.guarantee.verdict import Summary
from tests.process.runs import free_port, wait_for
from tests.process.swarm.processes import LONG

pytestmark = pytest.mark.swarm


def test_a_run_shows_itself_and_then_its_replay_until_ctrl_c(phalanx):
    port = free_port()
    run = phalanx("run", "unicycles", "--set", "duration=4", "--view", "--port", str(port))
    wait_for(lambda: "phx-viewer" in run.programs() and served(port))
    wait_for(lambda: (run.folder / "summary.json").exists(), 150)
    wait_for(lambda: set(run.programs()) == {"phx-viewer"} and served(port))
    summary = msgspec.json.decode((run.folder / "summary.json").read_bytes(), type=Summary)
    assert summary.wall_time > 0.95 * 4.0  # as fast as the clock, not as the machine
    assert run.process.stdout is not None
    output = run.process.stdout.readline() + run.process.stdout.readline()
    assert output.startswith(f"viewer: http://127.0.0.1:{port}\nthe run waits for no browser")
    while "the page replays the run" not in output:
        output += run.process.stdout.readline()
    run.process.send_signal(signal.SIGINT)
    status, rest = run.finish()
    assert status == 0, output + rest
    run.wait_until_gone()


@pytest.mark.nightly
def test_a_run_goes_on_without_a_page_that_dies_and_the_terminal_says_so(phalanx):
    port = free_port()
    run = phalanx("run", "unicycles", *LONG, "--view", "--port", str(port))
    wait_for(lambda: "phx-viewer" in run.programs() and served(port))
    run.programs()["phx-viewer"].kill()
    assert run.process.stderr is not None
    expected = f"the page died (killed by signal 9): phalanx view {run.folder} shows the run"
    assert run.process.stderr.readline().strip() == expected
    recording = run.folder / "recording.mcap"
    recorded = recording.stat().st_size
    wait_for(lambda: recording.stat().st_size > recorded)
    run.process.send_signal(signal.SIGINT)
    status, output = run.finish()
    assert status == 130, output


def test_a_taken_port_is_an_error_that_names_it(phalanx):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        status, output = phalanx("run", "unicycles", "--view", "--port", port).finish()
    assert status == 64
    assert f"--port: cannot listen on 127.0.0.1:{port}" in output


def served(port: int) -> bool:
    with (
        contextlib.suppress(OSError),
        urllib.request.urlopen(f"http://127.0.0.1:{port}", timeout=5) as page,
    ):
        return page.status == 200
    return False
