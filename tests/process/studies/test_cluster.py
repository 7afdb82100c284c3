"""The example for Slurm, whose nodes are workers of dask.distributed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import phalanx

SBATCH = """#!/bin/sh
setsid sh "$1" >>{log} 2>&1 &
echo "Submitted batch job $$"
"""
SCANCEL = """#!/bin/sh
"""


@pytest.mark.nightly
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
