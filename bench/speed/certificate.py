"""Measure the CPU time of certificates and of bounds on integration errors.

    python bench/speed/certificate.py [--duration 12] [--rounds 3]

Both are timed inside runs of the in-process engine, around the judge's own calls: the time to
compile them once, and that per agent step, next to the whole step. Medians of alternate rounds.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.judge.coverage import Coverage
from phalanx_plant.world.resolution import Resolution

import phalanx

SCENARIOS = ("unicycles", "formation3d", "guaranteed", "swarm")
COMPILED, CERTIFICATES, INTEGRATION, RUN = "compiled", "certificates", "integration", "run"
PARTS: dict[str, list[tuple[type, str]]] = {
    COMPILED: [(Coverage, "__init__"), (Resolution, "__init__")],
    CERTIFICATES: [(Coverage, "proven"), (Coverage, "add")],
    INTEGRATION: [(Resolution, "resolved")],
    RUN: [(Lockstep, "run")],
}


def main() -> None:
    """Measure the shipped simulations and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--duration", type=float, default=12.0, help="virtual time [s]")
    arguments.add_argument("--rounds", type=int, default=3)
    options = arguments.parse_args()
    spent = dict.fromkeys(PARTS, 0.0)
    for part, calls in PARTS.items():
        for owner, name in calls:
            setattr(owner, name, timed(getattr(owner, name), spent, part))
    rounds = [
        {name: measured(name, options.duration, spent) for name in SCENARIOS}
        for _ in range(options.rounds)
    ]
    print("| scenario | compiled [s] | certificates [µs] | integration [µs] | step [µs] | share |")
    print("|---|---|---|---|---|---|")
    for name in SCENARIOS:
        columns = zip(*[each[name] for each in rounds], strict=True)
        compiled, *parts, step = map(statistics.median, columns)
        figures = " | ".join(f"{part * 1e6:.0f}" for part in (*parts, step))
        print(f"| {name} | {compiled:.2f} | {figures} | {sum(parts) / step:.0%} |", flush=True)


def timed(function: Callable[..., Any], spent: dict[str, float], part: str) -> Callable[..., Any]:
    """Wrap a function to add its CPU time to a part."""

    def timing(*arguments: Any, **named: Any) -> Any:
        began = time.process_time()
        try:
            return function(*arguments, **named)
        finally:
            spent[part] += time.process_time() - began

    return timing


def measured(name: str, duration: float, spent: dict[str, float]) -> tuple[float, ...]:
    """Measure the CPU time to compile the proof; then of a step its two parts and the whole [s]."""
    spent.update(dict.fromkeys(spent, 0.0))
    run = phalanx.run(phalanx.load(name, {"duration": duration}), engine="in-process")
    assert run.summary is not None
    parts = (spent[part] / run.summary.steps for part in (CERTIFICATES, INTEGRATION, RUN))
    return (spent[COMPILED], *parts)


if __name__ == "__main__":
    main()
