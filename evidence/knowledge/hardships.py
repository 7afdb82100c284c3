"""Put each scenario by radio through what a field has in store, and see whether its agents go on.

    python -m evidence.knowledge.hardships ROWS [SEEDS] [SCENARIO ...]

Partitions of 2 and 5 s between halves of the swarm, an agent that dies and is replaced a second
later, starts that agents do not know, and in `radio` a stranger who crosses: all others have
adversaries already. Where agents stand at the end, all have `unstick` in another run. `ROWS` keeps
a line of JSON for each run: what is there is not run again.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import phalanx
from evidence.knowledge.showcases import SHOWCASES, Row, Rows, measured, parse_options, radio_of

AT = 3.0
"""When faults begin [s]."""
HARDSHIPS = (
    "partition of 2 s",
    "partition of 5 s",
    "kill and restart",
    "starts unknown",
    "stranger",
)
CURED = "with `unstick`"
STRANGER: Mapping[str, Any] = {
    "names": ["stranger"],
    "role": "adversary",
    "dynamics": {"type": "double-integrator", "acceleration": 2.0, "dimension": 2},
    "law": {"type": "track", "gains": [1.0, 2.0]},
    "clock": {"period": 0.05},
    "start": [[2.0, -13.0, 0.0, 1.0]],
    "goal": [{"type": "path", "points": [[2.0, -13.0], [2.0, 13.0]], "speed": 1.0}],
}


def overrides(name: str, hardship: str) -> dict[str, Any]:
    """Return what is set of a scenario for a hardship."""
    first, radio = phalanx.load(name, SHOWCASES[name]).agents[0], radio_of(name)
    members = list(first.names or map(str, range(1, 1 + (first.count or 0))))
    fault: dict[str, Any] = {}
    if hardship.startswith("partition"):
        groups, duration = [members[::2], members[1::2]], float(hardship.split()[2])
        fault = {"kind": "partition", "at": AT, "for": duration, "groups": groups}
    elif hardship == "kill and restart":
        fault = {"kind": "restart", "at": AT, "for": 1.0, "agents": [members[1]]}
    elif hardship == "starts unknown":
        radio = {**radio, "starts_known": False}
    more: dict[str, Any] = {"agents.0.radio": radio, "faults": [fault] if fault else []}
    if hardship == "stranger":
        group = phalanx.load(name).model_dump(mode="json", exclude_unset=True, by_alias=True)
        more = {"agents": [*group["agents"], STRANGER], "faults": []}
    return {**SHOWCASES[name], **more}


def unstuck(name: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the same, with agents that make detours."""
    law = phalanx.load(name, settings).agents[0].law
    return {**settings, "agents.0.law": {"type": "unstick", "of": law}}


def line(rows: Sequence[Row]) -> str:
    """Return the cells of one hardship."""
    outcomes = [row["outcome"] for row in rows]
    counts = [outcomes.count(outcome) for outcome in ("guaranteed", "safe", "violated")]
    wrong = sum(row["outcome"] == "guaranteed" and row["worst"][1] > 0.0 for row in rows)
    stand = sum(bool(row["stand"]) for row in rows)
    failed = sorted({name for row in rows for name in row["failed"]} - {"proven margin"})
    arrived = [row["arrived"] for row in rows]
    all_in = f"{sum(arrived)} of {len(rows)}" if None not in arrived else "–"
    return " | ".join(map(str, [*counts, wrong, stand, all_in, ", ".join(failed)]))


def main() -> None:
    """Run seed after seed, and print the table."""
    chosen = parse_options(3, SHOWCASES)
    rows, table = Rows(chosen.rows, measured), dict[tuple[str, str], list[Row]]()
    cells = [
        c for c in product(chosen.scenarios, HARDSHIPS) if c[1] != "stranger" or c[0] == "radio"
    ]
    for seed, (name, hardship) in product(range(chosen.seeds), cells):
        settings = overrides(name, hardship)
        row = rows(name, settings, seed)
        table.setdefault((name, hardship), []).append(row)
        if row["stand"]:
            cured = rows(name, unstuck(name, settings), seed)
            table.setdefault((name, f"{hardship}, {CURED}"), []).append(cured)
    print(
        "| scenario | hardship | guaranteed | safe | violated | wrongly guaranteed"
        " | stand at the end | all arrived | assumptions that failed |\n|" + 9 * "---|"
    )
    for (name, hardship), of_cell in table.items():
        print(f"| `{name}` | {hardship} | {line(of_cell)} |")


if __name__ == "__main__":
    main()
