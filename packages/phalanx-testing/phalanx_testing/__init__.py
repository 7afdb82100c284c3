"""Tests of swarms under faults: runs with assertions, faults as objects, checks of your own code.

    from phalanx_testing import partition, run

    run("warehouse", loss=0.3, faults=[partition(["cart-1"], at=5, for_=3)]).assert_safe()

With pytest, the fixtures of docs/testing.md do the same, and say more of a failure.
"""

from typing import TYPE_CHECKING, Any

import phalanx

if TYPE_CHECKING:
    from phalanx_testing.claims import ClaimError
    from phalanx_testing.conditions import faulty
    from phalanx_testing.fault_tables import (
        actuator,
        clock,
        hijack,
        hold,
        kill,
        lie,
        link,
        partition,
        pause,
        restart,
        sensor,
        turn,
    )
    from phalanx_testing.live import LiveRun, start
    from phalanx_testing.rates import RateStudy
    from phalanx_testing.runs import CheckedRun, Moment, run
    from phalanx_testing.strategies import faults, networks, starts
    from phalanx_testing.world import WorldMistakeError, check_world

__all__ = [  # noqa: RUF022 - in the order of the documentation
    "run",
    "start",
    "faulty",
    "CheckedRun",
    "LiveRun",
    "Moment",
    "RateStudy",
    "ClaimError",
    "partition",
    "hold",
    "link",
    "lie",
    "kill",
    "restart",
    "pause",
    "turn",
    "hijack",
    "clock",
    "sensor",
    "actuator",
    "networks",
    "faults",
    "starts",
    "check_world",
    "WorldMistakeError",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: pytest's plugin is loaded by every session."""
    return phalanx.public_name(name, globals())
