"""The programs of one run as commands of their own, as on many hosts."""

import os
import subprocess
import sys
from pathlib import Path

import msgspec

from phalanx.guarantee.verdict import Summary
from phalanx.wire.session import free_endpoint

ENVIRONMENT = {**os.environ, "PHALANX_SECRET": "s"}


class Programs:
    """A router, a plant that is its client, and the agents."""

    def __init__(self, out: Path, agents: int, *scenario: str) -> None:
        self.out, self.agents, self.endpoint = out, agents, free_endpoint()
        self._scenario = ("--scenario", *scenario, "--run", "r")
        self.router = self.start_router()
        self.plant: subprocess.Popen[str] | None = None
        self.started = [self.router]

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Start one of them."""
        command = [sys.executable, "-m", "phalanx", *arguments, *self._scenario]
        return subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
        )

    def start_router(self) -> subprocess.Popen[str]:
        """Start the hub."""
        return self.start("router", "--listen", self.endpoint)

    def start_members(self, *plant: str) -> None:
        """Start plant and agents; `plant` has further options of its."""
        where = ("--connect", self.endpoint)
        self.plant = self.start("plant", *where, "--folder", str(self.out), *plant)
        members = [self.start("agent", str(n + 1), *where) for n in range(self.agents)]
        self.started += [self.plant, *members]

    def restart_router(self) -> None:
        """Kill the hub as a power cut would, and start it again."""
        self.router.kill()
        self.router.communicate()
        self.router = self.start_router()
        self.started.append(self.router)

    def summary(self) -> Summary:
        """Return the run's summary when all programs but the router have ended."""
        ended = [p.communicate(timeout=90) for p in self.started if "router" not in p.args]
        assert (self.out / "summary.json").exists(), ended
        return msgspec.json.decode((self.out / "summary.json").read_bytes(), type=Summary)

    def end(self) -> None:
        """Leave nothing behind, whatever the test did."""
        for program in self.started:
            program.kill()
            program.communicate()
