"""C pieces of the rows' room, compiled for tests as `phalanx compile` does."""

import ctypes
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

needs_a_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")


def library_of(
    module: ModuleType, folder: Path, replace: tuple[str, str] = ("", "")
) -> ctypes.PyDLL:
    """A module's C source as a library, with one text replaced by another."""
    source = Path(str(module.__file__)).with_suffix(".c").read_text("utf-8")
    assert replace[0] in source
    (folder / "piece.c").write_text(source.replace(*replace) if replace[0] else source)
    options = ["-O2", "-ffp-contract=off", "-fPIC", "-shared", "-lm"]
    subprocess.run(
        ["cc", str(folder / "piece.c"), "-o", str(folder / "piece.so"), *options], check=True
    )
    return ctypes.PyDLL(str(folder / "piece.so"))
