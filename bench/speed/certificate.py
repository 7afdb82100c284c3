"""What the judge's certificates cost: time per agent step, beside the step itself.

    python bench/speed/certificate.py [--duration 12] [--rounds 3]

The certificates' time is taken inside a run of the in-process engine, around the judge's own calls;
the step's is the wall time of a run of processes, in which the plant computes certificates while
the agents compute inputs. The runs take turns.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import phalanx
from phalanx.plant.judge.coverage import Coverage

SCENARIOS = ("unicycles", "formation3d", "guaranteed")


def main() -> None:
    """Measure the shipped simulations and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--duration", type=float, default=12.0, help="virtual time [s]")
    arguments.add_argument("--rounds", type=int, default=3)
    options = arguments.parse_args()
    spent = Stopwatch()
    Coverage.applied = spent.around(Coverage.applied)  # type: ignore[method-assign]
    Coverage.reached = spent.around(Coverage.reached)  # type: ignore[method-assign]
    print("| scenario | certificates [µs] | step, processes [µs] | share |")
    print("|---|---|---|---|")
    for name in SCENARIOS:
        scenario = phalanx.load(name, {"duration": options.duration})
        certificates, steps = [], []
        for _ in range(options.rounds):
            spent.seconds = 0.0
            certificates.append(spent.seconds_of(scenario))
            steps.append(per_step(phalanx.run(scenario)))
        ours, step = statistics.median(certificates), statistics.median(steps)
        print(f"| {name} | {ours * 1e6:.0f} | {step * 1e6:.0f} | {ours / step:.1%} |", flush=True)


class Stopwatch:
    """Adds up the time spent in functions."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def around(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, its time added."""

        def timed(*arguments: Any) -> Any:
            began = time.perf_counter()
            try:
                return function(*arguments)
            finally:
                self.seconds += time.perf_counter() - began

        return timed

    def seconds_of(self, scenario: phalanx.Scenario) -> float:
        """Time spent per agent step of a run in this process [s]."""
        run = phalanx.run(scenario, engine="in-process")
        assert run.summary is not None
        return self.seconds / run.summary.steps


def per_step(run: phalanx.Run) -> float:
    """Wall time of an agent step [s]."""
    assert run.summary is not None
    return run.summary.wall_time / run.summary.steps


if __name__ == "__main__":
    main()
