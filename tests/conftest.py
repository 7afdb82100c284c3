"""One hypothesis profile for all tests: the same examples every time, on any machine."""

import gc

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "seeded",
    derandomize=True,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("seeded")


def pytest_collection_finish() -> None:
    """What is imported and collected lives to the end: a collector need not look at it again."""
    gc.freeze()


@pytest.fixture
def rng() -> np.random.Generator:
    """The same numbers every time."""
    return np.random.default_rng(20)
