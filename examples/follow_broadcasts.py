"""Follow a live run and print every broadcast, with nothing but zenoh, msgpack and docs/wire.md.

export PHALANX_SECRET=s
python examples/follow_broadcasts.py tcp/127.0.0.1:7447 unicycles-1 &
phalanx run unicycles --listen tcp/127.0.0.1:7447
"""

import hashlib
import json
import os
import queue
import sys

import msgpack
import zenoh

VERSION = 5


def key_of(name: str, secret: str) -> bytes:
    root = hashlib.blake2b(secret.encode(), digest_size=32).digest()
    return hashlib.blake2b(name.encode(), key=root, digest_size=32).digest()


def opened(key: str, payload: bytes, secret: str) -> list | None:
    """Return the fields of a broadcast, or None if its seal is not valid for the key."""
    content, own = key.encode() + payload[16:], key_of(">".join(key.split("/")[3:]), secret)
    made = payload[:16] == hashlib.blake2b(content, key=own, digest_size=16).digest()
    fields = msgpack.unpackb(payload[16:]) if made else [None]
    return fields if fields[0] == VERSION else None


def main() -> None:
    """Connect, wait for the run, print until its plant is gone."""
    (endpoint, run), secret = sys.argv[1:], os.environ["PHALANX_SECRET"]
    retry = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5}
    connect = {"endpoints": [endpoint], "timeout_ms": -1, "retry": retry}  # until it is up
    viewer = hashlib.blake2b(b"password", key=key_of("viewer", secret), digest_size=16)
    login = {"auth": {"usrpwd": {"user": "viewer", "password": viewer.hexdigest()}}}
    config = {"mode": "client", "connect": connect, "transport": login}
    arrived: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
    handler = zenoh.handlers.Callback(arrived.put, indirect=False)
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        session.declare_subscriber(f"phalanx/{run}/copy/broadcast/*/*", handler)
        plant = f"phalanx/{run}/alive/plant/*"
        session.liveliness().declare_subscriber(plant, handler, history=True)
        while (sample := arrived.get()).kind == zenoh.SampleKind.PUT:
            key = str(sample.key_expr).replace("/copy/", "/", 1)
            _, _, kind, agent, peer = key.split("/")
            if kind == "alive":
                print(f"following run {run}", flush=True)
            elif fields := opened(key, sample.payload.to_bytes(), secret):
                _, k, t_apply, u, *_ = fields
                print(f"agent {agent} to {peer}  k {k}  from {t_apply:.4f} s  u {u}")
    print("the run is over")


if __name__ == "__main__":
    main()
