"""Made-up studies whose truth is known: frames, and draws of many at once."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from scipy.stats import binom

from phalanx.recording.metrics.table import METRICS

TEXTS = "reason", "worst_pair", "faults", "key", "trajectory"
NUMBERS = "worst_h", "worst_at", "certified", "shortest", "wall_time"


def frame(rows: Sequence[Mapping[str, Any]]) -> pl.DataFrame:
    """A study's frame of rows that say only what matters."""
    numbers = dict.fromkeys((*NUMBERS, *METRICS))
    default = {"seed": 0, "outcome": "safe", "searched": False, "empty": None, **numbers}
    default |= dict.fromkeys(TEXTS, "")
    whole = [{"index": i, **default, **row} for i, row in enumerate(rows)]
    schema = {"arrived": pl.Boolean, "empty": pl.Int64}
    schema |= {name: pl.Float64 for name in numbers if name != "arrived"}
    return pl.DataFrame(whole, schema_overrides=schema, infer_schema_length=None)


def study(seeds: int = 100) -> pl.DataFrame:
    """Seeds over two axes: loss makes unsafe, and so does the model `split`, at less cost."""
    rows = []
    for point, (loss, model) in enumerate(
        (loss, model) for loss in (0.0, 0.1, 0.3, 0.5) for model in ("paper", "split")
    ):
        for seed in range(seeds):
            luck, noise = np.random.default_rng([point, seed]).random(2)
            h = -1.2 + 2.0 * loss * luck + (0.4 if model == "split" else 0.0) + 0.3 * noise
            violated, sure = h > 0.0, loss < 0.2 and luck < 0.9
            outcome = "violated" if violated else "guaranteed" if sure else "safe"
            rows.append(
                {
                    "network.loss": loss, "safety.information": model, "seed": seed,
                    "outcome": outcome, "worst_h": h, "worst_at": 3.0 * luck,
                    "worst_pair": "agent-1, pursuer", "certified": 1.0 - loss * luck,
                    "shortest": 1.4 - loss, "empty": int(20 * loss * luck),
                    "input_deviation_mean": (2.0 if model == "paper" else 1.0) + loss + noise,
                    "tracking_error_mean": 0.2 + loss * noise, "reason": "h above zero at 3 s",
                }
            )  # fmt: skip
    return frame(rows)


STUDIES = 1000
"""Number of studies of which an interval's misses are counted."""


def draws(*shape: int, seed: int = 0) -> np.ndarray:
    """Uniform draws for all studies, shape (STUDIES, *shape)."""
    return np.random.default_rng(seed).random((STUDIES, *shape))


def most_misses(level: float = 0.95) -> int:
    """The number of misses that an interval that covers so often exceeds once in 10 000 times."""
    return int(binom.ppf(1.0 - 1e-4, STUDIES, 1.0 - level))


def misses(interval, truth: float) -> np.ndarray:
    """True where an interval does not hold the truth."""
    low, high = interval
    return (np.asarray(low) > truth) | (np.asarray(high) < truth)
