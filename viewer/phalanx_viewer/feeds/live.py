"""A live run over Zenoh: the plant's frames as they come, and commands back to it."""

import logging
import queue
import time
from contextlib import AbstractContextManager

import numpy as np

from phalanx.faults.commands import Command, CommandKind
from phalanx.guarantee.verdict import Summary, read_summary
from phalanx.messages.frames import CommandMessage, Frame, Setup
from phalanx.messages.keys import PLANT
from phalanx.messages.kinds import Ended
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Malformed, Refusals, Sealer
from phalanx.scenario.load import from_json
from phalanx.schema.user_code import code_trusted
from phalanx.theory.arrays import Array
from phalanx.wire import liveliness, pubsub
from phalanx.wire.session import open_client
from phalanx_viewer.feeds.live_history import LiveHistory
from phalanx_viewer.scene.model import SceneModel, scene_model

log = logging.getLogger("phalanx.viewer")


class NoRunError(RuntimeError):
    """No plant answers for this run; the message names endpoint and run."""


class Live(AbstractContextManager["Live"]):
    """A run that goes on now."""

    def __init__(
        self, membership: Membership, command_secret: bytes = b"", trust: bool = True
    ) -> None:
        """Join the run as a listener.

        command_secret: seals commands to the run; empty: send none. trust: whether code that the
        run's scenario names may be imported. Raises HubError, NoRunError, and ScenarioError of code
        that is not trusted.
        """
        self.summary: Summary | None = None
        """The verdict, once there is one."""
        self.over = False
        """True once the plant has left."""
        self._refusals = Refusals(log)
        self._keys, self._sealer = membership.keys, membership.sealer
        # Frames arrive in a thread of Zenoh's, which must return at once. The page's thread adds
        # them to the history, because its plots read that.
        self._frames: queue.SimpleQueue[Frame] = queue.SimpleQueue()
        self._session = open_client(membership.endpoint, membership.timeout, membership.credentials)
        try:
            setup = self._ask_for_setup(membership)
            with code_trusted(trust):
                self.model = scene_model(from_json(setup.scenario.decode()))
            self.history = LiveHistory(self.model)
            self.radio = self.history.beliefs
            """What agents know of one another; None where they see one another."""
            self.log, self.violations = self.history.log, self.history.violations.values()
            self.marks = self.history.marks
            self.commandable = setup.commandable and bool(command_secret)
            """Whether the plant will obey this viewer."""
            self.real_time = setup.real_time
            sealer = Sealer(command_secret)
            self._commands = pubsub.SealedPublisher(self._session, sealer, self._keys.command)
            # When all is ready: Zenoh's threads call from here on.
            pubsub.subscribe(self._session, self._keys.frames, self._on_frame)
            pubsub.subscribe(self._session, self._keys.verdict, self._on_verdict)
            liveliness.watch(self._session, self._keys.alive(PLANT), self._on_plant)
        except BaseException:
            self._session.close()  # type: ignore[no-untyped-call]
            raise

    def take(self) -> Frame | None:
        """Return the newest frame, if one arrived, and add all that arrived to the history."""
        newest = None
        while not self._frames.empty():
            newest = self._frames.get()
            self.history.add(newest)
        return newest

    @property
    def unfinished(self) -> str:
        """Reason why there will be no verdict; empty otherwise."""
        return "the plant left without a verdict" if self.over and not self.summary else ""

    def recent_paths(self, t: float) -> Array:
        """Positions up to t [s], shape (s, N, 3), the oldest first."""
        return self.history.recent_path(t)

    def command(self, kind: CommandKind, agent: str = "", value: float = 0.0) -> None:
        """Send the plant a command, which it rejects without the command secret."""
        command = Command(t=0.0, kind=kind, agent=agent, value=value)
        # The plant rejects a number that is not above the last one. Wall clock time also increases
        # from one viewer to the next, and over a restart.
        self._commands.put(CommandMessage(number=time.time_ns(), command=command))

    def __exit__(self, *_: object) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def _ask_for_setup(self, to: Membership) -> Setup:
        key = self._keys.scenario
        answer = pubsub.ask(self._session, key, to.timeout)
        if answer is None:
            raise NoRunError(f"{to.endpoint} knows no run {to.run!r} (after {to.timeout:g} s)")
        try:
            return self._sealer.open(key, answer, Setup)
        except Malformed as reason:
            run = f"run {to.run!r} at {to.endpoint}"
            raise NoRunError(f"{run}: {reason}; is the secret right?") from reason

    def _on_frame(self, key: str, payload: bytes) -> None:
        try:
            frame = self._sealer.open(key, payload, Frame)
            check_frame(frame, self.model)
        except Malformed as reason:
            self._refusals.add(key, reason)
        else:
            self._frames.put(frame)

    def _on_verdict(self, key: str, payload: bytes) -> None:
        try:
            self.summary = read_summary(self._sealer.open(key, payload, Ended).summary)
        except ValueError as reason:
            self._refusals.add(key, reason)

    def _on_plant(self, _key: str, alive: bool) -> None:
        self.over = not alive


def check_frame(frame: Frame, model: SceneModel) -> None:
    """Raise Malformed unless a frame has the sizes of its run, and finite states."""
    members, pairs = model.swarm.members, model.swarm.safe_set.pairs
    states = sum(len(member.dynamics.states) for member in members)
    if len(frame.x) != 8 * states or len(frame.agents) != len(members):
        raise Malformed("wrong size")
    if not np.isfinite(np.frombuffer(frame.x, dtype="<f8")).all():
        raise Malformed("not finite")
    for status, member in zip(frame.agents, members, strict=True):
        step, inputs = status.step, len(member.dynamics.inputs)
        if step is not None and not len(step.u) == len(step.u_nom) == inputs:
            raise Malformed("wrong size")
    for i, said in frame.statements:
        of = members[said.sender] if 0 <= max(i, said.sender) < len(members) else None
        sizes = of and (len(of.dynamics.states), len(of.dynamics.states), len(of.dynamics.inputs))
        numbers = said.t, said.t_apply, *said.x, *said.z, *said.u
        if min(i, said.sender) < 0 or sizes != (len(said.x), len(said.z), len(said.u)):
            raise Malformed("wrong statement")
        if not np.isfinite(numbers).all():
            raise Malformed("not finite")
    ends = [end for event in frame.link_events for end in (event.sender, event.receiver)]
    if any(not 0 <= end < len(members) for end in ends) or not 0 <= frame.pair < len(pairs):
        raise Malformed("wrong agents")
