"""Run a study on a Slurm cluster: its nodes become workers of dask.distributed.

    pip install . ./packages/phalanx-studies distributed dask-jobqueue
    python examples/study_on_slurm.py 1000 64

Seeds and jobs are the two numbers. Asked again after a time limit or a crash, it runs what is
missing.
"""

import sys

from dask_jobqueue import SLURMCluster
from distributed import Client

import phalanx

if __name__ == "__main__":
    seeds, jobs = map(int, sys.argv[1:])
    # One thread for each worker: compiled functions have buffers.
    nodes = SLURMCluster(cores=1, memory="1GB", walltime="01:00:00")
    with nodes, Client(nodes) as client:
        nodes.scale(jobs=jobs)
        study = phalanx.study(
            "unicycles",
            seeds=seeds,
            overrides={"duration": 1.0},
            vary={"network.loss": [0.0, 0.1, 0.3]},
            out="studies/slurm",
            executor=client.get_executor(pure=False),
            in_flight=2 * jobs,
            chunk=8,
        )
    print(study.rates("guaranteed"))
