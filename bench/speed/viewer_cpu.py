"""Server CPU of the viewer at 30 updates a second, for a small and for a large swarm.

python bench/speed/viewer_cpu.py              # without a browser
python bench/speed/viewer_cpu.py --page       # with a headless Chromium, on a core of its own

Agents drift along circles, and every frame goes through the code of a live run: history, scene,
texts and plots. The CPU time is that of the server's process per update, so that other work on the
machine does not count; times RATE it is a share of one core.
"""

import argparse
import contextlib
import multiprocessing
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event

import numpy as np
import psutil
from numpy.typing import NDArray
from phalanx_viewer.feeds.live_history import LiveHistory
from phalanx_viewer.page.page import Page
from phalanx_viewer.scene.model import scene_model
from phalanx_viewer.scene.server import choose_port

from phalanx.guarantee.verdict import Summary, Violation
from phalanx.messages.frames import AgentStatus, Frame
from phalanx.messages.step_report import AppliedStep
from phalanx.scenario.agents import AgentGroup
from phalanx.scenario.load import validate
from phalanx.scenario.model import Scenario
from phalanx.theory.rows.origin import Origin

SIZES = (10, 300)
RATE = 30.0
HOST = "127.0.0.1"


def crowd(count: int) -> Scenario:
    """Make a scenario of `count` single integrators on a grid, every tenth an adversary."""
    side = int(np.ceil(np.sqrt(count)))
    groups = []
    for role, law in (("normal", "track-velocity"), ("adversary", "pursue")):
        chosen = [k for k in range(count) if (k % 10 == 9) == (role == "adversary")]
        groups.append(
            {
                "names": [str(k) for k in chosen],
                "role": role,
                "dynamics": {"type": "single-integrator", "speed": 2.0},
                "law": {"type": law},
                "clock": {"period": 0.02},
                "start": [[3.0 * (k % side), 3.0 * (k // side)] for k in chosen],
            }
        )
    function = {"type": "separation", "radius": 1.0}
    safety = {"function": function, "rho": 5.0, "alpha": [2.0], "eta": 1.0}
    small = {"name": "crowd", "duration": 60.0, "safety": safety, "agents": [_few(groups[0])]}
    # More than a run may have processes for can still be drawn.
    agents = tuple(AgentGroup.model_validate(group) for group in groups)
    return validate(small, "bench").model_copy(update={"agents": agents})


def _step(u: tuple[float, ...]) -> AppliedStep:
    return AppliedStep(origin=Origin.QP, residual=0.0, u_nom=u, solve_time=0.0, u=u)


class Carousel:
    """A stand-in for a live run, with a new frame at every call."""

    def __init__(self, count: int) -> None:
        self.model = scene_model(crowd(count))
        self.history = LiveHistory(self.model)
        self.summary: Summary | None = None
        self.over, self.unfinished = False, ""
        self.log, self.violations = self.history.log, list[Violation]()
        self.marks = self.history.marks
        self._start = self.model.swarm.start()
        self._phases = np.repeat(np.arange(count), 2) + np.tile([0.0, np.pi / 2.0], count)
        self._frames = 0

    def recent_paths(self, t: float) -> NDArray[np.float64]:
        """Return the positions on the way to the present."""
        return self.history.recent_path(t)

    def take(self) -> Frame:
        """Return the next frame."""
        self._frames += 1
        t = self._frames / RATE
        velocities = np.cos(t + self._phases)
        agents = [AgentStatus(step=_step(tuple(v))) for v in velocities.reshape(-1, 2).tolist()]
        frame = Frame(
            t=t, x=(self._start + np.sin(t + self._phases)).tobytes(),
            h_tot=-1.0, h=-1.0, worst_h=-1.0, pair=self._frames % 9,
            turned=(), agents=tuple(agents), link_events=(),
            steps=self._frames, real_time_factor=1.0, assumptions=(), violations=(), log=(),
            paused=False, speed=0.0, loss=None, delay=None,
        )  # fmt: skip
        self.history.add(frame)
        return frame


def serve(count: int, port: int, ready: Event, over: Event, updates: "Synchronized[int]") -> None:
    """Run the server's process: a page fed at RATE."""
    page = Page(HOST, port, (), Carousel(count))  # type: ignore[arg-type]
    page.tick()
    ready.set()
    due = time.monotonic()
    while not over.is_set():
        page.tick()
        updates.value += 1
        due = max(due + 1.0 / RATE, time.monotonic() - 1.0)
        time.sleep(max(0.0, due - time.monotonic()))
    page.server.stop()


def cpu_share(count: int, seconds: float, watched: bool) -> float:
    """Measure the share of one core that the server takes at RATE."""
    context = multiprocessing.get_context("spawn")
    ready, over, port = context.Event(), context.Event(), choose_port(HOST, None)
    updates = context.Value("q")
    server = context.Process(target=serve, args=(count, port, ready, over, updates))
    server.start()
    if not ready.wait(120.0):
        raise RuntimeError(f"the server with {count} agents did not start")
    with looking_on(f"http://{HOST}:{port}") if watched else contextlib.nullcontext():
        process = psutil.Process(server.pid)
        time.sleep(3.0)  # the page loads
        before, began = process.cpu_times(), updates.value
        time.sleep(seconds)
        after, frames = process.cpu_times(), updates.value - began
    over.set()
    server.join()
    used: float = after.user + after.system - before.user - before.system
    share: float = RATE * used / frames
    return share


@contextlib.contextmanager
def looking_on(url: str) -> Iterator[None]:
    """Open the page in a headless Chromium."""
    program = shutil.which("chromium")
    if program is None:
        raise RuntimeError("--page needs a chromium on the path")
    flags = ["--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
    with tempfile.TemporaryDirectory() as profile:
        browser = subprocess.Popen(
            [program, *flags, "--enable-unsafe-swiftshader", f"--user-data-dir={profile}",
             "--remote-debugging-port=0", url],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            yield
        finally:
            browser.terminate()
            browser.wait()
            time.sleep(0.5)  # its children leave the profile


def main() -> None:
    """Measure and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seconds", type=float, default=10.0, help="to measure each size")
    arguments.add_argument("--page", action="store_true", help="let a browser look on")
    options = arguments.parse_args()
    print("| agents | server CPU at 30 updates/s |\n|---|---|")
    for count in SIZES:
        print(f"| {count} | {cpu_share(count, options.seconds, options.page):.1%} |", flush=True)


def _few(group: Mapping[str, object]) -> dict[str, object]:
    """Reduce a group to its first two agents."""
    return {k: v[:2] if isinstance(v, list) else v for k, v in group.items()}


if __name__ == "__main__":
    main()
