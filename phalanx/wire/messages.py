"""Messages: typed msgpack under a seal, validated on receipt.

The seal is a keyed BLAKE2 over the key expression and the body. It refuses what the network
corrupted, what was meant for another key or another run and, when the run has a secret, what
somebody else forged. Who sent a message is said by its key expression, which the seal covers.
"""

import hashlib
import math
from functools import cache
from typing import TypeVar

import msgspec

from phalanx.theory.rows.origin import Origin

VERSION = 1
MAX_BYTES = 65_536
_SEAL_BYTES = 16


class Malformed(ValueError):  # noqa: N818 - a drop to be counted, not a failure
    """A payload that is not a message; the text says why, in a few words fit for counting."""


class Message(msgspec.Struct, array_like=True, forbid_unknown_fields=True, frozen=True):
    """Common head of every message."""

    version: int


class Orders(msgspec.Struct, array_like=True, frozen=True):
    """What a live control asks of an agent, in every sample from then on."""

    loss: float | None = None
    """Replaces the scenario's loss on every link to this agent."""
    delay: float | None = None
    """Replaces the scenario's delay [s] on every link to this agent."""
    adversary: bool = False
    """Attack from now on."""
    die: bool = False
    """End at once, without an answer."""


class Sample(Message, frozen=True):
    """Plant to agent i at its sampling instant."""

    k: int
    t: float
    """t_i^k [s]."""
    x: bytes
    """Stacked state of all agents, little-endian float64."""
    latest: tuple[int, ...]
    """For each agent, the sequence number of its last broadcast before t; -1 if none."""
    orders: Orders | None = None


class Fate(msgspec.Struct, array_like=True, frozen=True):
    """What the network did to one broadcast on its way to the agent that reports it."""

    sender: int
    k: int
    delay: float
    """[s]; negative: lost."""


class Input(Message, frozen=True):
    """Agent i to everyone: the input it holds from t_apply on."""

    k: int
    t: float
    """t_i^k of the sample it answers [s]."""
    t_apply: float
    """[s]"""
    t_next: float
    """t_i^{k+1}, when the agent samples again [s]."""
    u: tuple[float, ...]
    """Native input, shape (m_i,)."""
    origin: Origin
    """How it was made."""
    residual: float
    """aᵀu - bound of its row; 0 for an adversary."""
    solve_time: float
    """Wall time from sample to input [s]; not part of the trajectory."""
    ages: tuple[float | None, ...] = ()
    """For each agent, age of the û_l its row used [s]; null if none."""
    fates: tuple[Fate, ...] = ()
    """Fates of the broadcasts that this step was the first to know of."""
    rejected: int = 0
    """Payloads dropped by this agent so far."""
    u_nom: tuple[float, ...] = ()
    """The nominal input, or the attack before its projection onto U_i; only shown."""


class Status(Message, frozen=True):
    """Plant to everyone, a few times a second."""

    t: float
    real_time_factor: float
    worst_h: float
    """Largest h_tot so far."""
    steps: int
    backups: int
    waiting_for: tuple[str, ...] = ()
    """Agents that have not joined yet."""


class Ended(Message, frozen=True):
    """Plant to everyone, once: the run's summary as JSON."""

    summary: bytes


M = TypeVar("M", bound=Message)
_encoder = msgspec.msgpack.Encoder()


@cache
def _decoder(kind: type[M]) -> "msgspec.msgpack.Decoder[M]":
    return msgspec.msgpack.Decoder(kind)


class Sealer:
    """Seals and opens payloads of one run."""

    def __init__(self, secret: bytes = b"") -> None:
        """With an empty secret the seal still detects corruption, but not forgery."""
        self._key = hashlib.blake2b(secret, digest_size=32).digest()

    def seal(self, key: str, message: Message) -> bytes:
        """The payload to put under a key expression."""
        body = _encoder.encode(message)
        return self._mac(key, body) + body

    def open(self, key: str, payload: bytes, kind: type[M]) -> M:
        """The message in a payload that came under a key expression.

        Raises:
            Malformed: too large, too short, not sealed for this key, not msgpack of this kind,
                another version, or a number that is not finite.
        """
        if len(payload) > MAX_BYTES:
            raise Malformed("oversized")
        if len(payload) <= _SEAL_BYTES:
            raise Malformed("truncated")
        mac, body = payload[:_SEAL_BYTES], payload[_SEAL_BYTES:]
        if mac != self._mac(key, body):
            raise Malformed("bad seal")
        try:
            message: M = _decoder(kind).decode(body)
        except msgspec.ValidationError as error:
            raise Malformed("wrong fields") from error
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise Malformed("not msgpack") from error
        if message.version != VERSION:
            raise Malformed("other version")
        if isinstance(message, Input) and not _finite(message):
            raise Malformed("not finite")
        return message

    def _mac(self, key: str, body: bytes) -> bytes:
        mac = hashlib.blake2b(key.encode(), key=self._key, digest_size=_SEAL_BYTES)
        mac.update(body)
        return mac.digest()


def _finite(message: Input) -> bool:
    times = (message.t, message.t_apply, message.t_next, message.solve_time)
    ages = [age for age in message.ages if age is not None]
    delays = [fate.delay for fate in message.fates]
    return all(map(math.isfinite, (*times, message.residual, *message.u, *ages, *delays)))
