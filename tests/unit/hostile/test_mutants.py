"""The safeguards that are broken on purpose: each is still where it is looked for."""

import ast

import pytest

from tests.hostile.mutants import MUTANTS, ROOT, Mutant, broken


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.what)
def test_every_breakage_still_applies(mutant: Mutant):
    ast.parse(broken(mutant))
    assert (ROOT / mutant.tests.split()[0]).exists()


def test_no_two_breakages_are_called_the_same():
    assert len({mutant.what for mutant in MUTANTS}) == len(MUTANTS)
