"""The examples of docs/network-faults.md work, and it names every field and preset."""

import re
import tomllib
from pathlib import Path

import pytest

from phalanx.network.link import Link
from phalanx.network.presets import PRESETS
from phalanx.network.table import LinkTable
from phalanx.scenario.declared import KINDS
from phalanx.scenario.load import load
from tests.network.pictured_faults import GALLERIES
from tests.unit.network.models import model

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "network-faults.md").read_text(encoding="utf-8")
PICTURED = [fault for gallery in GALLERIES.values() for fault in gallery.faults.values()]


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_its_scenarios_load_and_declare_what_they_show():
    links, agents = (
        load("unicycles", tomllib.loads(text)).links().declared for text in blocks("toml")
    )
    assert "network.loss" in links
    assert links[-1] == "faults.0 (partition)"
    assert agents == ("faults.0 (restart)", "faults.1 (pause)")


def test_its_rule_works(tmp_path, monkeypatch):
    (text,) = blocks("python")
    (tmp_path / "rain_of_the_page.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    rain = {"type": "rain_of_the_page:Rain", "per_metre": 0.01}
    link = Link(0, "a", "b", model(rules=[rain]))
    assert [link.fate(k, distance=100.0).delay for k in range(20)] == [None] * 20
    assert [link.fate(k, distance=0.0).delay for k in range(20)] == [0.0] * 20


ROWS = [f"`{field}" for field in LinkTable.model_fields]
ROWS += [f'`kind = "{kind}"`' for kind in sorted(KINDS)] + [f"| `{name}` |" for name in PRESETS]


@pytest.mark.parametrize("row", ROWS)
def test_every_field_kind_of_fault_and_preset_has_its_row(row):
    assert row in PAGE


@pytest.mark.parametrize("name", GALLERIES)
def test_every_picture_is_on_the_page(name):
    picture = f"images/faults-{name}.png"
    assert f"]({picture})" in PAGE
    assert (DOCS / picture).is_file()


def test_every_field_and_kind_of_fault_is_pictured():
    for field in LinkTable.model_fields:
        assert any(f"network.{field}" in overrides for overrides in PICTURED)
    declared = [fault for overrides in PICTURED for fault in overrides.get("faults", ())]
    assert {fault["kind"] for fault in declared} == set(KINDS)


@pytest.mark.parametrize("name", GALLERIES)
def test_every_scenario_of_a_picture_declares_its_fault(name):
    for fault, overrides in GALLERIES[name].faults.items():
        assert load("faults/lie-input", {"faults": [], **overrides}).links().declared, fault
