"""The same for all tests, however they are started: hypothesis's examples, and what signals do."""

import gc
import os
import signal
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from xdist.scheduler import LoadScopeScheduling
from xdist.workermanage import WorkerController

settings.register_profile(
    "seeded",
    derandomize=True,
    deadline=None,
    max_examples=30,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("seeded")

# Nothing that was compiled before decides what a test computes with.
os.environ["PHALANX_CC"] = ""

# A shell has what it starts with & or nohup ignore these, and so does all that is started from it.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


# Imported and collected objects live to the end. Scanning them took a sixth of the collection.
gc.disable()


def pytest_collection_finish() -> None:
    """Freeze imported and collected objects, and scan others rarely.

    Most objects that tests leave stay in caches: scanning them took a twentieth of all time.
    """
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    gc.enable()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--share", metavar="I/N", help="run each Nth test, I from 0 to N-1")


@pytest.hookimpl(trylast=True)  # after -m has left out what is not meant
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is not of this share. Neighbours, which cost much the same, are shared out."""
    if share := config.option.share:
        index, number = map(int, share.split("/"))
        config.hook.pytest_deselected(
            items=[item for i, item in enumerate(items) if i % number != index]
        )
        items[:] = [item for i, item in enumerate(items) if i % number == index]


class _FromBothEnds(LoadScopeScheduling):
    """A scheduler that assigns modules in their order, to the first two workers from the end.

    Tests of processes come first and wait most, unit tests last and compute most. Each worker that
    runs some of the latter compiles the functions of most scenarios again.
    """

    def _assign_work_unit(self, node: WorkerController) -> None:
        if node in self.nodes[:2]:
            self.workqueue.move_to_end(next(reversed(self.workqueue)), last=False)
        super()._assign_work_unit(node)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling | None:
    """Begin at both ends with `--dist loadscope`, where it was not asked to sort modules."""
    scoped = config.option.dist == "loadscope" and not config.option.loadscopereorder
    return _FromBothEnds(config, log) if scoped else None


@pytest.fixture(autouse=True)
def _own_signals() -> Iterator[None]:
    """Restore the handlers that a program under test installed in this process."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def rng() -> np.random.Generator:
    """The same numbers every time."""
    return np.random.default_rng(20)
