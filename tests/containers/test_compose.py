"""compose.yaml: valid anywhere; with an engine, whole runs, killed agents and a cut network.

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
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

import phalanx
from phalanx import Summary
from tests.process.runs import wait_for

ROOT = Path(__file__).parents[2]
SEED = 3
AGENTS = [f"agent-{name}" for name in phalanx.load("unicycles").programs()]
pytestmark = [pytest.mark.timeout(600), pytest.mark.nightly]


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

    def containers(self, service: str) -> list[str]:
        """Identifiers of one service's containers."""
        return self("ps", "-q", service).split()

    def lines_with(self, text: str) -> list[str]:
        """The lines of the agents' and the plant's logs that have this text."""
        logs = self("logs", "--no-color", *AGENTS, "plant")
        return [line for line in logs.splitlines() if text in line]

    def verdict(self) -> dict[str, Any]:
        """Wait for the plant to end, and read the summary it wrote."""
        (container,) = self.containers("plant")
        docker("wait", container)
        copied = subprocess.run(
            ["docker", "cp", f"{container}:/runs/summary.json", "-"],
            check=True, capture_output=True,
        )  # fmt: skip
        _, _, rest = copied.stdout.partition(b"{")  # a tar of one file
        return dict(json.JSONDecoder().raw_decode("{" + rest.decode())[0])


def docker(*arguments: str) -> str:
    """Run a command of the engine's and return all that it printed."""
    ran = subprocess.run(
        ["docker", *arguments],
        check=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    return ran.stdout.strip()


def in_network_of(container: str, *command: str) -> str:
    """Run a command in a container's network, with the rights of this process."""
    process = docker("inspect", "--format", "{{.State.Pid}}", container)
    entered = ["nsenter", "--net", "--target", process, *command]
    return subprocess.run(entered, check=True, capture_output=True, text=True).stdout


@contextlib.contextmanager
def cut_off(container: str) -> Iterator[None]:
    """A container's cable pulled out while the block runs."""
    in_network_of(container, "ip", "link", "set", "eth0", "down")
    yield
    in_network_of(container, "ip", "link", "set", "eth0", "up")


def sent_again(container: str) -> int:
    """Number of TCP segments that a container retransmitted."""
    counters = in_network_of(container, "cat", "/proc/net/snmp")
    names, values = (line.split() for line in counters.splitlines() if line.startswith("Tcp:"))
    return int(values[names.index("RetransSegs")])


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
    if image := os.environ.get("PHALANX_IMAGE"):
        return image
    base = os.environ.get("PHALANX_BASE")
    chosen = ["--build-arg", f"BASE={base}"] if base else []
    command = ["docker", "build", "--network", "host", *chosen, "-t", "phalanx:test", str(ROOT)]
    built = subprocess.run(command, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout[-2000:] + built.stderr[-2000:]
    return "phalanx:test"


@pytest.fixture
def start(compose: list[str], image: str) -> Iterator[Callable[..., Stack]]:
    """Bring stacks up; they are taken down, whatever happens."""
    with contextlib.ExitStack() as stacks:

        def up(*services: str, **environment: str) -> Stack:
            stack = Stack(compose, PHALANX_IMAGE=image, PHALANX_SEED=str(SEED), **environment)
            stacks.callback(stack, "down", "--volumes", "--timeout", "2", check=False)
            stack("up", "-d", "--no-build", *services)
            return stack

        yield up


def alone(scenario: str, folder: Path) -> Summary:
    """The same run on this host, without any of this."""
    run = phalanx.run(phalanx.load(scenario, seed=SEED), engine="in-process", out=folder)
    assert run.summary is not None
    return run.summary


def key_volumes(service: dict[str, Any]) -> list[str]:
    return [volume for volume in map(str, service["volumes"]) if "-keys" in volume]


def test_the_file_is_valid_and_its_services_are_what_they_should_be(compose: list[str]) -> None:
    text = Stack(compose)("config")
    services = yaml.safe_load(text)["services"]
    assert set(services) == {"keys", "plant", "viewer", *AGENTS}
    for name, service in services.items():
        assert "tls/" in service["environment"]["PHALANX_CONNECT"], name
        assert len(key_volumes(service)) == 1 or name == "keys", "each has its own alone"
        assert set(service.get("networks", [])) <= {"swarm", "watch", "page"}, name
        assert service["init"], name
        assert service["mem_limit"], name
        assert "healthcheck" in service or name == "keys", name
        published = [str(port) for port in service.get("ports", [])]
        assert all("127.0.0.1" in port for port in published), name


def test_each_agent_is_a_service_of_its_name_with_its_own_key_alone() -> None:
    services = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
    agents = {name: service for name, service in services.items() if "agent" in service["command"]}
    assert list(agents) == AGENTS
    for service, agent in agents.items():
        name = service.removeprefix("agent-")
        assert agent["command"] == ["agent", name]
        assert agent["volumes"] == [f"{service}-keys:/keys:ro"]
        assert f"{service}-keys:/keys/{name}" in services["keys"]["volumes"], "where it is made"
        rest = {k: v for k, v in agent.items() if k not in ("command", "volumes")}
        assert rest.items() <= agents[AGENTS[0]].items(), "and else as the first"


def test_no_container_but_the_plants_shares_a_network_with_the_viewer() -> None:
    """Every client that reaches the page can command it."""
    services = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
    networks = {name: set(service.get("networks", [])) for name, service in services.items()}
    assert {n for n in networks if networks[n] & networks["viewer"]} == {"viewer", "plant"}
    assert all(port.startswith("127.0.0.1:") for port in services["viewer"]["ports"])
    assert not any("ports" in service for n, service in services.items() if n != "viewer")


def test_a_run_in_containers_is_the_local_run_also_when_a_cable_is_pulled(
    start: Callable[..., Stack], tmp_path: Path
) -> None:
    stack = start()
    wait_for_page("http://127.0.0.1:8080", 60.0)
    wait_for(lambda: len(stack.lines_with("joined run")) == 5)
    agents = sorted(line[: len("agent-1")] for line in stack.lines_with("joined run"))
    assert agents == AGENTS, "by the names of their services"
    assert set(stack("ps", "--services").split()) >= {*AGENTS, "plant", "viewer"}
    (plant,) = stack.containers("plant")
    before = sent_again(plant)
    with cut_off(*stack.containers("agent-1")):
        wait_for(lambda: sent_again(plant) > before + 3)
    contained, local = stack.verdict(), alone("unicycles", tmp_path)
    assert contained["trajectory"] == local.trajectory
    assert contained["outcome"] == local.outcome
    assert not contained["rejected"]


def test_the_verdict_names_an_agent_whose_container_was_killed(start: Callable[..., Stack]) -> None:
    stack = start(*AGENTS)
    wait_for(lambda: len(stack.lines_with("joined run")) == 5)
    docker("kill", *stack.containers("agent-3"))
    summary = stack.verdict()
    assert summary["outcome"] == "broken"
    assert summary["reason"].startswith("agent 3 died")


def test_the_container_of_an_agent_that_dies_by_the_scenario_comes_again(
    start: Callable[..., Stack], tmp_path: Path
) -> None:
    stack = start(*AGENTS[:4], PHALANX_SCENARIO="faults/restart")
    contained, local = stack.verdict(), alone("faults/restart", tmp_path)
    joined = [line for line in stack.lines_with("joined run") if line.startswith("agent-1")]
    assert len(joined) == 2
    assert contained["trajectory"] == local.trajectory
    assert contained["outcome"] == local.outcome


def test_an_agent_whose_container_is_started_again_comes_back_in_real_time(
    start: Callable[..., Stack],
) -> None:
    stack = start(*AGENTS, PHALANX_REAL_TIME="1")
    wait_for(lambda: len(stack.lines_with("joined run")) == 5)
    docker("kill", *stack.containers("agent-3"))
    docker("start", *stack.containers("agent-3"))
    wait_for(lambda: len(stack.lines_with("joined run")) == 6)
    assert stack.verdict()["outcome"] != "broken"
