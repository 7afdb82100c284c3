"""Put malformed scenarios or recordings to their readers, which end in one line and soon.

python evidence/attacks/fuzz_files.py scenarios 6000 [SEED]
python evidence/attacks/fuzz_files.py checks 4000 [SEED]
python evidence/attacks/fuzz_files.py recordings 1000 [SEED]

A fault is another exception, a warning, more than five seconds of processor time, or more than a
gigabyte.
"""

import random
import resource
import signal
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.hostile.files import TRIALS, recorded

SECONDS, BYTES = 5.0, 2**30


class TooSlowError(Exception):
    """It took longer than it may."""


@contextmanager
def limited() -> Iterator[None]:
    """Raise TooSlowError when the block takes too long."""

    def stop(*_: object) -> None:
        raise TooSlowError(f"more than {SECONDS:g} s of processor time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def main() -> None:
    """Try until the number is reached; exit with 1 if anything had no line of its own."""
    what, number, seed = sys.argv[1], int(sys.argv[2]), int((*sys.argv, "0")[3])
    warnings.simplefilter("error")
    outcomes, faults = Counter[str](), 0
    with tempfile.TemporaryDirectory() as folder:
        recorded()
        for n in range(number):
            try:
                with limited():
                    outcomes[TRIALS[what](random.Random(f"{seed} {n}"), Path(folder))] += 1
            except Exception as error:
                faults += 1
                print(f"{n}: {type(error).__name__}: {str(error)[:200]}", flush=True)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(f"{number} {what}, seed {seed}: {faults} faults, at most {most / 2**20:.0f} MB")
    print(", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common()))
    sys.exit(bool(faults) or most > BYTES)


if __name__ == "__main__":
    main()
