"""Functions of many rows: the same bits for any number of states, within bounds of memory."""

import tracemalloc

import casadi as ca
import numpy as np
import pytest

from phalanx.theory.expressions.compiled import MappedFunction


@pytest.mark.slow
def test_many_states_take_no_more_memory_than_a_few_and_give_the_same_bits() -> None:
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    function = MappedFunction([a, b], [ca.sin(a) * b])
    values = np.random.default_rng(1).normal(size=(400, 50))
    places = np.random.default_rng(2).integers(0, 50, size=(5000, 2))
    tracemalloc.start()
    try:
        found = function(values, places)
        held, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held - found.nbytes < 8e6
    assert peak < 3 * found.nbytes
    for state in (0, 25, 26, 399):
        assert np.array_equal(found[state], function(values[state], places))
