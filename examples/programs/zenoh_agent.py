"""The part of an agent by Zenoh that all need: zenoh, msgpack and docs/wire.md alone."""

import hashlib
import json
import queue
import time
from collections.abc import Callable, Sequence
from os import environ
from typing import Any

import msgpack
import zenoh

NAME, INDEX = environ["PHALANX_AGENT"], int(environ["PHALANX_INDEX"])
NAMES, RUN = environ["PHALANX_AGENTS"].split(","), f"phalanx/{environ['PHALANX_RUN']}"
KEYS = {name: bytes.fromhex(key) for name, key in json.loads(environ["PHALANX_KEYRING"]).items()}
VERSION, SEAL, BLOCK = 5, 16, zenoh.CongestionControl.BLOCK


def seal(key: str, body: bytes) -> bytes:
    """Return the seal of a message: its key is its agent's, or that of a link."""
    _, _, kind, sender, *receiver = key.split("/")
    owner = f"{sender}>{receiver[0]}" if kind == "broadcast" else sender
    return hashlib.blake2b(key.encode() + body, key=KEYS[owner], digest_size=SEAL).digest()


class Run:
    """A run that this program takes part in."""

    def __init__(self) -> None:
        auth = {"usrpwd": {"user": NAME, "password": environ["PHALANX_PASSWORD"]}}
        hub = {"endpoints": [environ["PHALANX_CONNECT"]]}
        config = json.dumps({"mode": "client", "connect": hub, "transport": {"auth": auth}})
        self._session = zenoh.open(zenoh.Config.from_json5(config))
        self._arrived: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()

    def put(self, to: str, fields: Sequence[Any]) -> None:
        """Put a message, sealed."""
        body = msgpack.packb([VERSION, *fields])
        payload = seal(f"{RUN}/{to}", body) + body
        self._session.put(f"{RUN}/{to}", payload, congestion_control=BLOCK)

    def join(self, take: Callable[[str, list[Any]], None]) -> None:
        """Call with the sender and the fields of samples and broadcasts, until the plant leaves."""
        handler = zenoh.handlers.Callback(self._arrived.put, indirect=False)
        for key in (f"sample/{NAME}", f"broadcast/*/{NAME}"):
            self._session.declare_subscriber(f"{RUN}/{key}", handler)
        self._session.liveliness().declare_subscriber(f"{RUN}/alive/plant/*", handler, history=True)
        telemetry = self._session.declare_publisher(f"{RUN}/telemetry/{NAME}")
        while not (self._arrived.qsize() and telemetry.matching_status.matching):
            time.sleep(0.01)  # until the plant is there
        token = f"{RUN}/alive/{NAME}/{environ['PHALANX_DIGEST']}"
        with self._session.liveliness().declare_token(token):
            while (message := self._arrived.get()).kind == zenoh.SampleKind.PUT:
                key, payload = str(message.key_expr), message.payload.to_bytes()
                if payload and payload[:SEAL] == seal(key, payload[SEAL:]):  # not the plant's token
                    take(key.split("/")[3], msgpack.unpackb(payload[SEAL:])[1:])
        self._session.close()
