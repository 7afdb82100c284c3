"""The process that forks the programs: they inherit from it, and do not depend on it."""

import resource
from pathlib import Path

import psutil
import pytest

pytestmark = pytest.mark.swarm


def fork_server(run) -> psutil.Process:
    """The parent of the run's programs."""
    parents = {process.ppid() for process in run.programs().values()}
    assert len(parents) == 1
    return psutil.Process(parents.pop())


def test_programs_are_forked_by_one_process_that_is_none_of_them(phalanx):
    run = phalanx("run", "unicycles")
    run.wait_until_running()
    parent = fork_server(run)
    assert parent.name() == "phalanx-forks"
    assert parent.num_threads() == 1  # it has no session
    shared = sum(m.shared_dirty for m in run.programs()["phx-agent-1"].memory_maps())
    assert shared > 10_000_000  # what it was forked with is not its own


def test_a_run_goes_on_to_its_verdict_without_the_fork_server(phalanx):
    run = phalanx("run", "unicycles", "--set", "duration=8.0")
    run.wait_until_running()
    parent = fork_server(run)
    parent.kill()
    status, output = run.finish()
    assert status == 0, output
    assert output.splitlines()[-1].startswith(("guaranteed", "safe"))
    run.wait_until_gone(5.0)


def test_the_plant_may_open_as_many_files_as_the_system_lets_it(phalanx):
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    run = phalanx("run", "unicycles", limit=lambda: resource.setrlimit(_FILES, (256, hard)))
    run.wait_until_running()
    plant = run.programs()["phx-plant"]
    assert plant.rlimit(psutil.RLIMIT_NOFILE) == (hard, hard)


def test_every_program_writes_a_log_of_its_own(phalanx):
    run = phalanx("run", "unicycles", "--set", "duration=0.5")
    status, output = run.finish()
    assert status == 0, output
    logs: Path = run.folder / "logs"
    assert {log.stem for log in logs.iterdir()} == {*"12345", "plant", "programs"}
    assert all("joined run" in (logs / f"{name}.log").read_text() for name in "12345")
    assert not (logs / "programs.log").read_text()


_FILES = resource.RLIMIT_NOFILE
