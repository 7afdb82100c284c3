"""One recording with loss, delay and hostile texts, and its report, for all of these tests."""

from pathlib import Path

import pytest

from phalanx.recording.read import Recording, read
from phalanx.recording.records import Log
from phalanx.report.write import write_report
from phalanx.scenario.model import Scenario
from tests.unit.report.recordings import HOSTILE, drift, record, summary_of, unicycles


@pytest.fixture(scope="session")
def faulty() -> Scenario:
    return unicycles("network.loss=0.3", "network.delay={low=0.002, high=0.02}")


@pytest.fixture(scope="session")
def folder(faulty: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole recording whose every text is hostile."""
    scenario = faulty.model_copy(update={"description": HOSTILE})
    records = [*drift(scenario), Log(0.1, HOSTILE)]
    run = tmp_path_factory.mktemp("run")
    return record(run, scenario, records, summary_of(scenario, HOSTILE))


@pytest.fixture(scope="session")
def reported(folder: Path) -> Path:
    """Its report."""
    return write_report(folder)


@pytest.fixture(scope="session")
def recording(folder: Path) -> Recording:
    return read(folder)
