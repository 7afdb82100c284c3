"""The run that every attack is measured against."""

import pytest

from phalanx.guarantee.verdict import Summary
from phalanx.launcher.engine import RunOptions, execute
from tests.process.hostile.attacks import SCENARIO


@pytest.fixture(scope="session")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Summary:
    """The run without an attack."""
    folder = tmp_path_factory.mktemp("calm") / "run"
    folder.mkdir()
    return execute(SCENARIO, folder, RunOptions("in-process"))
