"""Follow a live run and print every broadcast, with nothing but zenoh, msgpack and docs/wire.md.

python examples/follow_broadcasts.py tcp/127.0.0.1:7447 --secret s &
phalanx run unicycles --listen tcp/127.0.0.1:7447 --secret s
"""

import argparse
import hashlib
import json
import queue

import msgpack
import zenoh

VERSION = 3


def opened(key: str, payload: bytes, secret: str) -> list | None:
    """The fields of a sealed message, or None if it was not made with the secret for this key."""
    mac_key = hashlib.blake2b(secret.encode(), digest_size=32).digest()
    seal = hashlib.blake2b(key.encode() + payload[16:], key=mac_key, digest_size=16).digest()
    if payload[:16] != seal:
        return None
    fields = msgpack.unpackb(payload[16:])
    return fields if fields[0] == VERSION else None


def main() -> None:
    """Connect, wait for the run, print until its plant is gone."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("endpoint", help="where the plant listens, such as tcp/127.0.0.1:7447")
    parser.add_argument("--run", default="*", help="name of the run; any, if there is one only")
    parser.add_argument("--secret", default="", help="the run's secret")
    options = parser.parse_args()
    retry = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5}
    connect = {"endpoints": [options.endpoint], "timeout_ms": -1, "retry": retry}  # until it is up
    config = {"mode": "client", "connect": connect, "scouting": {"multicast": {"enabled": False}}}
    arrived: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
    handler = zenoh.handlers.Callback(arrived.put, indirect=False)
    run = f"phalanx/{options.run}"
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        session.declare_subscriber(f"{run}/broadcast/*/*", handler)
        session.liveliness().declare_subscriber(f"{run}/alive/plant/*", handler, history=True)
        while (sample := arrived.get()).kind == zenoh.SampleKind.PUT:
            key = str(sample.key_expr)
            _, name, kind, agent, peer = key.split("/")
            if kind == "alive":
                print(f"following run {name}", flush=True)
            elif (fields := opened(key, sample.payload.to_bytes(), options.secret)) is None:
                print(f"{key}: not of this run, or of another version")
            else:
                _, k, t_apply, u = fields
                print(f"agent {agent} to {peer}  k {k}  from {t_apply:.4f} s  u {u}")
    print("the run is over")


if __name__ == "__main__":
    main()
