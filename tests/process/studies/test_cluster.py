"""A study on a cluster: the same rows as the built-in pool gives, while workers are killed."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import phalanx
from phalanx.studies.command import connected
from tests.process.runs import free_port, wait_for
from tests.process.studies.test_studies import results

pytest.importorskip("distributed", reason="needs the extra dask")
pytestmark = pytest.mark.nightly


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.address = f"tcp://127.0.0.1:{free_port()}"
        port = self.address.rpartition(":")[2]
        self._programs = [self._start("scheduler", "--port", port, "--dashboard-address", ":0")]
        self.workers = [self.add_worker(), self.add_worker()]

    def _start(self, *words: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]]
        with (self._folder / "log").open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, cwd=self._folder)

    def add_worker(self) -> "subprocess.Popen[bytes]":
        """Start one more worker, without a nanny, which would start it again."""
        words = ("--nthreads", "1", "--no-nanny", "--no-dashboard")
        self._programs.append(self._start("worker", self.address, *words))
        return self._programs[-1]

    def close(self) -> None:
        """Kill all programs."""
        for program in self._programs:
            program.kill()
            program.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """Yield a cluster whose two workers are there."""
    (tmp_path / "cluster").mkdir()
    local_cluster = Cluster(tmp_path / "cluster")
    with connected(local_cluster.address) as (executor, _):
        wait_for(lambda: len(executor._client.nthreads()) == 2)
    yield local_cluster
    local_cluster.close()
    shutil.rmtree(tmp_path / "cluster", ignore_errors=True)


PLAN = {
    "seeds": 10,
    "vary": {"network.loss": [0.0, 0.5]},
    "overrides": {"duration": 0.3},
    "confirm": 0,
}


def test_workers_that_die_cost_no_row_and_double_none(cluster, tmp_path):
    killed = []

    def kill_one(progress):
        if progress.computed >= 4 * (len(killed) + 1) and len(killed) < 3:
            killed.append(cluster.workers.pop(0))
            killed[-1].kill()
            cluster.workers.append(cluster.add_worker())

    with connected(cluster.address) as (executor, most):
        there = phalanx.study(
            "unicycles", executor=executor, in_flight=most, chunk=2, progress=kill_one,
            out=tmp_path / "there", **PLAN,
        )  # fmt: skip
    assert len(killed) == 3
    assert "broken" not in there.outcomes
    assert results(there) == results(phalanx.study("unicycles", **PLAN))
    assert there.frame["index"].to_list() == list(range(20))


STILL = """
from dataclasses import dataclass

import numpy as np


@dataclass
class Still:
    def prepare(self, dynamics):
        pass

    def input(self, view):
        return np.zeros(2)
"""


def test_a_users_law_travels_to_the_workers(cluster, tmp_path, monkeypatch):
    (tmp_path / "still_law.py").write_text(STILL)
    monkeypatch.chdir(tmp_path)
    overrides = {"duration": 0.2, "agents.1.law": {"type": "still_law:Still"}}
    with connected(cluster.address) as (executor, most):
        study = phalanx.study(
            "unicycles", overrides=overrides, executor=executor, in_flight=most, confirm=0
        )
    assert study.outcomes == {"guaranteed": 1}


SBATCH = """#!/bin/sh
setsid sh "$1" >>{log} 2>&1 &
echo "Submitted batch job $$"
"""
SCANCEL = """#!/bin/sh
"""


def test_the_example_for_slurm_runs_where_its_commands_are(tmp_path):
    """The commands of Slurm alone are stand-ins: they start a job's script here."""
    pytest.importorskip("dask_jobqueue")
    for name, text in {"sbatch": SBATCH.format(log=tmp_path / "log"), "scancel": SCANCEL}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    example = Path(__file__).parents[3] / "examples" / "study_on_slurm.py"
    process = subprocess.run(
        [sys.executable, example, "4", "2"],
        cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert len(phalanx.open_study(tmp_path / "studies" / "slurm").frame) == 12
