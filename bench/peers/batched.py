"""Control steps a second of Simulation 1 here and in batched peers, in turns, in CPU time.

    pip install -e '.[bench]' && python bench/peers/batched.py [--seeds 200] [--rounds 3]

numpy and JAX run the same model, without network, recording or proof: batched_numpy.py. Phalanx
runs the networked swarm: in process, natively with its verdict, and the loop in C alone.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import batched_numpy
import numpy as np
from batched_jax import simulate as in_jax

import phalanx
from phalanx.launcher.simulation import Simulation
from phalanx.native.loop.engine import NativeSimulation, compiled_rows, compiled_run
from phalanx.swarm.runnable import shared_rows

AGENT_STEPS = 5 * round(batched_numpy.DURATION / batched_numpy.PERIOD)


def peer(simulate: Callable[..., object], seeds: int) -> int:
    """Run a peer's model; return its control steps."""
    largest = np.asarray(simulate(*batched_numpy.draws(seeds)))
    assert np.isfinite(largest).all()
    return seeds * AGENT_STEPS


def phalanx_run(kind: str, seed: int) -> int:
    """Run a seed here; return its control steps."""
    rows = shared_rows(phalanx.load("unicycles", {}, seed))
    if kind == "in-process":
        return Simulation(rows).run().steps
    run = compiled_run(rows)
    assert run is not None, "compiled before"
    if kind == "native":
        return NativeSimulation(run, None).run().steps
    steps, status = 0, 0
    while status != 1:
        status, batch = run.advance(), run.reader.read()
        steps += len(batch.columns.inputs.i) if batch else 0
    return steps


def main() -> None:
    """Measure in turns, and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    arguments.add_argument("--seeds", type=int, default=200, help="of a batch of a peer")
    arguments.add_argument("--rounds", type=int, default=3)
    options = arguments.parse_args()
    compiled_rows(phalanx.load("unicycles"))
    kinds: dict[str, Callable[[int], int]] = {
        "numpy, one run": lambda _: peer(batched_numpy.simulate, 1),
        "numpy, batched": lambda _: peer(batched_numpy.simulate, options.seeds),
        "JAX, vmap": lambda _: peer(in_jax, options.seeds),
        "Phalanx, in-process": lambda seed: phalanx_run("in-process", seed),
        "Phalanx, native, with the verdict": lambda seed: phalanx_run("native", seed),
        "Phalanx, native, the loop alone": lambda seed: phalanx_run("loop", seed),
    }
    for run in kinds.values():
        run(0)  # compiles
    rates: dict[str, list[float]] = {name: [] for name in kinds}
    for number in range(options.rounds):
        for name, run in kinds.items():
            began = time.process_time()
            steps = run(number)
            rates[name].append(steps / (time.process_time() - began))
    print("| engine | control steps a second of CPU: median | least to greatest |\n|---|---|---|")
    for name, values in rates.items():
        spread = f"{min(values):.3g} to {max(values):.3g}"
        print(f"| {name} | {statistics.median(values):.3g} | {spread} |")


if __name__ == "__main__":
    main()
