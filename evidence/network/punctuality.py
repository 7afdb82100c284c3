"""Punctuality of both simulations in real time.

python evidence/network/punctuality.py
"""

import argparse
from typing import NamedTuple

import phalanx


class Paced(NamedTuple):
    """A scenario and its pace."""

    name: str
    duration: float
    """[s]"""
    factor: float
    """How many times as fast as the wall clock."""
    latency: float
    """What an input may take from its sample on [s of virtual time]."""


RUNS = (
    Paced("unicycles", 60.0, 1.0, 0.005),
    Paced("formation3d", 140.0, 5.0, 0.03),
    Paced("formation3d", 140.0, 10.0, 0.03),
)


def main() -> None:
    """Run, and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--factor", type=float, help="of those runs alone that have this one")
    factor = arguments.parse_args().factor
    runs = [paced for paced in RUNS if factor in (None, paced.factor)]
    print("| run | samples | missed | late |", end="")
    for number, paced in enumerate(runs):
        overrides = {"duration": paced.duration, "time.latency": paced.latency}
        run = phalanx.run(phalanx.load(paced.name, overrides), real_time=paced.factor)
        summary = run.summary
        assert summary is not None
        assert summary.punctuality is not None
        punctuality = summary.punctuality
        if number == 0:
            print(
                "".join(f" {m.name} [ms] |" for m in punctuality.measured), "verdict, largest h |"
            )
            print("|---" * (5 + len(punctuality.measured)) + "|")
        times = (
            f"{1e3 * m.p50:.2f}, {1e3 * m.p99:.2f}, {1e3 * m.most:.1f}"
            for m in punctuality.measured
        )
        counts = f"{punctuality.samples} | {punctuality.missed} | {punctuality.late}"
        verdict = f"{summary.outcome}, {summary.largest_h_tot:.2f}"
        title = f"`{paced.name}`, {paced.duration:g} s at {paced.factor:g}"
        print(f"| {title} | {counts} | {' | '.join(times)} | {verdict} |", flush=True)


if __name__ == "__main__":
    main()
