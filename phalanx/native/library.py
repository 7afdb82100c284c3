"""Functions as machine code: CasADi's C of an expression, compiled once and kept in a cache.

Nothing needs it: without a compiler, or before anything was built, CasADi's interpreter computes
the same bits, only slower. Products and sums are compiled as written, with no fused operation, and
for any CPU of the architecture. Each function is compared with the interpreter when it is loaded.
"""

import ctypes
import hashlib
import importlib.util
import logging
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from phalanx.native.files import whole_file
from phalanx.theory.arrays import Array

log = logging.getLogger("phalanx.theory")

Kernel = Callable[..., None]
"""A C function (inputs, outputs, count): one row of inputs after another, to rows of outputs."""

Source = ca.Function | str
"""A library's: a function named f, or C."""
LoadedT = TypeVar("LoadedT")

FOLDER, COMPILER = "PHALANX_CACHE", "PHALANX_CC"
"""Environment variables: the folder of the cache, and the compiler; one that is empty means none.
"""
_OPTIONS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared", "-w")
_PORTABLE_ZIG = ("-mcpu=baseline",)
_ROWS = """
void rows(const double *in, double *out, long long count) {{
  const double *from[{from_}];
  double *to[{to}], w[{w}];
  casadi_int iw[{iw}];
  for (long long r = 0; r < count; ++r) {{
    from[0] = in + r * {inputs};
    to[0] = out + r * {outputs};
    f(from, to, iw, w, 0);
  }}
}}
"""
_COMPARED = 100
"""States at which a function is compared with the interpreter."""


class Native:
    """A function of one column with one column as result, compiled."""

    def __init__(self, library: Path, function: ca.Function) -> None:
        """Load a library. Raises OSError, and ValueError if its results differ."""
        self._library, self._interpreted = library, function
        # It keeps the GIL: a call lasts microseconds, and to give the GIL away takes longer.
        rows = ctypes.PyDLL(str(library)).rows
        rows.restype = None
        self.rows: Kernel = rows
        self._compare()

    @property
    def function(self) -> ca.Function:
        """The same as a CasADi function, for expressions that call it."""
        return ca.external("f", str(self._library))

    def _compare(self) -> None:
        """Raise ValueError unless the bits are the interpreter's; the sign of a NaN is free."""
        states = sample_states(self._interpreted.numel_in(0))
        expected = np.array(self._interpreted(states.T)).T
        results = np.empty(expected.shape)
        self.rows(address(states), address(results), ctypes.c_longlong(len(states)))
        same = (results == expected) & (np.signbit(results) == np.signbit(expected))
        if not (same | (np.isnan(results) & np.isnan(expected))).all():
            raise ValueError(f"{self._library.name} computes other bits")


def address(array: Array) -> Any:
    """Return the place of an array's numbers for a kernel; it keeps the array."""
    assert array.flags.c_contiguous
    if not array.size:
        return None
    # array.ctypes takes three times as long.
    return ctypes.byref(ctypes.c_char.from_buffer(array))  # type: ignore[arg-type]


def native(function: ca.Function) -> Native | None:
    """Return the compiled form of a function named f, if the cache has it; else None."""
    library = _library(function.serialize())
    return None if library is None else _load(library, function, lambda: Native(library, function))


def native_source(source: str, load: Callable[[ctypes.PyDLL], LoadedT]) -> LoadedT | None:
    """Return what `load` makes of a compiled C source, if the cache has it; else None.

    load: raises AttributeError or ValueError if the library is not as it should be.
    """
    library = _library(source)
    return (
        None
        if library is None
        else _load(library, source, lambda: load(ctypes.PyDLL(str(library))))
    )


def _library(text: str) -> Path | None:
    """Return the path of the library that is made of a text; None if there is no cache."""
    folder = _folder()
    if folder is None or not folder.is_dir():
        return None
    return folder / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.so"


def generation() -> int:
    """Return a number that changes when a function that is made again may be made otherwise."""
    return _generation


def _begin_generation() -> None:
    global _generation
    _generation += 1


@contextmanager
def missing() -> Iterator[dict[Path, Source]]:
    """Collect the functions that the block makes and the cache lacks, by their libraries' paths."""
    _begin_generation()
    _missing.append({})
    try:
        yield _missing[-1]
    finally:
        _missing.pop()


def require_compiler() -> None:
    """Make the cache of the compiler's libraries. Raises OSError if there can be none."""
    if _compiler() is None:
        raise OSError("no C compiler: install one as cc, or pip install '.[compiler]'")
    folder = _folder()
    if folder is None:
        raise OSError(f"the cache of compiled functions is not usable: set {FOLDER}")
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def build(functions: Mapping[Path, Source], progress: Callable[[int], None]) -> None:
    """Compile functions into the cache, as many at once as there are processors.

    Args:
        functions: as `missing` collects them.
        progress: called with the number of those compiled.

    Raises OSError: the compiler fails, or the cache cannot be written.
    """
    compiler = _compiler()
    assert compiler is not None
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        # Sources are made here: CasADi is not for several threads.
        sources = {library: _source(function) for library, function in functions.items()}
        tasks = [pool.submit(_compile, compiler, *source) for source in sources.items()]
        for count, task in enumerate(as_completed(tasks), start=1):
            task.result()
            progress(count)
    for library in functions:
        _loaded.pop(library, None)
    _begin_generation()


_generation = 0
_missing: list[dict[Path, Source]] = []
"""The innermost block's is the last."""
_loaded: dict[Path, Any] = {}
"""By path; None where there was none."""


def _load(library: Path, source: Source, load: Callable[[], LoadedT]) -> LoadedT | None:
    """Return the loaded library, None if there is none; then `missing` collects its source."""
    if library not in _loaded:
        _loaded[library] = None
        if library.exists():
            try:
                _loaded[library] = load()
            except (OSError, AttributeError, ValueError) as error:
                log.warning("%s is not used, and the interpreter runs: %s", library, error)
    if _missing and _loaded[library] is None:
        _missing[-1][library] = source
    loaded: LoadedT | None = _loaded[library]
    return loaded


def sample_states(length: int) -> Array:
    """Return numbers of many sizes and both signs, shape (100, length), the same every time."""
    k = np.arange(1, _COMPARED * length + 1)
    even = k * 0.6180339887498949 % 1.0  # multiples of the golden ratio spread evenly
    sizes = 4.0 ** (k * 0.7548776662466927 % 1.0 * 8.0 // 1.0 - 5.0)
    numbers: Array = ((2.0 * even - 1.0) * sizes).reshape(_COMPARED, length)
    return numbers


@cache
def _folder() -> Path | None:
    """Return the folder of the compiler's libraries; None without compiler, or if unsafe."""
    compiler = _compiler()
    chosen = os.environ.get(FOLDER)
    if compiler is None or chosen == "":
        return None
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    root = Path(chosen or os.path.join(home, "phalanx"))
    identity = " ".join((*compiler, *_OPTIONS, _identity(compiler), version("casadi"), _ROWS))
    folder = root / hashlib.sha256(identity.encode()).hexdigest()[:16]
    try:
        status = folder.stat()
    except OSError:
        return folder
    # A library that another user may write would run with our rights.
    if status.st_uid != os.getuid() or status.st_mode & 0o022:
        log.warning("%s is not used: other users may write to it", folder)
        return None
    return folder


@cache
def _compiler() -> tuple[str, ...] | None:
    """Return the command of the compiler, by its full path; None if there is none."""
    chosen = os.environ.get(COMPILER)
    if chosen == "":
        return None
    if path := shutil.which(chosen or "cc"):
        return (path,)
    if chosen is None and importlib.util.find_spec("ziglang"):
        return (sys.executable, "-m", "ziglang", "cc", *_PORTABLE_ZIG)
    return None


def _identity(compiler: tuple[str, ...]) -> str:
    """Return what changes with a compiler's version, without a call of it."""
    if len(compiler) > 1:
        return version("ziglang")
    program = os.path.realpath(compiler[0])
    status = os.stat(program)
    return f"{program} {status.st_size} {status.st_mtime_ns} {platform.machine()}"


def _source(function: Source) -> str:
    if isinstance(function, str):
        return function
    code = ca.CodeGenerator("f", {"with_header": False})
    code.add(function)
    text: str = code.dump()
    scalar = function.is_a("SXFunction")  # it needs no memory of its own
    needed = (
        (1, 1, 1, 1)
        if scalar
        else (function.sz_arg(), function.sz_res(), function.sz_iw(), function.sz_w())
    )
    sizes = dict(zip(("from_", "to", "iw", "w"), (max(1, n) for n in needed), strict=True))
    return text + _ROWS.format(inputs=function.numel_in(0), outputs=function.numel_out(0), **sizes)


def _compile(compiler: tuple[str, ...], library: Path, source: str) -> None:
    """Compile one library. Processes that do so at once each replace it by the same."""
    with whole_file(library) as target:
        file = target.with_name("f.c")
        file.write_text(source)
        process = subprocess.run(
            [*compiler, *_OPTIONS, str(file), "-o", str(target), "-lm"],
            capture_output=True,
            text=True,
            check=False,
        )
        if process.returncode:
            raise OSError(f"{' '.join(compiler)} failed: {process.stderr.strip()[-300:]}")
