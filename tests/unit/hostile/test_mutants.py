"""The safeguards that are broken on purpose: each is still where it is looked for."""

import ast

import pytest

from tests.hostile.drawn_mutants import drawn, equivalents
from tests.hostile.mutants import MUTANTS, ROOT, Mutant, broken
from tests.hostile.rooms import ROOMS


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.what)
def test_every_breakage_still_applies(mutant: Mutant):
    ast.parse(broken(mutant))
    assert (ROOT / mutant.tests.split()[0]).exists()


def test_no_two_breakages_are_called_the_same():
    assert len({mutant.what for mutant in MUTANTS}) == len(MUTANTS)


def test_every_equivalent_mutant_is_of_a_line_that_exists():
    for mutant in equivalents():
        lines = [line.strip() for line in (ROOT / mutant["file"]).read_text("utf-8").splitlines()]
        assert set(mutant["line"].split("\n")) <= set(lines), mutant
        assert mutant["becomes"] != mutant["line"], mutant
        assert mutant["why"], mutant


@pytest.mark.parametrize("name", ROOMS)
def test_a_room_has_files_that_can_be_changed_and_tests(name: str):
    for pattern in ROOMS[name].sources:
        assert list(ROOT.glob(pattern)), pattern
    assert all((ROOT / path).exists() for path in ROOMS[name].tests.split())


def test_a_drawn_change_is_the_same_each_time_and_can_be_compiled():
    changes, again = (drawn("inbox", ROOMS["inbox"], 5) for _ in range(2))
    assert changes == again
    for change in changes:
        assert change.text() != (ROOT / change.file).read_text("utf-8")
        ast.parse(change.text())
