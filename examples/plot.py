"""Plot how close every pair came to its limit, from a recording.

python examples/plot.py [RUN] [--out h.png]
"""

import argparse

import matplotlib
import matplotlib.pyplot as plt

import phalanx

matplotlib.use("agg")
arguments = argparse.ArgumentParser()
arguments.add_argument("run", nargs="?", help="a run's folder; without one, a short run is made")
arguments.add_argument("--out", default="h.png")
options = arguments.parse_args()

if options.run:
    run = phalanx.open(options.run)
else:
    short = phalanx.load("unicycles", overrides={"duration": 4.0})
    run = phalanx.run(short, engine="in-process")

figure, axes = plt.subplots(layout="constrained")
for pair in run.h.columns[4:]:  # after run, scenario, seed and t
    axes.plot(run.h["t"], run.h[pair], linewidth=0.8, label=pair)
axes.axhline(0.0, color="black")
axes.set_xlabel("t [s]")
axes.set_ylabel("h of the pair, safe at or below 0")
axes.set_yscale("symlog")
axes.legend(fontsize=6, ncols=3)
figure.savefig(options.out)
print(f"{options.out}: worst pair {run.summary.worst_pair}, h {run.summary.worst_h:.2f}")
