"""Pictures of the pages are of the present program, or known as older."""

import json
import runpy
import shutil
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PICTURES = runpy.run_path(str(ROOT / ".ci" / "pictures.py"))
RECORDS = PICTURES["records"]()
NAMES = sorted(RECORDS)


def test_every_picture_is_one_makers_and_has_a_record():
    files = {file.name for file in (ROOT / PICTURES["IMAGES"]).iterdir()}
    assert files - PICTURES["BY_HAND"] == set(NAMES)
    for picture in files - PICTURES["BY_HAND"]:
        assert PICTURES["maker_of"](picture)


@pytest.mark.parametrize("picture", NAMES)
def test_the_present_sources_made_a_picture(picture: str):
    record, maker = RECORDS[picture], PICTURES["maker_of"](picture)
    anew = f"stale: python {maker.command}, then python .ci/pictures.py {picture}"
    if record is None:
        pytest.xfail(anew)
    assert record["sources"] == PICTURES["digest"](maker), f"{anew}; or null as its record"
    assert set(record["h_tot"]) == set(maker.scenarios)


@pytest.mark.nightly
@pytest.mark.slow
def test_pictures_show_the_present_runs():
    h_tot = cache(PICTURES["h_tot"])
    made = {picture: record["h_tot"] for picture, record in RECORDS.items() if record}
    assert {picture: {name: h_tot(name) for name in each} for picture, each in made.items()} == made
    assert h_tot("unicycles") == pytest.approx(-15.69, abs=0.01)


def test_a_changed_source_and_an_unknown_one_make_a_picture_stale(tmp_path: Path):
    of = PICTURES["maker_of"]
    pair = ("unicycles.png", "formation3d.png")
    for maker in map(of, pair):
        for pattern in (*maker.sources, *(f"scenarios/{name}.toml" for name in maker.scenarios)):
            for file in ROOT.glob(pattern):
                copy = tmp_path / file.relative_to(ROOT)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(file, copy)
    digests = {name: {"sources": PICTURES["digest"](of(name))} for name in pair}
    (tmp_path / PICTURES["RECORDS"]).write_text(json.dumps(digests))
    assert list(PICTURES["stale"](tmp_path)) == []
    with (tmp_path / "scenarios/unicycles.toml").open("a") as file:
        file.write("# faster\n")
    assert list(PICTURES["stale"](tmp_path)) == ["unicycles.png"]
    digests["formation3d.png"] = None
    (tmp_path / PICTURES["RECORDS"]).write_text(json.dumps(digests))
    assert list(PICTURES["stale"](tmp_path)) == list(digests)
