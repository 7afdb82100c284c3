"""Link models by name, each with the source of its numbers."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

Preset = Literal["lan", "wifi", "lossy-wifi", "lte", "satellite", "jammed"]


class LinkPreset(NamedTuple):
    """A link model's fields, as in a scenario file, and their source."""

    source: str
    table: Mapping[str, Any]


PRESETS: Mapping[str, LinkPreset] = {
    "lan": LinkPreset(
        "a switched Ethernet: our choice of what a ping shows on one",
        {"delay": {"time": 0.0003, "jitter": 0.0001, "distribution": "normal"}},
    ),
    "wifi": LinkPreset(
        "delay, rate and loss: Comcast's profile WIFI (good); jitter: our choice",
        {
            "delay": {"time": 0.04, "jitter": 0.005, "distribution": "paretonormal"},
            "loss": 0.002,
            "rate": {"bits_per_second": 30e6},
        },
    ),
    "lossy-wifi": LinkPreset(
        "the profile wifi with losses in bursts, as Gilbert has them: our choice of how many",
        {
            "delay": {
                "time": 0.04, "jitter": 0.015, "correlation": 0.25, "distribution": "paretonormal",
            },
            "loss": {"mean": 0.1, "burst": 4.0},
            "duplicate": 0.005,
            "rate": {"bits_per_second": 6e6},
        },
    ),
    "lte": LinkPreset(
        "Loadero's network condition 4G, up link",
        {
            "delay": {"time": 0.045, "jitter": 0.015, "distribution": "normal"},
            "loss": 0.002,
            "rate": {"bits_per_second": 50e6},
        },
    ),
    "satellite": LinkPreset(
        "delay: ITU-T G.114, a geostationary satellite; loss: Comcast's profile Satellite",
        {"delay": {"time": 0.26, "jitter": 0.005, "distribution": "normal"}, "loss": 0.002},
    ),
    "jammed": LinkPreset(
        "delay: Network Link Conditioner's Very Bad Network; losses and damage: our choice",
        {
            "delay": {
                "time": 0.5, "jitter": 0.1, "correlation": 0.5, "distribution": "pareto",
            },
            "loss": {"mean": 0.7, "burst": 25.0},
            "corrupt": 0.05,
        },
    ),
}  # fmt: skip
