"""Functions as machine code: the interpreter's bits, or the interpreter."""

import logging
import shutil
from collections.abc import Iterator
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from phalanx.cli.app import FAILED, status
from phalanx.native import library as module
from phalanx.native.library import COMPILER, FOLDER, build, missing, native
from phalanx.theory.expressions.compiled import CompiledFunction, MappedFunction
from phalanx.theory.models.polytope import polytope
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Row, Rows

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")


def _forget() -> None:
    module._folder.cache_clear()
    module._compiler.cache_clear()
    module._loaded.clear()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The cache, empty."""
    monkeypatch.setenv(COMPILER, "cc")
    monkeypatch.setenv(FOLDER, str(tmp_path / "cache"))
    _forget()
    module.require_compiler()
    yield next((tmp_path / "cache").iterdir())
    _forget()


def _expression(x: ca.SX) -> ca.SX:
    """All operations that C and the interpreter might treat in two ways."""
    a, b, c = ca.vertsplit(x)
    smooth = ca.sin(a) * ca.exp(b) + ca.sqrt(a * a + c) / (b * b + 1.0)
    kinks = ca.fmin(a, b) + ca.fmax(b, c) * ca.sign(c) - ca.fabs(a) + ca.floor(b)
    chosen = ca.if_else(a < b, a * b, ca.copysign(c, a)) + (a <= c) + ca.logic_and(a, b)
    return ca.vertcat(smooth, kinks, chosen, ca.atan2(a, b), a**1.5, 1.0 / c)


def _mapped() -> MappedFunction:
    x = ca.SX.sym("x", 3)
    return MappedFunction([x], [_expression(x)])


def _built() -> MappedFunction:
    with missing() as functions:
        native(_mapped()._function)
    build(functions, lambda _: None)
    return _mapped()


@pytest.mark.slow
def test_machine_code_computes_the_bits_of_the_interpreter(folder, rng):
    values = rng.normal(scale=10.0, size=900)
    values[:9] = 0.0, -0.0, np.inf, -np.inf, np.nan, 1e-310, 1e300, 1.0, -1.0
    rows = np.arange(900).reshape(300, 3)
    expected = _mapped()(values, rows)
    compiled = _built()
    assert native(compiled._function) is not None
    numbers = compiled(values, rows)
    assert np.array_equal(numbers, expected, equal_nan=True)
    defined = ~np.isnan(expected)
    assert np.array_equal(np.signbit(numbers)[defined], np.signbit(expected)[defined])


@pytest.mark.slow
def test_a_function_of_several_inputs_is_compiled_too(folder):
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    with missing() as functions:
        interpreted = CompiledFunction([x, y], [x * y, ca.sin(y)])
        interpreted.__call__(np.ones(2), 3.0)
    assert len(functions) == 1
    build(functions, lambda _: None)
    compiled = CompiledFunction([x, y], [x * y, ca.sin(y)])
    for one, other in zip(
        compiled(np.array([1.5, -2.0]), 0.3), interpreted(np.array([1.5, -2.0]), 0.3), strict=True
    ):
        assert np.array_equal(one, other)


@pytest.mark.slow
def test_the_minimiser_is_compiled_too(folder):
    square = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))
    row, rows = Row(np.ones(2), -0.5), Rows(np.eye(2), np.zeros(2))
    lost = Rows(np.eye(2), np.array([-2.0, -1.0]))
    with missing() as sources:
        interpreted = NearestInput((1.0, 4.0))
    assert len(sources) == 3
    build(sources, lambda _: None)
    compiled = NearestInput((1.0, 4.0))
    parts = compiled._exact, compiled._in_box, compiled._least_vertex
    assert all(part._compiled is not None for part in parts)
    answers = [
        (qp.solve(np.array([3.0, 0.5]), square, row), qp.solve(np.array([3.0, 0.5]), square, rows))
        for qp in (interpreted, compiled)
    ]
    assert np.array_equal(*answers)
    assert compiled.least_violation(square, lost).tolist() == [-1.0, -1.0]


@pytest.mark.slow
def test_a_library_with_other_bits_is_refused_and_the_interpreter_runs(folder, caplog):
    x = ca.SX.sym("x", 3)
    with missing() as functions:
        _built()
        MappedFunction([x], [_expression(x) * (1.0 + 2.0**-52)])(np.zeros(3), np.arange(3)[None])
    (other,) = functions
    (ours,) = folder.glob("*.so")
    shutil.copy(ours, other)
    module._loaded.clear()
    with caplog.at_level(logging.WARNING):
        again = MappedFunction([x], [_expression(x) * (1.0 + 2.0**-52)])
        again(np.zeros(3), np.arange(3)[None])
    assert "the interpreter runs" in caplog.text
    assert native(again._function) is None


@pytest.mark.slow
def test_a_damaged_library_is_refused(folder, caplog):
    _built()
    (library,) = folder.glob("*.so")
    library.write_bytes(library.read_bytes()[:100])
    module._loaded.clear()
    with caplog.at_level(logging.WARNING):
        assert native(_mapped()._function) is None
    assert str(library) in caplog.text


def test_a_folder_that_others_may_write_to_is_not_used(folder, caplog):
    folder.chmod(0o777)
    _forget()
    with caplog.at_level(logging.WARNING):
        assert native(_mapped()._function) is None
    assert "other users may write to it" in caplog.text


@pytest.mark.slow
def test_without_a_compiler_nothing_is_looked_up(folder, monkeypatch, capsys):
    _built()
    monkeypatch.setenv(COMPILER, "")
    _forget()
    assert native(_mapped()._function) is None
    assert status(["compile", "unicycles"]) == FAILED
    assert "no C compiler" in capsys.readouterr().err


@pytest.mark.slow
def test_a_compiler_that_fails_is_quoted(folder):
    function = ca.Function("f", [ca.SX.sym("x")], [ca.SX(1.0)])
    with pytest.raises(OSError, match="no-such-option"):
        module._compile(("cc", "--no-such-option"), folder / "f.so", module._source(function))
    assert not list(folder.iterdir())
