"""A run's tables, exported and read back."""

import numpy as np
import polars as pl
import pytest
from phalanx_viewer.export.write import run

import phalanx


@pytest.mark.parametrize(
    ("kind", "read"), [("parquet", pl.read_parquet), ("csv", pl.read_csv)], ids=["parquet", "csv"]
)
def test_tables_are_read_back_as_they_were(tmp_path, kind, read):
    scenario = phalanx.load("surrounded", ["duration=0.2"])
    finished = phalanx.run(scenario, engine="in-process", out=tmp_path / "runs")
    written = run(finished.recording, **{kind: tmp_path / "tables"})
    names = {"states", "h", "inputs", "links", "events", "metrics"}
    assert {path.stem for path in written} == names
    states = read(tmp_path / "tables" / f"states.{kind}")
    assert np.array_equal(states.to_numpy(), finished.states.to_numpy())
