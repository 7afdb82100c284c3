"""A robot's own program in the place of an agent, which knows its peers by radio.

It goes to the point in its arguments, keeping right of where it last heard the others.
"""

import signal
import struct
import sys
from typing import Any

from radio_inbox import Inbox
from robot import acceleration
from zenoh_agent import INDEX, NAME, NAMES, Run

RELAYS, MOST = 7, 4.0  # statements repeated in a broadcast, of U [m/s²]


def answer(run: Run, sample: list[Any], fates: list[Any], heard: dict[int, list[Any]]) -> None:
    """Put the input for a sample, a broadcast to each hearer, and a report."""
    k, t, visible, states, _, _, _, hearers, _, commands, _ = sample
    if commands and commands[3]:  # die
        signal.raise_signal(signal.SIGKILL)
    x = struct.unpack_from("<4d", states, 32 * visible.index(INDEX))
    peers = {j: {"x": heard[j][4]} for j in sorted(heard)}
    goal = {"position": [float(word) for word in sys.argv[1:]]}
    wish = acceleration({"x": x, "goal": goal, "peers": peers})
    u = [min(max(a, -MOST), MOST) for a in wish]  # others are refused
    newest = sorted(([j, *of] for j, of in heard.items()), key=lambda of: (-of[4], of[0]))
    run.put(f"actuation/{NAME}", [k, t, u])
    for hearer in hearers:
        run.put(f"broadcast/{NAME}/{NAMES[hearer]}", [k, t, u, t, x, x, newest[:RELAYS]])
    report = ["controller", None, None, None, u, 0.0]
    run.put(f"telemetry/{NAME}", [k, report, [], fates, 0, [], [], "", []])


run, inbox, pending = Run(), Inbox(), list[list[Any]]()


def take(sender: str, fields: list[Any]) -> None:
    """Take a sample or a broadcast, and answer a sample once all that it counts has come."""
    if sender == NAME:
        pending.append(fields)
    else:
        inbox.arrived[NAMES.index(sender), fields[0]] = fields
    if pending and (fates := inbox.receive(pending[0])) is not None:
        answer(run, pending.pop(), fates, inbox.heard)


run.join(take)
