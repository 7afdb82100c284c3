"""Cases of one test in two layers: a few in `make test`, the others at night."""

from collections.abc import Container, Iterable

import pytest


def layered(cases: Iterable[object], in_test: Container[object]) -> list[object]:
    """Return all cases as parameters; those that are not in_test are left to `make nightly`."""
    return [pytest.param(c, marks=() if c in in_test else pytest.mark.nightly) for c in cases]
