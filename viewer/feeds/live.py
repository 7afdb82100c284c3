"""A live run over Zenoh: the plant's frames as they come, and commands back to it."""

import logging
import queue
import time
from typing import Protocol, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from phalanx.faults.commands import CommandKind
from phalanx.guarantee.verdict import Summary
from phalanx.recording.records import Command
from phalanx.scenario.load import from_json
from phalanx.viewer.feeds.history import Gathered, History
from phalanx.viewer.scene.model import SceneModel, scene_model
from phalanx.wire import session as wire
from phalanx.wire.frames import CommandMessage, Frame, Setup
from phalanx.wire.keys import PLANT, Keys
from phalanx.wire.messages import VERSION, Ended, Malformed, Sealer

Array = NDArray[np.float64]

log = logging.getLogger("phalanx.viewer")


class NoRunError(RuntimeError):
    """No plant answers for this run; the message names endpoint and run."""


class Feed(Protocol):
    """Where frames come from: a live run or a recording."""

    cast: SceneModel
    history: History
    summary: Summary | None
    """The verdict, once there is one."""
    over: bool
    """Whether a live run's plant has left; never of a recording."""

    def take(self) -> Frame | None:
        """The newest frame, unless it was taken before."""

    def past(self, t: float) -> Array:
        """Positions on the way to t [s], shape (s, N, 3)."""


class Live:
    """A run that goes on now."""

    def __init__(
        self, endpoint: str, run_id: str, secret: bytes, control: bytes, timeout: float
    ) -> None:
        """Join as a listener.

        Args:
            endpoint: the hub's.
            run_id: the run's name.
            secret: the run's.
            control: the run's control secret; empty for a viewer that only looks.
            timeout: how long to try [s].

        Raises:
            HubError: nobody listens at the endpoint. NoRunError: it knows no such run.
        """
        self.summary: Summary | None = None
        self.over = False
        self._keys, self._sealer = Keys(run_id), Sealer(secret)
        self._commands = Sealer(control)
        self._frames: queue.SimpleQueue[Frame] = queue.SimpleQueue()
        self._session = wire.open_client(endpoint, timeout)
        try:
            setup = self._ask_for_setup(endpoint, run_id, timeout)
            self.cast = scene_model(from_json(setup.scenario.decode()))
            self._past = Gathered(self.cast)
            self.history = self._past.history
            self.commandable = setup.commandable and bool(control)
            """Whether the plant will obey this viewer."""
            self._control = wire.publisher(self._session, self._keys.control)
            wire.subscribe(self._session, self._keys.view, self._on_frame)
            wire.subscribe(self._session, self._keys.verdict, self._on_verdict)
            wire.watch(self._session, self._keys.alive(PLANT), self._on_plant)
        except BaseException:
            self._session.close()  # type: ignore[no-untyped-call]
            raise

    def take(self) -> Frame | None:
        """The newest frame, unless it was taken before; all that came go into the history."""
        newest = None
        while not self._frames.empty():
            newest = self._frames.get()
            self._past.add(newest)
        return newest

    def past(self, t: float) -> Array:
        """Positions on the way here, shape (s, N, 3)."""
        return self._past.trail.positions

    def command(self, kind: CommandKind, agent: str = "", value: float = 0.0) -> None:
        """Ask the plant for a control. It refuses without the control secret."""
        control = Command(0.0, kind, agent, value)
        message = CommandMessage(VERSION, time.time_ns(), control)
        self._control.put(self._commands.seal(self._keys.control, message))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def _ask_for_setup(self, endpoint: str, run_id: str, timeout: float) -> Setup:
        key = self._keys.scenario
        answer = wire.ask(self._session, key, timeout)
        if answer is None:
            raise NoRunError(f"{endpoint} knows no run {run_id!r} (after {timeout:g} s)")
        try:
            return self._sealer.open(key, answer, Setup)
        except Malformed as reason:
            raise NoRunError(f"run {run_id!r} at {endpoint}: {reason}; is the secret right?") from (
                reason
            )

    def _on_frame(self, key: str, payload: bytes) -> None:
        try:
            self._frames.put(self._sealer.open(key, payload, Frame))
        except Malformed as reason:
            log.warning("dropped a frame: %s", reason)

    def _on_verdict(self, key: str, payload: bytes) -> None:
        try:
            ended = self._sealer.open(key, payload, Ended)
            self.summary = msgspec.json.decode(ended.summary, type=Summary)
        except (Malformed, msgspec.DecodeError) as reason:
            log.warning("dropped a verdict: %s", reason)

    def _on_plant(self, _key: str, alive: bool) -> None:
        self.over = not alive
