"""Bugs that are kept by hand, and mutants that no test can notice, fit the code as it is."""

from tests.hostile.drawn_mutants import equivalents
from tests.hostile.mutants import MUTANTS, ROOT, broken


def test_each_bug_by_hand_can_be_put_in_and_its_tests_are_there():
    for mutant in MUTANTS:
        assert broken(mutant)
        assert all((ROOT / path).exists() for path in mutant.tests.split(" -k ")[0].split())


def test_each_line_whose_mutant_is_excused_stands_in_its_file():
    for entry in equivalents():
        lines = (ROOT / entry["file"]).read_text("utf-8").splitlines()
        assert entry["line"] in [line.strip() for line in lines]
