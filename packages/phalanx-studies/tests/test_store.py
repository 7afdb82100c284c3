"""The folder of a study keeps every finished row, whatever ends the program that writes it."""

import resource

import polars as pl
import pytest
from phalanx_studies.plan import plan_from
from phalanx_studies.row import Identity, Row, versions
from phalanx_studies.store import ROWS, Store, StudyError

import phalanx

PLAN = plan_from({"scenario": "unicycles"})


def row(seed: int, **fields: object) -> Row:
    """Return a row as a run with this seed would give."""
    values = {"outcome": "safe", "reason": "", "overrides": {"network.loss": 0.1}, **fields}
    return Row(identity=Identity("digest", seed, "", "1"), worst_h=-float(seed), **values)  # type: ignore[arg-type]


def seeds_in(folder: object) -> list[int]:
    """Return the seeds of the stored rows, as another program reads them."""
    return Store(folder).frame()["seed"].to_list()  # type: ignore[arg-type]


def test_a_row_is_there_as_soon_as_it_is_added(tmp_path):
    store = Store(tmp_path).open(PLAN)
    for seed in range(3):
        store.add(row(seed))
    assert seeds_in(tmp_path) == [0, 1, 2]
    assert not (tmp_path / ROWS).exists()


def test_at_the_end_there_is_one_file(tmp_path):
    with Store(tmp_path).open(PLAN) as store:
        for seed in range(2500):
            store.add(row(seed))
    assert list(tmp_path.glob("*.parquet")) == [tmp_path / ROWS]
    assert seeds_in(tmp_path) == list(range(2500))


def test_a_line_that_was_torn_is_dropped_and_written_over(tmp_path):
    with Store(tmp_path / "before").open(PLAN) as store:
        store.add(row(0))
        store.add(row(1))
        torn = (tmp_path / "before" / "rows.journal").read_bytes()[:-20]
    folder = tmp_path / "after"
    folder.mkdir()
    (folder / "rows.journal").write_bytes(torn)
    with Store(folder).open(PLAN) as again:
        assert seeds_in(folder) == [0]
        again.add(row(2))
    assert seeds_in(folder) == [0, 2]


def test_a_crash_between_the_file_and_the_journal_doubles_no_row(tmp_path):
    with Store(tmp_path).open(PLAN) as store:
        for seed in range(5):
            store.add(row(seed))
        journal = (tmp_path / "rows.journal").read_bytes()
    (tmp_path / "rows.journal").write_bytes(journal)
    assert seeds_in(tmp_path) == [0, 1, 2, 3, 4]


def test_a_row_that_is_added_again_replaces_the_first(tmp_path):
    with Store(tmp_path).open(PLAN) as store:
        store.add(row(0))
        store.add(row(0, platform="another"))
    assert Store(tmp_path).frame()["platform"].to_list() == ["another"]


def test_two_programs_do_not_write_into_one_folder(tmp_path):
    with (
        Store(tmp_path).open(PLAN),
        pytest.raises(StudyError, match="another program is running this study"),
    ):
        Store(tmp_path).open(PLAN)
    Store(tmp_path).open(PLAN).close()


def test_rows_of_another_version_are_refused_and_left_as_they_are(tmp_path):
    old = pl.DataFrame({"key": ["a"], "height": [1.0]})
    old.write_parquet(tmp_path / ROWS)
    before = (tmp_path / ROWS).read_bytes()
    with pytest.raises(StudyError, match="another version of Phalanx"):
        Store(tmp_path).frame()
    assert (tmp_path / ROWS).read_bytes() == before


def test_a_journal_of_another_version_is_refused_and_one_that_is_damaged(tmp_path):
    journal = tmp_path / "rows.journal"
    journal.write_bytes(b'{"key": "a", "height": 1.0}\n')
    with pytest.raises(StudyError, match="another version of Phalanx"):
        Store(tmp_path).open(PLAN)
    journal.write_bytes(b'{"key": \n')
    with pytest.raises(StudyError, match="damaged"):
        Store(tmp_path).frame()


def test_a_file_that_holds_no_rows_is_refused(tmp_path):
    (tmp_path / ROWS).write_bytes(b"no parquet")
    with pytest.raises(StudyError, match="not the rows of a study"):
        Store(tmp_path).frame()


def test_a_full_disk_loses_no_finished_row(tmp_path):
    store = Store(tmp_path).open(PLAN)
    store.add(row(0))
    size = (tmp_path / "rows.journal").stat().st_size
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 100, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            store.add(row(1))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert seeds_in(tmp_path) == [0]
    store.add(row(2))
    store.close()
    assert seeds_in(tmp_path) == [0, 2]


def test_every_field_that_a_row_sets_is_a_column_of_the_file(tmp_path):
    tables = [
        {"network.loss": 0.1, "safety.margin": "paper", "faults": [{"kind": "kill"}]},
        {"network.loss": 0.5, "agents.1.start": [1.0, 2.0]},
    ]
    with Store(tmp_path).open(PLAN) as store:
        for seed, overrides in enumerate(tables):
            store.add(row(seed, overrides=overrides, faults="faults.0 (kill)"))
    rows = pl.read_parquet(tmp_path / ROWS)
    assert rows["network.loss"].to_list() == [0.1, 0.5]
    assert rows["safety.margin"].to_list() == ["paper", None]
    assert rows["agents.1.start"].to_list() == [None, "[1.0, 2.0]"]
    assert rows["faults_set"].to_list() == ['[{"kind": "kill"}]', None]
    assert rows["faults"].to_list() == 2 * ["faults.0 (kill)"]
    assert Store(tmp_path).frame().columns == rows.columns[:-4]
    with Store(tmp_path).open(PLAN) as store:
        store.add(row(2, overrides={}))
    assert pl.read_parquet(tmp_path / ROWS)["network.loss"].to_list() == [0.1, 0.5, None]


def test_rows_without_such_columns_are_read_and_get_them(tmp_path):
    with Store(tmp_path).open(PLAN) as store:
        store.add(row(0))
    Store(tmp_path).frame().write_parquet(tmp_path / ROWS)
    with Store(tmp_path).open(PLAN):
        assert seeds_in(tmp_path) == [0]
    assert pl.read_parquet(tmp_path / ROWS)["network.loss"].to_list() == [0.1]
    odd = pl.read_parquet(tmp_path / ROWS).with_columns(height=1.0)
    odd.write_parquet(tmp_path / ROWS)
    with pytest.raises(StudyError, match="another version of Phalanx"):
        Store(tmp_path).frame()


@pytest.mark.parametrize("name", ["piece.c", "room/piece.py"])
def test_rows_of_other_sources_are_other_rows(tmp_path, monkeypatch, name):
    monkeypatch.setattr(phalanx, "__path__", [str(tmp_path)])
    (file := tmp_path / name).parent.mkdir(exist_ok=True)
    digests = set()
    for text in ("a", "b", "a"):
        file.write_text(text)
        digests.add(versions.__wrapped__())
    assert len(digests) == 2
