"""Libraries begin to load before the scenario is read."""

import resource

import pytest

from phalanx.cli.app import USAGE_ERROR, status
from phalanx.launcher import libraries

_LIMIT = 2**46
"""Above all that a process may ever need, so that it limits nothing here."""


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[None]:
    """One entry for each time that libraries were to be loaded."""
    found: list[None] = []
    monkeypatch.setattr(libraries, "start_loading", lambda: found.append(None))
    return found


@pytest.fixture
def little_memory():
    """A limit on this process's memory."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_LIMIT, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize(("engine", "times"), [("processes", 1), ("in-process", 0)])
def test_libraries_are_loaded_ahead_for_processes_alone(asked: list[None], engine, times):
    assert status(["run", "nobody", "--engine", engine]) == USAGE_ERROR
    assert len(asked) == times


@pytest.mark.usefixtures("little_memory")
def test_where_memory_has_a_limit_no_process_loads_libraries_on_its_own(asked: list[None]):
    """Out of memory it would die in words of its own."""
    assert status(["run", "nobody"]) == USAGE_ERROR
    assert asked == []
