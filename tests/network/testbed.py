"""Runs over a bad wire between two network namespaces: real TCP and UDP.

The plant is in one of them, the agents in the other; a broadcast goes from agent to hub to agent,
so it crosses the wire twice.

Each end has a TUN device; this process holds the other side of both and passes packets on, late or
not at all. It needs root and /dev/net/tun, and no netem, which not every kernel has. Nothing of the
host's own network is touched, and namespaces and devices go with the block that made them.
"""

import contextlib
import fcntl
import heapq
import os
import select
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from phalanx.recording.read import Recording, UnreadableRecordingError, read

SLOW = tuple(f"agents.{group}.clock.period=0.1" for group in (0, 1))
"""Ten samples a second: the machine has little part in what is measured."""
DELAY, JITTER = 0.02, 0.002
"""Of a broadcast, over both crossings [s]."""
SETTLED = 5.0
"""When the wire has long been what it is to be [s]; recordings are written some time behind."""
HERE, THERE = "10.77.0.1", "10.77.0.2"
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
_PACKET = 65_536


@dataclass(frozen=True)
class Wire:
    """Delay and loss of packets, in either direction."""

    delay: float = 0.0
    """Mean [s]."""
    jitter: float = 0.0
    """At most so much more or less, uniformly [s]."""
    loss: float = 0.0
    """Share that is lost; 1: a partition."""


class Testbed:
    """Two namespaces and the wire between them, while it is open."""

    def __init__(self, seed: int = 0) -> None:
        """Raises OSError or subprocess.CalledProcessError where this may not be done."""
        self.wire = Wire()
        """May be replaced at any time; packets under way go on as they were."""
        self.here, self.there = (f"phx{os.getpid()}{end}" for end in "ab")
        self._draws = np.random.default_rng(seed)
        self._over = threading.Event()
        self._undo = contextlib.ExitStack()
        with contextlib.ExitStack() as undo:
            ends = (self.here, HERE), (self.there, THERE)
            self._tuns = [self._end(undo, place, address) for place, address in ends]
            self._undo = undo.pop_all()
        self._forwarding = threading.Thread(target=self._forward, daemon=True)
        self._forwarding.start()

    def _end(self, undo: contextlib.ExitStack, namespace: str, address: str) -> int:
        _ip("netns", "add", namespace)
        undo.callback(_ip, "netns", "del", namespace)
        tun = os.open("/dev/net/tun", os.O_RDWR)
        undo.callback(os.close, tun)
        fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH", namespace.encode(), _IFF_TUN | _IFF_NO_PI))
        _ip("link", "set", namespace, "netns", namespace)
        _ip("-n", namespace, "addr", "add", f"{address}/24", "dev", namespace)
        _ip("-n", namespace, "link", "set", namespace, "up")
        _ip("-n", namespace, "link", "set", "lo", "up")
        return tun

    def start(self, namespace: str, *command: str) -> subprocess.Popen[str]:
        """Start a command in one of the namespaces."""
        return subprocess.Popen(
            ["ip", "netns", "exec", namespace, *command],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, "PHALANX_SECRET": "s"},
        )  # fmt: skip

    def close(self) -> None:
        """Take all of it down; what runs in the namespaces should have ended."""
        self._over.set()
        self._forwarding.join()
        self._undo.close()

    def _forward(self) -> None:
        under_way: list[tuple[float, int, int, bytes]] = []
        number, last = count(), dict.fromkeys(self._tuns, 0.0)
        while not self._over.is_set():
            now = time.monotonic()
            while under_way and under_way[0][0] <= now:
                _, _, to, packet = heapq.heappop(under_way)
                with contextlib.suppress(OSError):  # its end is down
                    os.write(to, packet)
            wait = min(under_way[0][0] - now, 0.1) if under_way else 0.1
            for tun in select.select(self._tuns, [], [], max(wait, 0.0))[0]:
                packet, wire = os.read(tun, _PACKET), self.wire
                if self._draws.random() < wire.loss:
                    continue
                late = wire.delay + wire.jitter * self._draws.uniform(-1.0, 1.0)
                other = self._tuns[1 - self._tuns.index(tun)]
                # A queue's delay varies, but it keeps the order: over UDP Zenoh drops packets
                # that arrive after later ones.
                last[other] = max(last[other], time.monotonic() + late)
                heapq.heappush(under_way, (last[other], next(number), other, packet))


@contextlib.contextmanager
def opened(seed: int = 0) -> Iterator[Testbed]:
    """A test bed while the block runs."""
    bed = Testbed(seed)
    try:
        yield bed
    finally:
        bed.close()


def unavailable() -> str | None:
    """Return the reason why no test bed can be opened here, or None."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    try:
        with opened():
            return None
    except (OSError, subprocess.CalledProcessError) as error:
        return f"no network namespaces or TUN devices here: {error}"


def crossing(loss: float) -> Wire:
    """One of two crossings that together delay by DELAY and lose this share."""
    return Wire(DELAY / 2, JITTER / 2, 1.0 - (1.0 - loss) ** 0.5)


def over_the_wire(
    bed: Testbed,
    protocol: str,
    duration: float,
    out: Path,
    course: Callable[[Callable[[float], None]], None],
) -> Recording:
    """Simulation 1 over the test bed; course(until) changes the wire as virtual time goes on."""
    scenario = ("--scenario", "unicycles", "--run", "bed", "--insecure")
    overrides = [part for o in (*SLOW, f"duration={duration}") for part in ("--set", o)]
    endpoint = f"{protocol}/{HERE}:7447"
    command = (sys.executable, "-m", "phalanx")
    plant = bed.start(bed.here, *command, "plant", *scenario, *overrides, "--listen", endpoint,
                      "--folder", str(out), "--real-time", "1")  # fmt: skip
    programs = [plant]
    try:
        for n in range(1, 6):
            programs.append(bed.start(bed.there, *command, "agent", str(n), *scenario, *overrides,
                                      "--connect", endpoint))  # fmt: skip

        def until(t: float) -> None:
            while plant.poll() is None and _reached(out) < t:
                time.sleep(0.05)

        course(until)
        output, _ = plant.communicate(timeout=duration + 120.0)
    finally:
        for program in programs:
            program.kill()
            program.communicate()
    try:
        return read(out)
    except UnreadableRecordingError as error:
        raise RuntimeError(f"the run over {protocol} did not begin: {output}") from error


def _reached(out: Path) -> float:
    with contextlib.suppress(UnreadableRecordingError):
        return max((state.t for state in read(out).states), default=-1.0)
    return -1.0


def partitioned(bed: Testbed, duration: float, out: Path) -> Recording:
    """A run over TCP whose wire is cut for 3 s."""

    def course(until: Callable[[float], None]) -> None:
        bed.wire = crossing(0.0)
        until(0.0)
        bed.wire = Wire(loss=1.0)
        time.sleep(3.0)
        bed.wire = crossing(0.0)

    return over_the_wire(bed, "tcp", duration, out, course)


def lossy(bed: Testbed, protocol: str, loss: float, duration: float, out: Path) -> Recording:
    """A run over a wire that loses packets, once all are there."""

    def course(until: Callable[[float], None]) -> None:
        until(0.0)
        bed.wire = crossing(loss)

    return over_the_wire(bed, protocol, duration, out, course)


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)
