"""A user's own program: asked for each input by a line of JSON, or in the place of the agent.

docs/your-program.md has the lines. Whatever a program that is asked does, each mistake ends in one
line that names it.
"""

import contextlib
import json
import logging
import os
import select
import shlex
import signal
import subprocess
import time
import weakref
from collections.abc import Mapping, Sequence
from typing import NoReturn

import msgspec
import numpy as np
from msgspec import Struct

from phalanx.messages.credentials import COMMAND_SECRET, SECRET
from phalanx.messages.membership import Membership
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.child import end_with_parent
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx.theory.laws.law import ControlledAgent, ControllerView

log = logging.getLogger("phalanx.agent")

LONGEST_LINE = 65_536
"""Most bytes of a line from a program."""
_SHARE, _LONGEST_WAIT = 0.5, 8.0
"""Share of the plant's timeout that a program has for a line, and the longest [s of wall time]."""
_DYING = 1.0
"""Time for a program that closed its output to end [s]."""


class ProgramError(MistakenMethodError):
    """A program broke a rule of the protocol; the message names it, the rule, and what it did."""

    def __init__(self, command: str, expected: str, got: str) -> None:
        """Say what was expected of a command, and what came."""
        self.expected, self.got = f"{command}: expected {expected}", got


class Answer(Struct, forbid_unknown_fields=True):
    """A program's line."""

    u: list[float]
    log: str = ""


def settings(swarm: Swarm, i: int) -> dict[str, str]:
    """Return what agent i's program finds in its environment."""
    member = swarm.members[i]
    return {
        "PHALANX_AGENT": member.name,
        "PHALANX_INDEX": str(i),
        "PHALANX_AGENTS": ",".join(swarm.names),
        "PHALANX_STATES": ",".join(member.dynamics.states),
        "PHALANX_INPUTS": ",".join(member.dynamics.inputs),
        "PHALANX_PERIOD": str(swarm.groups[i].clock.period),
        "PHALANX_LATENCY": str(swarm.time.latency),
        "PHALANX_SEED": str(swarm.seed),
    }


def become(swarm: Swarm, membership: Membership) -> NoReturn:
    """Replace this process by the program of the membership's agent, which does docs/wire.md.

    Raises OSError if there is no such program.
    """
    name = membership.identity
    i = swarm.names.index(name)
    agent = membership.of(name, (name,), swarm.names)
    links = swarm.scenario.model_dump(mode="json", by_alias=True, include={"network", "faults"})
    environment = _without_secrets() | settings(swarm, i)
    environment |= {
        "PHALANX_RUN": agent.run,
        "PHALANX_CONNECT": agent.endpoint,
        "PHALANX_DIGEST": swarm.digest,
        "PHALANX_LINKS": json.dumps(links),
        "PHALANX_PASSWORD": agent.password_of(name),
        "PHALANX_KEYRING": json.dumps({of: key.hex() for of, key in (agent.held or {}).items()}),
    }
    if agent.identity_folder is not None:
        environment["PHALANX_KEYS"] = str(agent.identity_folder)
    command = swarm.groups[i].program
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    os.execvpe(command[0], command, environment)


class ProgramProcess:
    """A program that runs as a child of this process, and answers lines by lines."""

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str], patience: float
    ) -> None:
        """Start it; its errors go where this process's go, and it ends with this process.

        patience: longest wait for a line [s].

        Raises ValueError: it cannot be started.
        """
        self.name, self._patience = shlex.join(command), patience
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                env=_without_secrets() | dict(environment),
                start_new_session=True,  # a Ctrl-C is for the run, which ends it
                preexec_fn=_begin,
            )
        except OSError as error:
            raise ValueError(f"{self.name}: cannot be started: {error.strerror}") from error
        assert self._process.stdin
        assert self._process.stdout
        self._to, self._from = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._to, False)
        self._came = b""
        weakref.finalize(self, _kill, self._process)

    def ask(self, question: bytes) -> bytes:
        """Return the line that answers a line, both without their ends. Raises ProgramError."""
        self._require_silence()
        until, rest = time.monotonic() + self._patience, question + b"\n"
        while rest:
            self._wait(self._to, select.POLLOUT, until, "to read a line")
            with contextlib.suppress(BlockingIOError):
                try:
                    rest = rest[os.write(self._to, rest) :]
                except BrokenPipeError:
                    raise self._ended() from None
        while b"\n" not in self._came:
            if len(self._came) > LONGEST_LINE:
                got = f"{len(self._came)} without its end"
                raise self.error(f"a line of at most {LONGEST_LINE} bytes", got)
            self._wait(self._from, select.POLLIN, until, "to answer")
            more = os.read(self._from, LONGEST_LINE)
            if not more:
                raise self._ended()
            self._came += more
        line, _, self._came = self._came.partition(b"\n")
        if self._came:
            raise self.error("one line for each sample", "more of them")
        return line

    def _require_silence(self) -> None:
        """Raise ProgramError if it has written since its answer: lines would be one sample off."""
        poll = select.poll()
        poll.register(self._from, select.POLLIN)
        if poll.poll(0):
            if os.read(self._from, LONGEST_LINE):
                raise self.error("one line for each sample", "more of them")
            raise self._ended()

    def error(self, expected: str, got: str) -> ProgramError:
        """Make the error of a rule that it broke."""
        return ProgramError(self.name, expected, got)

    def _wait(self, file: int, event: int, until: float, deed: str) -> None:
        poll = select.poll()
        poll.register(file, event)
        if not poll.poll(max(1e3 * (until - time.monotonic()), 0.0)):
            raise self.error(f"{deed} within {self._patience:g} s", "nothing")

    def _ended(self) -> ProgramError:
        """Make the error of its end, or of its closing a stream."""
        try:
            code = self._process.wait(_DYING)
        except subprocess.TimeoutExpired:
            return self.error("to answer until its input ends", "a closed stream")
        how = f"its death by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
        return self.error("to answer until its input ends", how)


def _without_secrets() -> dict[str, str]:
    """Return this process's environment without the secrets of all agents."""
    return {k: v for k, v in os.environ.items() if k not in (SECRET, COMMAND_SECRET)}


def _begin() -> None:
    """Prepare the program's process: agents block SIGTERM, which it need not."""
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    end_with_parent()


def _kill(process: "subprocess.Popen[bytes]") -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


class ProgramController:
    """The controller of one agent that asks its program for each input."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        """Take what the program gets. Raises ScenarioError of one that is not to be asked."""
        group = swarm.groups[i]
        if group.protocol == "zenoh":
            agent = f"agent {swarm.names[i]}"
            raise ScenarioError(f"{agent} speaks zenoh, a process alone: take engine 'processes'")
        self._names, self._command = swarm.names, group.program
        self._environment = settings(swarm, i)
        self._patience = min(_SHARE * swarm.time.timeout, _LONGEST_WAIT)
        self._least = group.clock.period - group.clock.jitter
        self._size = len(swarm.members[i].dynamics.inputs)

    def prepare(self, agent: ControlledAgent) -> None:
        """Start the program. Raises ValueError."""
        self._process = ProgramProcess(self._command, self._environment, self._patience)

    def input(self, view: ControllerView) -> Array:
        """Return the program's input, shape (m_i,). Raises ProgramError."""
        process = self._process
        line = process.ask(msgspec.json.encode(self._question(view)))
        try:
            answer = msgspec.json.decode(line, type=Answer)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            begin = line[:60].decode(errors="replace")
            raise process.error('a line of JSON as {"u": [1.0]}', f"{begin!r} ({error})") from None
        if len(answer.u) != self._size:
            raise process.error(f"{self._size} numbers in u", str(len(answer.u)))
        u = np.array(answer.u)
        if not (np.abs(u) <= LARGEST).all():
            raise process.error("finite numbers in u", str(answer.u))
        if answer.log:
            log.info("%s: %s", process.name, answer.log)
        return u

    def _question(self, view: ControllerView) -> dict[str, object]:
        goal = view.goal._asdict()
        return {
            "t": view.t,
            "deadline": view.t + self._least,
            "x": view.x[view.i].tolist(),
            "goal": {name: value.tolist() for name, value in goal.items()},
            "u_nom": view.u_nom.tolist(),
            "limits": {"A": view.inputs.A.tolist(), "b": view.inputs.b.tolist()},
            "peers": self._peers(view),
        }

    def _peers(self, view: ControllerView) -> dict[str, dict[str, object]]:
        boxes, peers = view.box, dict[str, dict[str, object]]()
        for l, x in view.x.items():
            if l == view.i:
                continue
            peer = peers[self._names[l]] = {
                "x": x.tolist(),
                "age": view.age.get(l, 0.0),
                "normal": l in view.normal,
            }
            if l in boxes:
                peer["set"] = [side.tolist() for side in boxes[l]]
            if l in view.received:
                message = view.received[l]
                peer["u"], peer["u_age"] = message.u.tolist(), message.age
        return peers
