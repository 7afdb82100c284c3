"""A disk that is full at every 4 kB of a recording: the run is broken, with one line of error.

    python evidence/attacks/full_disk.py [STEP]

A limit on the size of files acts as a full disk, without root. Expected are exit status 3, a line
that names the recording, no summary, and a recording that is cut short and has no verdict. Prints
one line for each size [bytes] with another result, and then exits with 1.
"""

import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from phalanx.recording.read import UnreadableRecordingError, read
from phalanx.recording.records import RECORDING, SUMMARY

COMMAND = ("run", "one-on-one", "--no-report", "--set", "duration=0.5")
TOLERANCE = 400
"""Recordings of one scenario differ by so much [bytes]: solve times have more digits or fewer."""


def run(folder: Path, size: int) -> subprocess.CompletedProcess[str]:
    """A run that may make no file larger than this [bytes]."""
    return subprocess.run(
        [sys.executable, "-m", "phalanx", *COMMAND, "--out", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)),
    )


def complaints(ended: subprocess.CompletedProcess[str], folder: Path) -> list[str]:
    """Return the deviations from the expected end of a run on a disk that is too small."""
    *_, last = ended.stdout.splitlines() or [""]
    deviations = []
    if ended.returncode != 3 or not last.startswith("broken: ") or RECORDING not in last:
        deviations.append(f"status {ended.returncode}: {last!r}")
    if list(folder.glob(f"*/{SUMMARY}")):
        deviations.append(f"a {SUMMARY}")
    for written in folder.glob(f"*/{RECORDING}"):
        try:
            recording = read(written)
        except UnreadableRecordingError:
            continue  # nothing of it was written
        if not recording.damage:
            deviations.append("a whole recording")
        if recording.summary:
            deviations.append(f"a verdict: {recording.summary.outcome}")
    return deviations


def main() -> None:
    """Run once on a disk that is large enough, then on smaller and smaller ones."""
    step = int((*sys.argv, "4096")[1])
    with tempfile.TemporaryDirectory() as parent:
        calm = run(Path(parent), resource.RLIM_INFINITY)
        assert calm.returncode == 0, calm.stdout
        (whole,) = (file.stat().st_size for file in Path(parent).glob(f"*/{RECORDING}"))
    faults, sizes = 0, range(whole - TOLERANCE, 0, -step)
    for size in sizes:
        with tempfile.TemporaryDirectory() as parent:
            deviations = complaints(run(Path(parent), size), Path(parent))
        faults += bool(deviations)
        if deviations:
            print(f"{size}: {'; '.join(deviations)}", flush=True)
    print(
        f"{len(sizes)} sizes of a recording of {whole} bytes, from {sizes[-1]}: {faults} otherwise"
    )
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
