"""Put malformed messages under a valid seal to every receiver of a run.

python evidence/attacks/fuzz_messages.py 300000 [SEED]

Each receiver takes a message, or drops and counts it. Anything else is printed and is a fault.
"""

import random
import sys
import time
from collections import Counter

from phalanx_plant.hub.hub import Joining

from phalanx.swarm.swarm import build_swarm
from tests.hostile.messages import SCENARIO, put, receivers, spoilt, spoilt_token


def main() -> None:
    """Put messages until the number is reached; exit with 1 if anything else than a drop came."""
    number, seed = int(sys.argv[1]), int((*sys.argv, "0")[2])
    draw, everybody, outcomes = random.Random(seed), receivers(), Counter[str]()
    faults, slowest, swarm = 0, 0.0, build_swarm(SCENARIO)
    for n in range(number):
        receiver = everybody[n % len(everybody)]
        payload, began = spoilt(receiver, n, draw), time.monotonic()
        try:
            outcomes[put(receiver, payload)] += 1
            if n % 50 == 0:
                Joining(swarm, may_leave=False).on_token(spoilt_token(draw), True)
        except Exception as error:
            faults += 1
            print(f"{receiver.key}: {type(error).__name__}: {error} ({payload[16:200]!r})")
        slowest = max(slowest, time.monotonic() - began)
    print(f"{number} messages, seed {seed}: {faults} faults, the slowest took {slowest:.3f} s")
    print(", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common()))
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
