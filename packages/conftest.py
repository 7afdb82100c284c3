"""The same for tests of packages as for those of the product."""

from tests.conftest import _own_signals, rng  # noqa: F401 - fixtures
