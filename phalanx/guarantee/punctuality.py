"""How a run in real time kept its times: what was missed, what was late, and by how much."""

from collections.abc import Sequence

import msgspec
import numpy as np


class Percentiles(msgspec.Struct):
    """Of a time that was measured again and again, all in seconds."""

    name: str
    count: int
    p50: float
    p99: float
    most: float


class Punctuality(msgspec.Struct):
    """Of one run in real time."""

    samples: int
    """Handed out."""
    missed: int
    """Ticks of an agent's clock at which it still owed the answer to its sample before."""
    unanswered: int
    """Samples that were given up: no answer came."""
    late: int
    """Inputs that came to their actuator after they were due."""
    measured: list[Percentiles]


def in_words(found: Punctuality) -> list[tuple[str, str]]:
    """Each figure with its name."""
    return [
        ("samples missed", f"{found.missed} beside {found.samples} taken"),
        ("samples unanswered", str(found.unanswered)),
        ("inputs late", str(found.late)),
        *(
            (m.name, " ms, ".join(
                f"{name} {1e3 * value:.2f}"
                for name, value in (("p50", m.p50), ("p99", m.p99), ("max", m.most))
            ) + " ms")
            for m in found.measured
        ),
    ]  # fmt: skip


def percentiles(name: str, seconds: Sequence[float]) -> Percentiles:
    """What a list of times comes to; zeros if it is empty."""
    found = np.percentile(seconds, [50, 99, 100]).tolist() if len(seconds) else [0.0] * 3
    return Percentiles(name, len(seconds), *found)
