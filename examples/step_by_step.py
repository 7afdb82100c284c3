"""Advance a run as you like, look into it, and ask what would happen if.

python examples/step_by_step.py
"""

import phalanx

scenario = phalanx.load("unicycles", overrides={"duration": 6.0})
with phalanx.start(scenario) as run, phalanx.start(scenario) as lossy:
    for case in (run, lossy):  # the same run up to here, to the last bit
        case.until(2.0)
    print(run, "agent 1 at", run.states["1"])
    lossy.command("loss", value=0.9)
    lossy.command("kill", "2", at=3.0)

    for case in (run, lossy):
        closest = max(max(case.h.values()) for _ in case)  # to the end, instant by instant
        print(f"{len(case.commands)} commands: {case.end().verdict}, largest h {closest:.2f}")

again = phalanx.run(
    scenario, engine="in-process", commands=phalanx.CommandPolicy(schedule=lossy.commands)
)
print("the same bits:", again.summary.trajectory == lossy.end().summary.trajectory)
