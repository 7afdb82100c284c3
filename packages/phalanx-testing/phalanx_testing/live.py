"""A run that a test steps through, and commands on the way."""

from pathlib import Path
from typing import Any

from phalanx.launcher.stepped import SteppedRun, start_as
from phalanx_testing.conditions import Source, faulty
from phalanx_testing.runs import CheckedRun


class LiveRun(SteppedRun):
    """A run between two instants, whose end has assertions."""

    def end(self) -> CheckedRun:
        """End the run, as stopped unless it went to its end; return it with assertions."""
        return CheckedRun.of(super().end())

    def finish(self) -> CheckedRun:
        """Go on to the end of the scenario; return the run with assertions."""
        self.until()
        return self.end()


def start(scenario: Source, *, out: str | Path | None = None, **conditions: Any) -> LiveRun:
    """Begin a run in this process that goes on only as far as it is asked to.

    Args:
        scenario: as `faulty` takes it.
        out: as phalanx.run takes it.
        conditions: seed, faults, overrides and fields of the network, as `faulty` takes them.

    Raises as `faulty` and phalanx.start.
    """
    return start_as(LiveRun, faulty(scenario, **conditions), out=out)
