"""Each workaround is needed still: a test that fails here says that one may go."""

import inspect
import io
import multiprocessing.spawn
import os
import re
import socket
import struct
import subprocess
import sys
import tomllib
import types
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import viser
import viser.infra
import zenoh
from mcap.writer import Writer
from viser._messages import RunJavascriptMessage

from phalanx.launcher.libraries import _without_main
from phalanx.recording.write import PackedWriter
from phalanx.wire.session import free_endpoint
from phalanx.wire.zenoh_sessions import disable_linger
from tests.process.runs import wait_for

ROOT = Path(__file__).parents[3]


def opened(**endpoints: str) -> zenoh.Session:
    """Open a session that listens or connects there, without scouting."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"' if "listen" in endpoints else '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    for verb, endpoint in endpoints.items():
        config.insert_json5(f"{verb}/endpoints", f'["{endpoint}"]')
    return zenoh.open(config)


def lingering(port: int) -> list[int]:
    """Seconds for which each of this process's connections at a port lingers; -1: it does not."""
    messages = []
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        try:
            connection = socket.socket(fileno=descriptor)
        except OSError:
            continue
        try:
            peer = connection.getpeername()
            if connection.family == socket.AF_INET and connection.getsockname()[1] == port and peer:
                option = connection.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
                on, seconds = struct.unpack("ii", option)
                messages.append(seconds if on else -1)
        except OSError:
            pass
        finally:
            connection.detach()
    return messages


def test_zenoh_has_the_kernel_linger_for_ten_seconds_unless_it_is_stopped():
    endpoint = free_endpoint()
    port = int(endpoint.rpartition(":")[2])
    with opened(listen=endpoint) as hub, opened(connect=endpoint):
        wait_for(lambda: lingering(port))
        assert lingering(port) == [10], "phalanx/wire/zenoh_sessions.py: disable_linger may go"
        disable_linger(hub)
        wait_for(lambda: lingering(port) == [-1])


COUNT_CALLBACKS = """
import sys, threading
import zenoh
from phalanx.wire.zenoh_sessions import keep_thread_state
from phalanx.wire.session import free_endpoint
from tests.process.runs import wait_for
from tests.unit.compat.test_workarounds import opened

endpoint, own, counts = free_endpoint(), threading.local(), []

def on_sample(_):
    if sys.argv[1] == "True":
        keep_thread_state()
    own.count = getattr(own, "count", 0) + 1
    counts.append(own.count)

with opened(listen=endpoint) as hub, opened(connect=endpoint) as peer:
    hub.declare_subscriber("a", zenoh.handlers.Callback(on_sample, indirect=False))
    publisher = peer.declare_publisher("a")
    wait_for(lambda: publisher.matching_status.matching)
    for n in range(1, 21):
        publisher.put(b"")
        wait_for(lambda: len(counts) >= n)
print(max(counts) > 1)
"""


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("kept", [False, True])
def test_zenoh_throws_a_threads_state_away_after_each_message_unless_it_is_kept(kept: bool):
    # Zenoh's threads outlive its sessions: in this process another test may have kept their state.
    process = subprocess.run(
        [sys.executable, "-c", COUNT_CALLBACKS, str(kept)],
        capture_output=True, text=True, check=True, cwd=ROOT,
    )  # fmt: skip
    assert process.stdout.strip() == str(kept), (
        "phalanx/wire/zenoh_sessions.py: keep_thread_state may go"
    )


@pytest.mark.slow
def test_importing_osqp_imports_scipy():
    code = "import osqp, sys; print('scipy.sparse' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "True", "phalanx/theory/rows/osqp_without_scipy.py may go"


def test_pythons_are_supported_whose_fork_server_ignores_the_import_path():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    oldest = re.findall(r">=(\d+)\.(\d+)(?:\.(\d+))?", project["requires-python"])
    assert tuple(int(part or 0) for part in oldest[0]) < (3, 12, 8), "_importing_as_here may go"


def test_multiprocessing_would_import_the_callers_script(monkeypatch, tmp_path):
    script = types.ModuleType("__main__")
    script.__file__ = str(tmp_path / "script.py")
    monkeypatch.setitem(sys.modules, "__main__", script)

    def names_main() -> bool:
        data = multiprocessing.spawn.get_preparation_data("agent")
        return any(key.startswith("init_main") for key in data)

    assert names_main(), "_without_main may go"
    with _without_main():
        assert not names_main()


def test_viser_takes_no_origins_and_keeps_every_script():
    servers = viser.ViserServer, viser.infra.WebsockServer
    parameters = {name for server in servers for name in inspect.signature(server).parameters}
    assert not any("origin" in name for name in parameters), "serving may go"
    one, other = RunJavascriptMessage("a"), RunJavascriptMessage("a")
    assert one.redundancy_key() != other.redundancy_key(), "named_script may go"


def test_a_page_that_viser_writes_takes_nothing_but_its_colours():
    parameters = set(inspect.signature(viser.infra.StateSerializer.as_html).parameters)
    assert parameters == {"self", "dark_mode"}, "window.viserPlayer of player.html may go"


def test_viser_handles_messages_while_it_draws():
    client = Path(viser.__file__).with_name("client") / "src"
    handler, app = (
        (client / name).read_text("utf-8") for name in ("MessageHandler.tsx", "App.tsx")
    )
    at_once = "useFrame(\n    () => drainRef.current()" in handler
    assert at_once, "viser_frames.js may go"
    assert "w.__viserMutable = mutable.current" in app, "viser_frames.js needs it"


def test_a_packed_file_has_the_bytes_of_the_librarys_own_which_takes_more_calls() -> None:
    messages = [(1 + k % 3, 100 - k % 7, b"x" * k) for k in range(200)]
    files, calls = (io.BytesIO(), io.BytesIO()), [0, 0]
    own = Writer(files[0], chunk_size=2000, enable_data_crcs=True)
    packed = PackedWriter(files[1], 2000)
    for writer in (own, packed):
        writer.start()
        for topic in "abc":
            writer.register_channel(topic, "json", 0)

    def counted(number: int, add: Callable[[], None]) -> None:
        def count(_frame: types.FrameType, event: str, _: object) -> None:
            calls[number] += event in ("call", "c_call")

        sys.setprofile(count)
        add()
        sys.setprofile(None)

    for channel, at, data in messages:
        counted(0, partial(own.add_message, channel, at, data, at))
        counted(1, partial(packed.add, [(channel, at, data)]))
    for writer in (own, packed):
        writer.finish()
    assert files[1].getvalue() == files[0].getvalue()
    assert calls[0] > 4 * calls[1], "mcap packs messages itself: phalanx/recording/write.py"
