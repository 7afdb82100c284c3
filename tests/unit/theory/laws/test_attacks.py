"""Attacks: a script of inputs, each from its instant on."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.laws.attacks import Script
from phalanx.theory.laws.law import View
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle

gaps = st.lists(st.floats(1e-3, 10.0), max_size=6)


def at(t: float) -> View:
    """A view at a time: a script looks at nothing else."""
    return cast(View, cast(Any, SimpleNamespace(t=t)))


@given(gaps=gaps, t=st.floats(0.0, 60.0))
def test_the_last_input_that_has_begun_is_in_force(gaps, t):
    instants = tuple(np.cumsum([0.0, *gaps]).tolist())
    script = Script(instants, tuple((float(k), 0.0) for k in range(len(instants))))
    script.prepare(SingleIntegrator(10.0))
    begun = [k for k, instant in enumerate(instants) if instant <= t]
    assert script.input(at(t)).tolist() == [float(begun[-1]), 0.0]


def test_an_input_begins_at_its_instant():
    script = Script((0.0, 0.5), ((2.0, 1.0), (-2.0, 0.0)))
    script.prepare(Unicycle(2.0, 1.0))
    assert script.input(at(0.49)).tolist() == [2.0, 1.0]
    assert script.input(at(0.5)).tolist() == [-2.0, 0.0]


@pytest.mark.parametrize(
    ("instants", "inputs", "message"),
    [
        ((0.0, 1.0), ((0.0, 0.0),), "an input for each instant of at: 2, got 1"),
        ((0.5,), ((0.0, 0.0),), "expected at to begin with 0, got 0.5"),
        ((0.0, 1.0, 1.0), ((0.0, 0.0),) * 3, "expected at to ascend, got 1 after 1"),
        ((0.0,), ((2.0, 1.5),), r"inputs.0: .*nu, omega.* within U, \[-2, 2\] x \[-1, 1\], got"),
        ((0.0,), ((2.0,),), r"inputs.0: expected 2 numbers \(nu, omega\), got 1"),
    ],
)
def test_a_mistake_is_refused_with_its_place(instants, inputs, message):
    with pytest.raises(ValueError, match=message):
        Script(instants, inputs).prepare(Unicycle(2.0, 1.0))
