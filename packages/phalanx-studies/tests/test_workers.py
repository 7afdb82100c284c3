"""Studies in real worker processes: the rows are those of runs, and nothing is lost or doubled."""

import multiprocessing.forkserver
import os
import re
import signal
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path

import psutil
import pytest
from phalanx_studies.pool import Pool
from phalanx_studies.study import Study

import phalanx
from phalanx.cli.app import status
from phalanx.scenario.load import inline
from tests.process.runs import wait_for

SHORT = {"duration": 0.2}
LOSSES = {"network.loss": [0.0, 0.5]}
KILLER = '''
import os
from dataclasses import dataclass
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

@dataclass
class Killer:
    """Kills its process at its first inputs, as often as the file has bytes; of an s both.
    Its parent is the fork server.
    """
    file: str
    def prepare(self, dynamics):
        self.armed = True
    def input(self, view):
        if self.armed:
            self.armed = False
            deaths = Path(self.file).read_bytes()
            if deaths:
                Path(self.file).write_bytes(deaths[1:])
                if deaths[:1] == b"s":
                    os.kill(os.getppid(), 9)
                os.kill(os.getpid(), 9)
        return np.zeros(2)
'''


@pytest.fixture(scope="module")
def pool():
    """Two workers for several studies: each begins with loading all libraries."""
    with Pool(2) as started:
        yield started


@pytest.fixture
def killer(tmp_path, monkeypatch):
    """Return the overrides of a law that kills its worker, and the file that says how often."""
    (tmp_path / "killer_law.py").write_text(KILLER)
    monkeypatch.chdir(tmp_path)
    deaths = tmp_path / "deaths"
    return {**SHORT, "agents.1.law": {"type": "killer_law:Killer", "file": str(deaths)}}, deaths


def results(study: Study) -> list[tuple[object, ...]]:
    """Return what of a study's rows must not depend on who computed them."""
    columns = [
        *study.axes,
        "seed",
        "outcome",
        "worst_h",
        "certified",
        "trajectory",
        "least_distance",
    ]
    return study.frame.select(columns).rows()


def test_a_row_has_the_bits_of_its_run(pool):
    study = phalanx.study("unicycles", seeds=[3], vary=LOSSES, overrides=SHORT, executor=pool)
    assert study.missing == 0
    for row in study.frame.iter_rows(named=True):
        overrides = {**SHORT, "network.loss": row["network.loss"]}
        run = phalanx.run(
            phalanx.load("unicycles", overrides, seed=row["seed"]), engine="in-process"
        )
        assert row["trajectory"] == run.summary.trajectory
        assert row["worst_h"] == run.summary.worst_h
        (swarm,) = run.metrics.filter(run.metrics["agent"] == "swarm").to_dicts()
        assert all(row[name] == swarm[name] for name in phalanx.metrics.METRICS)


def test_progress_is_shown_as_a_bar(capsys, monkeypatch, pool):
    monkeypatch.setenv("FORCE_COLOR", "1")  # as in a terminal
    phalanx.study("unicycles", seeds=2, overrides=SHORT, progress=True, executor=pool)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "unicycles" in printed.err
    assert "2/2" in printed.err


def test_any_number_of_workers_gives_the_same_rows(pool):
    plan = {"seeds": 3, "vary": LOSSES, "overrides": SHORT, "chunk": 1}
    one = phalanx.study("unicycles", workers=1, **plan)
    two = phalanx.study("unicycles", executor=pool, **plan)
    assert results(one) == results(two)


def test_asked_again_it_runs_only_what_is_missing(tmp_path, pool):
    computed: list[int] = []

    def again(**plan):
        def count(progress):
            computed[-1] = progress.computed

        computed.append(0)
        fixed = {"overrides": SHORT, "out": tmp_path, "progress": count}
        return phalanx.study("unicycles", executor=pool, **fixed, **plan)

    first = again(seeds=1, vary={"network.loss": [0.5]})
    assert results(again(seeds=1, vary={"network.loss": [0.5]})) == results(first)
    assert again(seeds=2, vary=LOSSES).missing == 0
    assert computed == [1, 0, 3]


@pytest.mark.parametrize("killed", [b"..", b"s"], ids=["workers", "fork server"])
def test_a_worker_or_fork_server_that_dies_costs_its_run_only_some_time(killer, killed):
    overrides, deaths = killer
    deaths.write_bytes(killed)
    study = phalanx.study("unicycles", seeds=4, overrides=overrides, workers=2)
    assert deaths.read_bytes() == b""
    assert study.frame["seed"].to_list() == [0, 1, 2, 3]
    assert "broken" not in study.outcomes


@pytest.mark.parametrize("refuses", [True, False])
def test_a_fork_server_that_is_not_dead_yet_costs_no_run(refuses):
    """A server that was killed has no socket before it is a zombie, and looks alive."""
    with Pool(1) as fresh:
        address = multiprocessing.forkserver._forkserver._forkserver_address
        Path(address).unlink()
        if refuses:
            socket.socket(socket.AF_UNIX).bind(address)
        study = phalanx.study("unicycles", seeds=2, overrides=SHORT, executor=fresh)
    assert study.outcomes == {"guaranteed": 2}


def test_a_study_with_a_broken_run_says_so_and_ends_with_3(killer, tmp_path, capsys):
    overrides, deaths = killer
    deaths.write_bytes(b".....")  # the two runs by turns
    fields = [("--set", f"{path}={inline(value)}") for path, value in overrides.items()]
    options = ("--seeds", "0:2", "--workers", "1", *chain.from_iterable(fields))
    command = ["study", "unicycles", *options, "--out", str(tmp_path / "study")]
    assert status(command) == 3
    first, *lines, last = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"unicycles .* 0/2 .*", first)
    # On a busy machine there are lines before the first row.
    assert all(re.fullmatch(r"unicycles .* (0/2|[12]/2 1 \w+).*", line) for line in lines)
    assert last.startswith("broken: 1 of 2 runs, see the page")
    assert status(["study", "open", str(tmp_path / "study")]) == 3
    assert status(command) == 0
    assert status(["study", "open", str(tmp_path / "study")]) == 0


STUDY = """
import sys
import phalanx

if __name__ == "__main__":
    phalanx.study(
        "unicycles", seeds=int(sys.argv[2]), overrides={"duration": 0.2},
        out=sys.argv[1], progress=lambda progress: print(progress.done, flush=True),
    )
"""


def started(folder: Path, seeds: int) -> "subprocess.Popen[str]":
    """Start a study in a program of its own, and wait until five rows are there."""
    words = [sys.executable, "-c", STUDY, str(folder), str(seeds)]
    program = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    for line in program.stdout:
        if int(line) >= 5:
            return program
    raise AssertionError("it ended too soon")


@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGINT, marks=pytest.mark.nightly)]
)
def test_a_study_that_was_killed_goes_on_where_it_was(tmp_path, number, pool):
    program = started(tmp_path, seeds=10_000)
    workers = psutil.Process(program.pid).children(recursive=True)
    program.send_signal(number)
    assert program.wait() != 0
    wait_for(lambda: not any(worker.is_running() for worker in workers))
    reopened = phalanx.open_study(tmp_path)
    there = len(reopened.frame)
    assert there >= 5
    computed = []
    study = phalanx.study(
        "unicycles", seeds=there + 2, overrides=SHORT, out=tmp_path,
        progress=lambda progress: computed.append(progress.computed), executor=pool,
    )  # fmt: skip
    assert study.frame["seed"].to_list() == list(range(there + 2))
    assert computed[-1] == 2


def test_the_pool_calls_functions_as_any_executor_does():
    with Pool(2) as pool:
        assert sorted(pool.map(abs, [-3, 2, -1])) == [1, 2, 3]
        with pytest.raises(ZeroDivisionError):
            pool.submit(divmod, 1, 0).result()
    with pytest.raises(RuntimeError, match="shutdown"):
        pool.submit(abs, 1)


def test_a_pool_that_is_cancelled_ends_its_workers_at_once():
    pool = Pool(1)
    worker = psutil.Process(pool.submit(os.getpid).result())
    endless = pool.submit(signal.pause)
    wait_for(endless.running)
    pool.shutdown(cancel_futures=True)
    assert endless.done()
    assert not worker.is_running()


def test_a_study_may_use_any_executor(pool):
    plan = {"seeds": 2, "overrides": SHORT}
    with ThreadPoolExecutor(1) as threads:
        study = phalanx.study("unicycles", executor=threads, chunk=2, in_flight=1, **plan)
        assert threads.submit(abs, -1).result() == 1  # it is its owner who shuts it down
    assert results(study) == results(phalanx.study("unicycles", executor=pool, **plan))


def command(*words: object) -> "subprocess.CompletedProcess[str]":
    """Run `phalanx study` with these words."""
    line = [sys.executable, "-m", "phalanx", "study", *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True)


@pytest.mark.nightly
def test_the_command_prints_the_rates_and_writes_a_page(tmp_path):
    words = ("unicycles", "--set", "duration=0.2", "--seeds", "0:2", "--out", tmp_path)
    words += ("--vary", "network.loss=0,.5")
    process = command(*words)
    assert process.returncode == 0, process.stderr
    assert process.stdout.count("0 to 0.842") == 2  # of none in two runs
    assert (tmp_path / "study.html").stat().st_size > 10_000
    repeated = "phalanx run unicycles --seed 1 --set duration=0.2 --set network.loss=0.5"
    assert repeated in (tmp_path / "study.html").read_text("utf-8")
