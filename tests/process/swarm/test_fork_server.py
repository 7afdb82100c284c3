"""The process that forks the programs: they inherit from it, and do not depend on it."""

from concurrent.futures import ThreadPoolExecutor

import psutil
import pytest

from phalanx.recording.read import read
from phalanx.scenario.load import load
from phalanx.wire.liveliness import announce
from phalanx.wire.session import HubError, free_endpoint, open_hub, open_member
from tests.process.runs import live_run, wait_for
from tests.process.swarm.processes import LONG

pytestmark = pytest.mark.swarm


def fork_server(run) -> psutil.Process:
    """The parent of the run's programs."""
    parents = {process.ppid() for process in run.programs().values()}
    assert len(parents) == 1
    return psutil.Process(parents.pop())


def test_programs_are_processes_of_their_own_forked_by_one_that_is_none_of_them(run):
    assert sorted(run.programs()) == [*(f"phx-agent-{name}" for name in "12345"), "phx-plant"]
    parent = fork_server(run)
    assert parent.name() == "phalanx-forks"
    assert parent.num_threads() == 1  # it has no session
    shared = sum(m.shared_dirty for m in run.programs()["phx-agent-1"].memory_maps())
    assert shared > 10_000_000  # what it was forked with is not its own


def test_no_program_outlives_a_fork_server_that_is_killed(phalanx):
    run = phalanx("run", "unicycles", *LONG)
    run.wait_until_running()
    fork_server(run).kill()
    assert "the fork server died (killed by SIGKILL)" in run.ends(3)
    assert "cut short" in read(run.folder).damage


def test_a_program_that_does_not_leave_is_killed(tmp_path):
    with live_run(load("one-on-one", {"duration": 500.0}), tmp_path / "run") as run:
        wait_for(lambda: run.status is not None and run.status.steps > 0)
        started = psutil.Process().children(recursive=True)
        (agent,) = (process for process in started if process.name() == "phx-agent-1")
        agent.suspend()
        run.stop()
    wait_for(lambda: not psutil.pid_exists(agent.pid) or agent.status() == psutil.STATUS_ZOMBIE)


def test_a_run_whose_fork_server_dies_before_it_has_forked_the_agents_says_so(phalanx):
    run = stopped_before_agents(phalanx)
    fork_server(run).kill()
    assert "the fork server died (killed by SIGKILL)" in run.ends(3)


def stopped_before_agents(phalanx):
    """A run whose fork server stands still between forking the plant and the agents."""
    for _ in range(10):
        run = phalanx("run", "quadrotors", "--set", "time.timeout=3.0")
        wait_for(run.programs)
        fork_server(run).suspend()
        # The agents' theory takes longer than to fork the plant, but a busy machine may run this
        # test too late.
        if set(run.programs()) == {"phx-plant"}:
            return run
        fork_server(run).kill()
        run.finish()
    raise AssertionError("the agents came too soon, ten times")


def test_no_agent_loads_anything_after_it_was_forked(phalanx, monkeypatch):
    # Agents of these draw the network's chances, and solve with OSQP.
    monkeypatch.setenv("PYTHONPROFILEIMPORTTIME", "1")
    run = phalanx("run", "swarm", "--set", "duration=1.5")
    status, output = run.finish()
    assert status == 0, output
    logs = {log.stem: log.read_text() for log in (run.folder / "logs").iterdir()}
    assert [name for name, log in logs.items() if "import time" in log] == []


def test_members_that_knock_before_the_hub_opens_all_come_in():
    endpoint, token = free_endpoint(), "test/alive/plant"
    with ThreadPoolExecutor(24) as pool:
        knocking = [pool.submit(open_member, endpoint, token, 60.0) for _ in range(24)]
        with open_hub(endpoint) as hub:
            announced = announce(hub, token)
            for session in [each.result() for each in knocking]:
                session.close()
            announced.undeclare()


def test_a_member_of_a_hub_that_never_says_it_is_ready_gives_up():
    endpoint = free_endpoint()
    with open_hub(endpoint), pytest.raises(HubError, match="no program has announced test/alive"):
        open_member(endpoint, "test/alive/plant", 2.0)
