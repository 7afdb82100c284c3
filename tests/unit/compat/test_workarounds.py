"""Each workaround is needed still: a test that fails here says that one may go."""

import inspect
import multiprocessing.spawn
import os
import re
import socket
import struct
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import pytest
import viser
import viser.infra
import zenoh
from viser._messages import RunJavascriptMessage

from phalanx.launcher.libraries import _without_main
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
