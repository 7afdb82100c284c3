"""A dask.distributed cluster as the executor of a study."""

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path

_JOBS_PER_THREAD = 2
"""Most jobs at a worker: when one dies, all that it had are suspected (distributed#5234)."""


@contextmanager
def connected(scheduler: str) -> Iterator[tuple[Executor, int]]:
    """Yield a cluster's executor, and the most jobs to hand out at a time.

    scheduler: its address, or the path of its scheduler file. Workers need this version of
    Phalanx, one thread each, and `distributed.worker.daemon: false` to repeat runs as processes.

    Raises ImportError without the extra `dask`, OSError if the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ImportError("--dask needs distributed: pip install 'phalanx-swarm[dask]'") from error
    where = {"scheduler_file": scheduler} if Path(scheduler).is_file() else {"address": scheduler}
    with Client(**where, set_as_default=False, timeout=10) as client:
        threads = sum(client.nthreads().values())
        yield client.get_executor(pure=False), _JOBS_PER_THREAD * max(1, threads)
