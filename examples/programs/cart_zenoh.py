"""A cart's own program in the place of an agent: zenoh, msgpack and docs/wire.md alone."""

import hashlib
import json
import queue
import signal
import struct
import sys
import time
from os import environ

import msgpack
import zenoh
from cart import wheels

NAME, RUN = environ["PHALANX_AGENT"], f"phalanx/{environ['PHALANX_RUN']}"
NAMES, BLOCK = environ["PHALANX_AGENTS"].split(","), zenoh.CongestionControl.BLOCK
KEYS = {name: bytes.fromhex(key) for name, key in json.loads(environ["PHALANX_KEYRING"]).items()}


def seal(key: str, body: bytes, owner: str) -> bytes:
    return hashlib.blake2b(key.encode() + body, key=KEYS[owner], digest_size=16).digest()


def answer(session: zenoh.Session, sample: bytes) -> None:
    """Put the input for a sample, what others hear of it, and a report."""
    _, k, t, seen, states, _, _, _, hearers, _, commands, _ = msgpack.unpackb(sample)
    if commands and commands[3]:  # die
        signal.raise_signal(signal.SIGKILL)
    x = struct.unpack_from("<3d", states, 24 * seen.index(NAMES.index(NAME)))  # as all before it
    goal = {"position": [float(word) for word in sys.argv[1:]], "velocity": [0.0, 0.0]}
    u = [min(max(rate, -25.0), 25.0) for rate in wheels(list(x), goal)]  # others are refused
    report = ["controller", None, None, None, u, 0.0]
    messages = [(f"actuation/{NAME}", NAME, [k, t, u])]
    links = [(f"{NAME}/{NAMES[i]}", f"{NAME}>{NAMES[i]}") for i in hearers]
    messages += [(f"broadcast/{to}", link, [k, t, u, 0.0, [], [], []]) for to, link in links]
    messages += [(f"telemetry/{NAME}", NAME, [k, report, [], [], 0, [], [], "", []])]
    for to, owner, fields in messages:
        body = msgpack.packb([5, *fields])
        session.put(
            f"{RUN}/{to}", seal(f"{RUN}/{to}", body, owner) + body, congestion_control=BLOCK
        )


auth = {"usrpwd": {"user": NAME, "password": environ["PHALANX_PASSWORD"]}}
hub = {"endpoints": [environ["PHALANX_CONNECT"]]}
config = json.dumps({"mode": "client", "connect": hub, "transport": {"auth": auth}})
arrived: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
handler = zenoh.handlers.Callback(arrived.put, indirect=False)
with zenoh.open(zenoh.Config.from_json5(config)) as joined:
    joined.declare_subscriber(f"{RUN}/sample/{NAME}", handler)
    joined.liveliness().declare_subscriber(f"{RUN}/alive/plant/*", handler, history=True)
    telemetry = joined.declare_publisher(f"{RUN}/telemetry/{NAME}")
    while not (arrived.qsize() and telemetry.matching_status.matching):
        time.sleep(0.01)  # until the plant is there
    token = joined.liveliness().declare_token(f"{RUN}/alive/{NAME}/{environ['PHALANX_DIGEST']}")
    while (message := arrived.get()).kind == zenoh.SampleKind.PUT:
        payload = message.payload.to_bytes()  # of the plant's token none
        if payload[:16] == seal(str(message.key_expr), payload[16:], NAME):
            answer(joined, payload[16:])
