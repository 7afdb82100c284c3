"""Load OSQP's compiled part alone.

The Python package around it (osqp 1.1) imports SciPy and a template engine. That takes longer than
all other imports of a program of a run, and a third of the time of each fork. The compiled part
calls SciPy once, to test whether a matrix is sparse, and ignores the result.

Upstream has no issue yet. Its text: "`import osqp` should import scipy.sparse and jinja2 where
they are used; `ext_builtin.CSC` should test for `indptr` and `indices` instead of SciPy's type."
"""

import contextlib
import importlib
import importlib.machinery
import importlib.util
import sys
import threading
import types
from collections.abc import Iterator
from typing import Any

_NAME = "osqp.ext_builtin"
_SCIPY = "scipy", "scipy.sparse"
_one_at_a_time = threading.Lock()


def compiled_part() -> Any:
    """Return the extension module. Raises ImportError."""
    if _NAME not in sys.modules:
        package = importlib.util.find_spec("osqp")
        where = package.submodule_search_locations if package else None
        spec = importlib.machinery.PathFinder.find_spec(_NAME, where)
        if spec is None or spec.loader is None:
            return importlib.import_module(_NAME)
        # A later import of all of OSQP must use this module: it cannot be loaded twice.
        sys.modules[_NAME] = module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return sys.modules[_NAME]


@contextlib.contextmanager
def without_scipy() -> Iterator[None]:
    """Replace SciPy by a stub for the compiled part, unless SciPy is loaded."""
    stub: Any = types.SimpleNamespace(isspmatrix_csc=lambda _: True)
    with _one_at_a_time:
        for name in _SCIPY:
            sys.modules.setdefault(name, stub)
        try:
            yield
        finally:
            for name in _SCIPY:
                if sys.modules.get(name) is stub:
                    del sys.modules[name]
