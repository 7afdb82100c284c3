"""File handles: the plant has one for each agent's connection, and some of its own."""

import contextlib
import errno
import resource

_ENOUGH = 4096
"""For the largest swarm, and whoever looks."""
_OWN = 40
"""Of the plant without agents: 29 were counted."""


def raise_limit() -> None:
    """Let this process, and what it starts, have as many handles as are enough, if it may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _ENOUGH if hard == resource.RLIM_INFINITY else min(hard, _ENOUGH)
    if resource.RLIM_INFINITY != soft < wanted:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def require_handles(programs: int) -> None:
    """Raise OSError if the plant would run out of handles with so many agents' programs."""
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = _OWN + programs
    if resource.RLIM_INFINITY != allowed < needed:
        raise OSError(
            errno.EMFILE,
            f"a process may have {allowed} file handles, and the plant of this swarm needs "
            f"{needed}: raise the hard limit (ulimit -Hn), or take --engine in-process",
        )
