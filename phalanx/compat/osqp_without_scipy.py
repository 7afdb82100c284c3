"""Load OSQP's compiled part alone.

The Python package around it (osqp 1.1) imports SciPy and a template engine when it is imported.
That takes longer than all else that a program of a run loads, and a third of what each fork of one
costs. The compiled part asks SciPy one thing, whether a matrix is sparse, and ignores the answer.

Upstream has no issue yet. It would say: "`import osqp` should import scipy.sparse and jinja2 where
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
    """The extension module. Raises ImportError."""
    if _NAME not in sys.modules:
        package = importlib.util.find_spec("osqp")
        where = package.submodule_search_locations if package else None
        spec = importlib.machinery.PathFinder.find_spec(_NAME, where)
        if spec is None or spec.loader is None:
            return importlib.import_module(_NAME)
        # A later import of all of OSQP takes this module: it cannot be loaded twice.
        sys.modules[_NAME] = module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return sys.modules[_NAME]


@contextlib.contextmanager
def without_scipy() -> Iterator[None]:
    """Show the compiled part a stand-in for SciPy, where SciPy is not loaded."""
    asked: Any = types.SimpleNamespace(isspmatrix_csc=lambda _: True)
    with _one_at_a_time:
        for name in _SCIPY:
            sys.modules.setdefault(name, asked)
        try:
            yield
        finally:
            for name in _SCIPY:
                if sys.modules.get(name) is asked:
                    del sys.modules[name]
