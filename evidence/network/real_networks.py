"""Broadcasts over real TCP and UDP, and by the injected model: losses, delays and ages.

python evidence/network/real_networks.py
"""

import sys
import tempfile
from pathlib import Path

from phalanx.launcher.engine import RunOptions, execute
from phalanx.recording.read import Recording, read
from phalanx.scenario.load import load
from tests.network.broadcast_statistics import Statistics, longest_silence, statistics
from tests.network.testbed import (
    DELAY,
    JITTER,
    SETTLED,
    SLOW,
    lossy,
    opened,
    partitioned,
    unavailable,
)


def injected(loss: float, duration: float, folder: Path) -> Recording:
    """The same settings as the scenario's model of every link, in virtual time."""
    delay = f"network.delay={{time={DELAY}, jitter={JITTER}}}"
    overrides = [*SLOW, f"duration={duration}", f"network.loss={loss}", delay]
    execute(load("unicycles", overrides), folder, RunOptions("in-process"))
    return read(folder)


def main() -> None:
    """Print the table."""
    if reason := unavailable():
        sys.exit(reason)
    print("| broadcasts | sent | lost | delay p50, p99 [ms] | age used p50, p99 [ms] |")
    print("|---|---|---|---|---|")
    window = SETTLED, 23.0
    for protocol, loss in (("tcp", 0.05), ("udp", 0.01)):
        with tempfile.TemporaryDirectory() as folder, opened() as bed:
            (model := Path(folder) / "model").mkdir()
            real = lossy(bed, protocol, loss, 24.0, Path(folder))
            _row(f"{protocol}, {loss:.0%} of packets", statistics(real, *window))
            _row(f"injected, {loss:.0%}", statistics(injected(loss, 24.0, model), *window))
    with tempfile.TemporaryDirectory() as folder, opened() as bed:
        silent, heard = longest_silence(partitioned(bed, 15.0, Path(folder)))
    print(f"\nThe wire cut for 3 s: no input for {heard - silent:.2f} s.")


def _row(name: str, statistics: Statistics) -> None:
    delay, age = (
        ", ".join(f"{1e3 * v:.1f}" for v in pair) for pair in (statistics.delay, statistics.age)
    )
    print(f"| {name} | {statistics.sent} | {statistics.loss:.2%} | {delay} | {age} |", flush=True)


if __name__ == "__main__":
    main()
