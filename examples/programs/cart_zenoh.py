"""A cart's own program in the place of an agent: to a point, which its arguments are."""

import signal
import struct
import sys
from typing import Any

from cart import wheels
from zenoh_agent import INDEX, NAME, NAMES, Run


def answer(run: Run, sample: list[Any]) -> None:
    """Put the input for a sample, what others hear of it, and a report."""
    k, t, visible, states, _, _, _, hearers, _, commands, _ = sample
    if commands and commands[3]:  # die
        signal.raise_signal(signal.SIGKILL)
    x = struct.unpack_from("<3d", states, 24 * visible.index(INDEX))  # as all before it
    goal = {"position": [float(word) for word in sys.argv[1:]], "velocity": [0.0, 0.0]}
    u = [min(max(rate, -25.0), 25.0) for rate in wheels(list(x), goal)]  # others are refused
    run.put(f"actuation/{NAME}", [k, t, u])
    for hearer in hearers:
        run.put(f"broadcast/{NAME}/{NAMES[hearer]}", [k, t, u, 0.0, [], [], []])
    report = ["controller", None, None, None, u, 0.0]
    run.put(f"telemetry/{NAME}", [k, report, [], [], 0, [], [], "", []])


run = Run()
run.join(lambda sender, fields: answer(run, fields) if sender == NAME else None)
