"""Lies of one member and what they do to the others' rows: a table for each information model.

    python evidence/paper/lies.py                                          # two agents
    python evidence/paper/lies.py --scenario unicycles --duration 5        # Simulation 1
    python evidence/paper/lies.py --turns 0.3                              # it attacks too

Judged like evidence/paper/stale_input.py: an update is a false certificate if its row held and J,
the joint sum with the inputs that really are in force, is above 0. The liar keeps its own rows, and
applies what they ask of it: what is false is only what it says. A cell has the worst J of
certified steps, in parentheses how many were false and how many of these above η; then whether
the trajectory is that of the run without lies, and the verdict.

With --turns the liar becomes an adversary at that time [s], so that rows no longer say anything of
it. A cell then has the verdict, the largest h, and how long before h > 0 the first pair was under
no certificate.
"""

import argparse
from collections.abc import Iterator

import numpy as np
from stale_input import certificates, rows_with, words
from variants import simulated

import phalanx
from phalanx.schema.built_in import BUILT_IN
from phalanx.theory.rows.information import Information

LIES = {
    "none": "",
    "opposite": 'says = "opposite"',
    "zero": 'says = "zero"',
    "equivocates": "equivocate = true",
    "replays 20 steps": "replay = 20",
    "half a period late": "apply_time = 0.005",
    "half a period early": "apply_time = -0.005",
    "silent": "silent = true",
}
MODELS = tuple(BUILT_IN[Information])


def main() -> None:
    """Run every lie under every model and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--scenario", default="stale-inputs")
    arguments.add_argument("--liar", default="2")
    arguments.add_argument("--duration", type=float, default=4.0, help="[s]")
    arguments.add_argument("--turns", type=float, help="when it becomes an adversary [s]")
    options = arguments.parse_args()
    print(f"| lie | {' | '.join(f'`{model}`' for model in MODELS)} |")
    print("|---" * (len(MODELS) + 1) + "|", flush=True)
    honest: dict[str, str] = {}
    for lie, fields in LIES.items():
        declared = f'{{ kind = "lie", agent = "{options.liar}", for = 1e3, {fields} }}'
        cells = []
        for model in MODELS:
            overrides = [
                f"duration={options.duration}",
                "network.delay=0.0",
                *rows_with(model),
                f"faults=[{declared if fields else ''}]",
            ]
            if options.turns is not None:
                cells.append(attacked(options.scenario, overrides, options.liar, options.turns))
                continue
            run = simulated(options.scenario, overrides)
            assert run.summary is not None
            trajectory = honest.setdefault(model, run.summary.trajectory)
            cells.append(", ".join(judged(run, trajectory if fields else "")))
        print(f"| {lie} | {' | '.join(cells)} |", flush=True)


def judged(run: phalanx.Run, honest: str) -> Iterator[str]:
    """A cell of the table of false certificates; honest: the trajectory without the lie."""
    assert run.summary is not None
    yield words(certificates(run.recording))
    if run.summary.trajectory == honest:
        yield "same trajectory"
    yield run.summary.outcome


def attacked(name: str, overrides: list[str], liar: str, at: float) -> str:
    """A cell of the table in which the liar attacks from a time on [s]."""
    turn = phalanx.Command(at, phalanx.CommandKind.TURN, liar)
    run = phalanx.run(
        phalanx.load(name, overrides),
        engine="in-process",
        commands=phalanx.CommandPolicy(schedule=(turn,)),
    )
    summary = run.summary
    assert summary is not None
    largest = np.max(run.h.drop("run", "scenario", "seed", "t").to_numpy())
    if not summary.violations:
        return f"{summary.outcome}, {largest:.2f}"
    ahead = min(v.first for v in summary.violations) - (summary.certificates.uncovered_at or 0.0)
    return f"{summary.outcome}, {largest:.2f}, {1e3 * ahead:.1f} ms before"


if __name__ == "__main__":
    main()
