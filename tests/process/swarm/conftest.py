"""Fixtures of the tests that start real processes."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.process.swarm.processes import LONG, Run


@pytest.fixture
def phalanx(tmp_path: Path) -> Iterator[Callable[..., Run]]:
    """Start `phalanx` commands; what they leave behind is killed."""
    started: list[Run] = []

    def start(*arguments: str, limit: Callable[[], None] | None = None) -> Run:
        folder = tmp_path / f"out{len(started)}"
        started.append(Run(folder, *arguments, limit=limit))
        return started[-1]

    yield start
    for run in started:
        run.kill_all()


@pytest.fixture
def run(phalanx: Callable[..., Run]) -> Run:
    """A run in its midst, which does not end by itself."""
    running = phalanx("run", "unicycles", *LONG)
    running.wait_until_running()
    return running
