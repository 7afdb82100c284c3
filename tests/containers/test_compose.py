"""compose.yaml: valid anywhere; with an engine, a whole run and a killed agent, for real.

The image is built unless PHALANX_IMAGE names one; PHALANX_BASE names another base image.
"""

import contextlib
import json
import os
import shutil
import subprocess
import time
import urllib.request
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

import phalanx

ROOT = Path(__file__).parents[2]
AGENTS = {"agent-1", "agent-2", "agent-3", "adversary-4", "adversary-5"}
pytestmark = pytest.mark.timeout(600)


class Stack:
    """The services of compose.yaml, under a project name of their own."""

    def __init__(self, program: list[str], **environment: str) -> None:
        self._command = [*program, "-p", f"phalanx{uuid.uuid4().hex[:8]}", "-f", "compose.yaml"]
        self._environment = {**os.environ, **environment}

    def __call__(self, *arguments: str, check: bool = True) -> str:
        """Run a compose command and return what it printed."""
        ran = subprocess.run(
            [*self._command, *arguments],
            cwd=ROOT, env=self._environment, capture_output=True, text=True,
        )  # fmt: skip
        assert ran.returncode == 0 or not check, ran.stderr
        return ran.stdout

    def verdict(self) -> dict[str, object]:
        """Wait for the plant to end, and read the summary it wrote."""
        container = self("ps", "-q", "plant").strip()
        subprocess.run(["docker", "wait", container], check=True, capture_output=True)
        copied = subprocess.run(
            ["docker", "cp", f"{container}:/runs/summary.json", "-"],
            check=True, capture_output=True,
        )  # fmt: skip
        _, _, rest = copied.stdout.partition(b"{")  # a tar of one file
        return dict(json.JSONDecoder().raw_decode("{" + rest.decode())[0])


def wait_for_page(url: str, seconds: float) -> None:
    """Return once the page is served; the published port is open before the server listens."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        with contextlib.suppress(OSError), urllib.request.urlopen(url, timeout=5) as page:
            assert page.status == 200
            return
        time.sleep(0.1)
    pytest.fail(f"no page at {url} within {seconds:g} s")


@pytest.fixture(scope="session")
def compose() -> list[str]:
    """The compose command."""
    if shutil.which("docker-compose"):
        return ["docker-compose"]
    plugin = shutil.which("docker") and subprocess.run(["docker", "compose", "version"]).returncode
    if plugin == 0:
        return ["docker", "compose"]
    pytest.skip("needs docker-compose, or docker with its compose plugin")


@pytest.fixture(scope="session")
def image(compose: list[str]) -> str:
    """An image of this source."""
    if subprocess.run(["docker", "info"], capture_output=True).returncode != 0:
        pytest.skip("needs a running container engine (docker info fails)")
    if given := os.environ.get("PHALANX_IMAGE"):
        return given
    base = os.environ.get("PHALANX_BASE")
    chosen = ["--build-arg", f"BASE={base}"] if base else []
    command = ["docker", "build", "--network", "host", *chosen, "-t", "phalanx:test", str(ROOT)]
    built = subprocess.run(command, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout[-2000:] + built.stderr[-2000:]
    return "phalanx:test"


@pytest.fixture
def stack(compose: list[str], image: str) -> Iterator[Stack]:
    """A stack that is taken down, whatever happens."""
    started = Stack(compose, PHALANX_IMAGE=image, PHALANX_SEED="3")
    yield started
    started("down", "--volumes", "--timeout", "2", check=False)


def key_volumes(service: dict[str, Any]) -> list[str]:
    return [volume for volume in map(str, service["volumes"]) if "-keys" in volume]


def test_the_file_is_valid_and_its_services_are_what_they_should_be(compose: list[str]) -> None:
    text = Stack(compose)("config")
    services = yaml.safe_load(text)["services"]
    assert set(services) == {"keys", "plant", "viewer", *AGENTS}
    for name, service in services.items():
        assert "tls/" in service["environment"]["PHALANX_CONNECT"], name
        assert len(key_volumes(service)) == 1 or name == "keys", "each has its own alone"
        assert set(service.get("networks", [])) <= {"swarm", "page"}, name
        assert service["init"], name
        assert service["mem_limit"], name
        assert "healthcheck" in service or name == "keys", name
        published = [str(port) for port in service.get("ports", [])]
        assert all("127.0.0.1" in port for port in published), name


def test_a_run_in_containers_ends_with_the_hash_of_a_local_run(
    stack: Stack, tmp_path: Path
) -> None:
    scenario = phalanx.load("unicycles", seed=3)
    stack("up", "-d", "--no-build")
    wait_for_page("http://127.0.0.1:8080", 60.0)
    contained = stack.verdict()
    local = phalanx.run(scenario, out=tmp_path / "local").summary
    assert contained["trajectory"] == local.trajectory
    assert contained["outcome"] == local.outcome


def test_the_verdict_names_an_agent_whose_container_was_killed(stack: Stack) -> None:
    stack("up", "-d", "--no-build")
    stack("kill", "agent-3")
    summary = stack.verdict()
    assert summary["outcome"] == "broken"
    assert "agent 3" in str(summary["reason"])
