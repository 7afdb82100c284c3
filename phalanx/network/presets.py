"""Link models by name: fields of [network]. docs/network-faults.md says where they are from."""

from collections.abc import Mapping
from typing import Any, Literal

Preset = Literal["lan", "wifi", "lossy-wifi", "lte", "satellite", "jammed"]

PRESETS: Mapping[str, Mapping[str, Any]] = {
    "lan": {"delay": {"time": 0.0003, "jitter": 0.0001, "distribution": "normal"}},
    "wifi": {
        "delay": {"time": 0.04, "jitter": 0.005, "distribution": "paretonormal"},
        "loss": 0.002,
        "rate": {"bits_per_second": 30e6},
    },
    "lossy-wifi": {
        "delay": {
            "time": 0.04, "jitter": 0.015, "correlation": 0.25, "distribution": "paretonormal",
        },
        "loss": {"mean": 0.1, "burst": 4.0},
        "duplicate": 0.005,
        "rate": {"bits_per_second": 6e6},
    },
    "lte": {
        "delay": {"time": 0.045, "jitter": 0.015, "distribution": "normal"},
        "loss": 0.002,
        "rate": {"bits_per_second": 50e6},
    },
    "satellite": {
        "delay": {"time": 0.26, "jitter": 0.005, "distribution": "normal"},
        "loss": 0.002,
    },
    "jammed": {
        "delay": {"time": 0.5, "jitter": 0.1, "correlation": 0.5, "distribution": "pareto"},
        "loss": {"mean": 0.7, "burst": 25.0},
        "corrupt": 0.05,
    },
}  # fmt: skip
