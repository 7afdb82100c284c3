"""Run Simulation 1 for a few seconds, every agent a process, and print its result.

python examples/first_run.py
"""

import phalanx

scenario = phalanx.load("unicycles", seed=7, overrides={"duration": 3.0})
run = phalanx.run(scenario, progress=lambda status: print(f"t = {status.t:.2f} s", flush=True))

print(run.verdict, "-", run.summary.reason)
print(run.states.select("t", "h_tot", "1.x", "1.y").tail(3))
print(run.inputs.group_by("agent", "origin").len().sort("agent", "origin"))
