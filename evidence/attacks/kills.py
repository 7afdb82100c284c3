"""Signals to every program of a run at any moment: nothing is left, the status is right.

    python evidence/attacks/kills.py 200 [SEED]

Each run gets one signal, KILL, TERM, HUP or STOP, at a random instant from 50 ms on: its launcher,
its fork server, its plant or an agent. Within five seconds of the command's end nothing of the run
lives; its exit status is that of its verdict; what was recorded can be read; nothing was a
traceback. One line for each run that was otherwise; exit with 1 if there was any.
"""

import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import psutil

from phalanx.guarantee.verdict import Outcome, exit_status
from phalanx.recording.read import UnreadableRecordingError, read
from phalanx.recording.records import RECORDING, SUMMARY

COMMAND = (
    "run", "one-on-one", "--no-report", "--set", "duration=3.0", "--set", "time.timeout=5.0",
)  # fmt: skip
TARGETS = ("launcher", "phalanx-forks", "phx-plant", "phx-agent-1", "phx-agent-2")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGSTOP)
GONE, PAUSE, ENDED = 5.0, 1.0, 90.0
"""How long the rest of a run may live, a stopped program stands still, and a run takes [s]."""
MARK = "PHALANX_KILLS_RUN"


class Run:
    """A command, and all that it has started."""

    def __init__(self, folder: Path) -> None:
        self.mark = uuid.uuid4().hex
        self.process = subprocess.Popen(
            [sys.executable, "-m", "phalanx", *COMMAND, "--out", str(folder)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, MARK: self.mark},
            start_new_session=True,
            # Under nohup it would be deaf to the signal.
            preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
        )

    def alive(self) -> list[psutil.Process]:
        """Its living processes."""
        processes = []
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error):
                if process.environ().get(MARK) == self.mark and process.status() != "zombie":
                    processes.append(process)
        return processes

    def find(self, target: str) -> psutil.Process | None:
        """One of its programs, if it is there."""
        if target == "launcher":
            return psutil.Process(self.process.pid) if self.process.poll() is None else None
        for process in self.alive():
            with contextlib.suppress(psutil.Error):
                if process.name() == target:
                    return process
        return None

    def end(self) -> None:
        """Leave nothing behind."""
        for process in self.alive():
            with contextlib.suppress(psutil.Error):
                process.kill()
        self.process.communicate()


def strike(run: Run, target: str, number: signal.Signals, after: float) -> bool:
    """Send the signal after so long [s], once the program is there; whether it was."""
    begun = time.monotonic()
    while (wait := begun + after - time.monotonic()) > 0:
        time.sleep(min(wait, 0.01))
    while run.process.poll() is None:
        victim = run.find(target)
        if victim is not None:
            with contextlib.suppress(psutil.Error):
                victim.send_signal(number)
                if number == signal.SIGSTOP and not target.startswith("phx-agent"):
                    time.sleep(PAUSE)
                    victim.resume()
                return True
    return False


def complaints(run: Run, folder: Path, target: str, number: signal.Signals) -> list[str]:
    """Return the deviations from the expected end after the signal."""
    try:
        output, _ = run.process.communicate(timeout=ENDED)
    except subprocess.TimeoutExpired:
        return ["it did not end"]
    status, deviations = run.process.returncode, []
    if not waited(lambda: not run.alive(), GONE):
        deviations.append(f"left behind: {[process.name() for process in run.alive()]}")
    if "Traceback" in output:
        deviations.append(f"a traceback: {output.strip().splitlines()[-1]}")
    written = next(iter(folder.glob("*/*.mcap")), None)
    outcome = None
    if written is not None:
        try:
            summary = read(written).summary
            outcome = summary.outcome if summary else None
        except UnreadableRecordingError as error:
            if written.stat().st_size > 100_000:
                deviations.append(str(error))
    # A SIGTERM is handled as a Ctrl-C; ended by that signal itself, a shell says 130 too.
    by_signal = target == "launcher" and status in (-number, -signal.SIGINT, 130)
    expected = {exit_status(outcome)} if outcome else {3, exit_status(Outcome.STOPPED)}
    if status not in expected and not by_signal:
        deviations.append(f"status {status} for {outcome}: {output.strip()[-200:]!r}")
    if outcome and not (written and (written.parent / SUMMARY).exists()):
        deviations.append(f"no {SUMMARY} beside a whole {RECORDING}")
    return deviations


def waited(condition: Callable[[], bool], seconds: float) -> bool:
    """Return whether a condition becomes true in time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def main() -> None:
    """Send one signal to each run."""
    number, seed = int(sys.argv[1]), int((*sys.argv, "0")[2])
    struck, faults = Counter[str](), 0
    for n in range(number):
        draw = random.Random(f"{seed} {n}")
        target, blow = draw.choice(TARGETS), draw.choice(SIGNALS)
        after = 0.05 * 100.0 ** draw.random()
        with tempfile.TemporaryDirectory() as parent:
            run = Run(folder := Path(parent))
            try:
                struck[blow.name] += strike(run, target, blow, after)
                deviations = complaints(run, folder, target, blow)
            finally:
                run.end()
        faults += bool(deviations)
        if deviations:
            print(
                f"{n}: {blow.name} to {target} after {after:.2f} s: {'; '.join(deviations)}",
                flush=True,
            )
    print(f"{number} runs, seed {seed}: {faults} otherwise; sent {dict(struck)}")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
