"""Follow a live run and print its frames, with nothing but zenoh, msgpack and docs/wire.md.

export PHALANX_SECRET=s
python examples/follow_run.py tcp/127.0.0.1:7447 unicycles-1 &
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
    """Return the fields of a frame, or None if its seal is not valid for the key."""
    content, common = key.encode() + payload[16:], key_of("", secret)
    made = payload[:16] == hashlib.blake2b(content, key=common, digest_size=16).digest()
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
        session.declare_subscriber(frames := f"phalanx/{run}/frame/plant", handler)
        plant = f"phalanx/{run}/alive/plant/*"
        session.liveliness().declare_subscriber(plant, handler, history=True)
        while (sample := arrived.get()).kind == zenoh.SampleKind.PUT:
            if str(sample.key_expr) != frames:
                print(f"following run {run}", flush=True)
            elif fields := opened(frames, sample.payload.to_bytes(), secret):
                _, t, _, h_tot, h, *_ = fields
                print(f"t {t:.4f} s  h_tot {h_tot:.4f}  largest h {h:.4f}")
    print("the run is over")


if __name__ == "__main__":
    main()
