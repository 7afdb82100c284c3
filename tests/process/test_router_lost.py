"""Two routers, one of which is killed: all that was behind it is withdrawn at the other one."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from multiprocessing.process import BaseProcess
from typing import Any

import pytest

from phalanx.wire import liveliness
from phalanx.wire.session import free_endpoint, open_client, open_hub
from tests.process.runs import wait_for

pytestmark = pytest.mark.swarm

BEHIND, ASKED = "phalanx/lost/alive/behind", "phalanx/lost/place"
PATIENCE = 20.0


def far_router(endpoint: str, other: str) -> None:
    """Open a router that connects to the other one, and stay."""
    with open_hub(endpoint, other_hubs=[other]):
        signal.pause()


def member(endpoint: str) -> None:
    """Announce a token behind a router, answer questions, and stay."""
    with open_client(endpoint, PATIENCE) as session:
        _answers = session.declare_queryable(ASKED, lambda query: query.reply(ASKED, b"here"))
        _token = liveliness.announce(session, BEHIND)
        signal.pause()


@pytest.fixture
def started() -> Iterator[Callable[..., BaseProcess]]:
    """Start processes of their own, which end with the test."""
    context, running = multiprocessing.get_context("spawn"), list[Any]()

    def start(target: Callable[..., None], *arguments: str) -> BaseProcess:
        running.append(context.Process(target=target, args=arguments))
        running[-1].start()
        found: BaseProcess = running[-1]
        return found

    yield start
    for process in running:
        process.kill()
        process.join()


def test_tokens_and_queryables_behind_a_killed_router_are_withdrawn_at_the_other(started) -> None:
    near, far = free_endpoint(), free_endpoint()
    with open_hub(near), open_client(near, PATIENCE) as watcher:
        changes: list[tuple[str, bool]] = []
        liveliness.watch(watcher, BEHIND, lambda key, alive: changes.append((key, alive)))
        router = started(far_router, far, near)
        started(member, far)
        wait_for(lambda: changes == [(BEHIND, True)], PATIENCE)
        wait_for(lambda: [*watcher.get(ASKED, timeout=1.0)] != [], PATIENCE)
        assert router.pid is not None
        os.kill(router.pid, signal.SIGKILL)
        wait_for(lambda: changes == [(BEHIND, True), (BEHIND, False)], PATIENCE)
        assert not liveliness.is_announced(watcher, BEHIND, 1.0)
        # A queryable that was not withdrawn would keep this waiting.
        assert [*watcher.get(ASKED, timeout=PATIENCE)] == []
