"""Study the margin that Simulation 1 needs, and how it depends on loss in the network.

python examples/study.py

The in-process engine calls the same control steps as the processes, so its trajectories are the
same to the last bit.
"""

import itertools

import phalanx

MARGINS, LOSSES, SEEDS = (0.0, 2.0, 8.0566), (0.0, 0.5), range(2)

print("   η   loss   unsafe   worst h_tot")
for eta, loss in itertools.product(MARGINS, LOSSES):
    overrides = {"duration": 6.0, "safety.eta": eta, "network.loss": loss}
    runs = [
        phalanx.run(phalanx.load("unicycles", overrides, seed), engine="in-process")
        for seed in SEEDS
    ]
    unsafe = sum(run.verdict == phalanx.Outcome.VIOLATED for run in runs)
    worst = max(run.summary.worst_h_tot for run in runs)
    print(f"{eta:5.1f}  {loss:5.1f}   {unsafe} of {len(runs)}   {worst:10.2f}", flush=True)
