"""The seal: typed msgpack under a keyed hash, which authenticates messages of a run.

The seal is a keyed BLAKE2b over the key expression and the body. It detects messages that the
network corrupted, that were put on another key or in another run and, if the run has a secret,
forged ones. The key expression names the sender. Messages between an agent and the plant are
sealed with a secret key that these two alone have.
"""

import hashlib
import logging
import math
import re
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from typing import Any, TypeVar

import msgspec

from phalanx.messages.kinds import MAX_BYTES, VERSION, Message

SEAL_BYTES = 16


class Malformed(ValueError):  # noqa: N818 - a drop to be counted, not a failure
    """A payload that is not a valid message; the text is a short reason, for counting."""


M = TypeVar("M", bound=Message)
_ENORMOUS = re.compile(rb"\xcb[\x7e\x7f\xfe\xff]|\xca[\x7f\xff][\x80-\xff]", re.DOTALL)
"""First bytes of a msgpack float of 64 or 32 bits that is infinite, NaN or above 8e298."""
_encoder = msgspec.msgpack.Encoder()


@cache
def _decoder(kind: type[M]) -> "msgspec.msgpack.Decoder[M]":
    return msgspec.msgpack.Decoder(kind)


class Sealer:
    """Seals and opens payloads with one secret."""

    def __init__(self, secret: bytes = b"") -> None:
        """secret: if empty, the seal detects corruption, but not forgery."""
        secret_key = hashlib.blake2b(secret, digest_size=32).digest()
        self._key_for: Callable[[str], bytes] = lambda key: secret_key

    def seal(self, key: str, message: Message) -> bytes:
        """Return the payload to put under a key expression."""
        body = _encoder.encode(message)
        return self._mac(key, body) + body

    def open(self, key: str, payload: bytes, kind: type[M]) -> M:
        """Return the message in a payload that came under a key expression.

        Raises:
            Malformed: too large, too short, not sealed for this key, not msgpack of this kind,
                another version, or a number that is not finite or too large.
        """
        if len(payload) > MAX_BYTES:
            raise Malformed("oversized")
        if len(payload) <= SEAL_BYTES:
            raise Malformed("truncated")
        mac, body = payload[:SEAL_BYTES], payload[SEAL_BYTES:]
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
        # A message without these bytes has no such number; one with them may have it by chance.
        if message.largest < math.inf and _ENORMOUS.search(body):
            beyond = [n for n in _numbers(message) if not abs(n) <= message.largest]
            if beyond:
                raise Malformed("too large" if all(map(math.isfinite, beyond)) else "not finite")
        return message

    def open_damaged(self, key: str, message: M, number: int) -> M:
        """Open a message after flipping bits of one byte of its payload, chosen by the number.

        Sealing is deterministic: the payload made here is the one that its sender put. Raises
        Malformed, unless the seal fails to detect the damage.
        """
        payload = bytearray(self.seal(key, message))
        # Knuth's multiplier: another byte and other bits for each number, but reproducible.
        mixed = number * 2654435761
        payload[mixed % len(payload)] ^= 1 + mixed % 255
        return self.open(key, bytes(payload), type(message))

    def _mac(self, key: str, body: bytes) -> bytes:
        mac = hashlib.blake2b(key.encode(), key=self._key_for(key), digest_size=SEAL_BYTES)
        mac.update(body)
        return mac.digest()


class RunSealer(Sealer):
    """Seals and opens payloads of a run, with a secret key for each key expression."""

    def __init__(self, key_of: Callable[[str], bytes]) -> None:
        """key_of: returns the secret key, of 32 bytes, for a key expression."""
        self._key_for = lru_cache(maxsize=4096)(key_of)


def _numbers(value: Any) -> Iterator[float]:
    """Return every float in a message, at any depth."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            yield from _numbers(getattr(value, field))


class Refusals:
    """Payloads that a program dropped; any thread may add to them."""

    def __init__(self, log: logging.Logger) -> None:
        self.counts: Counter[str] = Counter()
        """By reason."""
        self._log, self._lock = log, threading.Lock()

    def add(self, key: str, reason: object) -> None:
        """Count a dropped payload that came under a key expression.

        The 1st, 10th, 100th and so on of each reason are logged: a flood must not fill the disk.
        """
        with self._lock:
            self.counts[str(reason)] += 1
            n = self.counts[str(reason)]
        if n == 10 ** (len(str(n)) - 1):
            self._log.warning("dropped a payload on %s: %s (%d so far)", key, reason, n)
