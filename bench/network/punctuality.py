"""How well runs in real time keep their times: both simulations, by the wall clock.

python bench/network/punctuality.py [unicycles formation3d]
"""

import argparse
from typing import NamedTuple

import phalanx


class Paced(NamedTuple):
    """A scenario and its pace."""

    duration: float
    """[s]"""
    factor: float
    """How many times as fast as the wall clock."""
    latency: float
    """What an input may take from its sample on [s of virtual time]."""


RUNS = {"unicycles": Paced(60.0, 1.0, 0.005), "formation3d": Paced(140.0, 10.0, 0.03)}


def main() -> None:
    """Run, and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("names", nargs="*", default=list(RUNS), metavar="SCENARIO")
    print("| run | samples | missed | late |", end="")
    for number, name in enumerate(arguments.parse_args().names):
        paced = RUNS[name]
        overrides = {"duration": paced.duration, "time.latency": paced.latency}
        run = phalanx.run(phalanx.load(name, overrides), real_time=paced.factor)
        summary = run.summary
        assert summary is not None
        assert summary.punctuality is not None
        found = summary.punctuality
        if number == 0:
            print("".join(f" {m.name} [ms] |" for m in found.measured), "verdict, largest h |")
            print("|---" * (5 + len(found.measured)) + "|")
        times = (
            f"{1e3 * m.p50:.2f}, {1e3 * m.p99:.2f}, {1e3 * m.most:.1f}" for m in found.measured
        )
        counts = f"{found.samples} | {found.missed} | {found.late}"
        verdict = f"{summary.outcome}, {summary.worst_h_tot:.2f}"
        title = f"`{name}`, {paced.duration:g} s at {paced.factor:g}"
        print(f"| {title} | {counts} | {' | '.join(times)} | {verdict} |", flush=True)


if __name__ == "__main__":
    main()
