"""Count the calls that Python makes in one agent step, by program and by module.

    python bench/speed/calls.py [unicycles formation3d swarm] [--duration 2] [--most 12]

A run by the in-process engine is observed from its first sample to its last: the agent's part is
all that a control step calls, the plant's the rest. Calls of Python's own functions and of
libraries count the same. The wire is not in it. Events are judged in full batches, as where no
viewer waits for them: the load of the machine has no effect.
"""

import argparse
import math
import sys
import tempfile
from collections import Counter
from pathlib import Path
from types import FrameType
from typing import Any

from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.judge import event_queue

import phalanx
from phalanx.launcher.simulation import DirectAgents

_AGENT = DirectAgents.send_sample.__code__


def main() -> None:
    """Count the calls of each scenario, and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("scenarios", nargs="*", default=["unicycles", "formation3d", "swarm"])
    arguments.add_argument("--duration", type=float, default=2.0, help="virtual time [s]")
    arguments.add_argument("--most", type=int, default=0, help="callers listed, by module")
    options = arguments.parse_args()
    event_queue._LONGEST = math.inf
    print("| scenario | steps | calls of a step | agent | plant |")
    print("|---|---|---|---|---|")
    for name in options.scenarios:
        counter = Calls()
        steps = counter.run(name, options.duration)
        agent, plant = (counter.total[of] / steps for of in ("agent", "plant"))
        print(f"| {name} | {steps} | {agent + plant:.0f} | {agent:.0f} | {plant:.0f} |", flush=True)
        for (of, caller), count in counter.callers.most_common(options.most):
            print(f"    {count / steps:6.1f}  {of}  {caller}")


class Calls:
    """The calls of one run."""

    def __init__(self) -> None:
        self.total: Counter[str] = Counter()
        """By program."""
        self.callers: Counter[tuple[str, str]] = Counter()
        """By program and calling function."""
        self._depth = 0
        """Calls since a control step began; 0 outside of one."""

    def run(self, name: str, duration: float) -> int:
        """Run a scenario and count; return its number of agent steps."""
        clock: Any = Lockstep
        original = clock.run

        def observed(clock: Any, duration: float) -> None:
            sys.setprofile(self._count)
            try:
                original(clock, duration)
            finally:
                sys.setprofile(None)

        clock.run = observed
        try:
            scenario = phalanx.load(name, {"duration": duration})
            with tempfile.TemporaryDirectory() as folder:
                run = phalanx.run(scenario, engine="in-process", out=Path(folder))
        finally:
            clock.run = original
        assert run.summary is not None
        return run.summary.steps

    def _count(self, frame: FrameType, event: str, _: Any) -> None:
        code, python = frame.f_code, event == "call"
        if python or event == "c_call":
            caller = (frame.f_back or frame).f_code if python else code
            of = "agent" if self._depth else "plant"
            self.total[of] += 1
            label = f"{Path(caller.co_filename).name}:{caller.co_qualname}"
            self.callers[of, label] += 1
        if python and (self._depth or code is _AGENT):
            self._depth += 1
        elif event == "return" and self._depth:
            self._depth -= 1


if __name__ == "__main__":
    main()
