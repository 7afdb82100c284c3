"""Measure agent steps per second of two engines, with and without processes, for each scenario.

    python bench/speed/engines.py [unicycles formation3d …] [--rounds 3] [--duration 12]

The engines alternate, so that drifts of the machine's speed affect both. Each pair of runs must
give the same trajectory, to the last bit.
"""

import argparse
import statistics

import phalanx

COMPARED = "processes", "in-process"


def main() -> None:
    """Measure every scenario asked for and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("scenarios", nargs="*", default=list(phalanx.shipped()))
    arguments.add_argument("--rounds", type=int, default=3)
    arguments.add_argument("--duration", type=float, default=12.0, help="virtual time, at most [s]")
    options = arguments.parse_args()
    print("| scenario | agents | processes [steps/s] | in-process [steps/s] | ratio | trajectory |")
    print("|---|---|---|---|---|---|")
    for name in options.scenarios:
        print(line(name, options.duration, options.rounds), flush=True)


def line(name: str, duration: float, rounds: int) -> str:
    """Make one line of the table: medians over the rounds."""
    shipped = phalanx.load(name)
    scenario = phalanx.load(name, {"duration": min(duration, shipped.duration)})
    rates: dict[str, list[float]] = {engine: [] for engine in COMPARED}
    hashes = set()
    for _ in range(rounds):
        for engine, steps_per_second in rates.items():
            summary = phalanx.run(scenario, engine=engine).summary
            assert summary is not None
            steps_per_second.append(summary.steps / summary.wall_time)
            hashes.add(summary.trajectory)
    processes, in_process = (
        statistics.median(steps_per_second) for steps_per_second in rates.values()
    )
    agents = sum(len(group.names) for group in scenario.agents)
    same = "same" if len(hashes) == 1 else "DIFFERENT"
    ratio = in_process / processes
    return f"| {name} | {agents} | {processes:.0f} | {in_process:.0f} | {ratio:.1f} | {same} |"


if __name__ == "__main__":
    main()
