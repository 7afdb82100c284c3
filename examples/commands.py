"""Disturb a run: lose messages, kill an agent, and print how the others react.

python examples/commands.py
"""

import phalanx
from phalanx import Command, CommandKind

scenario = phalanx.load("unicycles", overrides={"duration": 4.0, "safety.information": "in-flight"})
schedule = (
    Command(t=1.0, kind=CommandKind.LOSS, value=0.5),
    Command(t=2.0, kind=CommandKind.KILL, agent="2"),
)
run = phalanx.run(scenario, commands=phalanx.CommandPolicy(schedule=schedule))

print(run.events)
print(run.links.group_by("lost").len())
for assumption in (*run.summary.assumptions, *run.summary.theorem):
    print(f"{assumption.name}: failed {assumption.failed} of {assumption.checked}")
