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
    run = phalanx("run", "unicycles", "--set", "duration=10", "--view", "--port", str(port))
    wait_for(lambda: "phx-viewer" in run.programs() and served(port))
    wait_for(lambda: (run.folder / "summary.json").exists(), 150)
    wait_for(lambda: set(run.programs()) == {"phx-viewer"} and served(port))
    summary = msgspec.json.decode((run.folder / "summary.json").read_bytes(), type=Summary)
    assert summary.wall_time > 0.95 * 10.0  # as fast as the clock, not as the machine
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
def test_a_page_that_dies_is_started_again_a_few_times_and_the_terminal_says_so(phalanx):
    port = free_port()
    run = phalanx("run", "unicycles", *LONG, "--view", "--port", str(port))
    killed = set()

    def kill_the_next_page() -> bool:
        page = run.programs().get("phx-viewer")
        if page and page.pid not in killed and served(port):
            killed.add(page.pid)
            page.kill()
            return True
        return False

    for _ in range(4):
        wait_for(kill_the_next_page)
    assert run.process.stderr is not None
    output = ""
    while f"phalanx view {run.folder}" not in output:
        output += run.process.stderr.readline()
    assert output.count("the page died (killed by signal 9)") == 4
    assert output.count("it is started again") == 3
    recording = run.folder / "recording.mcap"
    recorded = recording.stat().st_size
    wait_for(lambda: recording.stat().st_size > recorded)  # the run goes on without a page
    run.process.send_signal(signal.SIGINT)
    status, output = run.finish()
    assert status == 130, output


def test_a_taken_port_is_an_error_that_names_it(phalanx):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        status, output = phalanx("run", "unicycles", "--view", "--port", port).finish()
    assert status == 64
    assert f"--port: cannot listen on 127.0.0.1:{port}" in output


@pytest.mark.parametrize("command", [("run", "unicycles", "--view"), ("view", "no-such-run")])
def test_a_port_out_of_range_is_an_error_that_names_the_option_and_leaves_no_folder(
    phalanx, command
):
    refused = phalanx(*command, "--port", "99999")
    status, output = refused.finish()
    assert status == 64
    assert "--port" in output.splitlines()[0]
    assert "expected 1 to 65535, got 99999" in output.splitlines()[0]
    assert not refused.parent.exists()


def served(port: int) -> bool:
    with (
        contextlib.suppress(OSError),
        urllib.request.urlopen(f"http://127.0.0.1:{port}", timeout=5) as page,
    ):
        return page.status == 200
    return False
