"""Files that are written whole or not at all, and in real folders."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a path to write to; after the block it takes the place of the file or link at `path`.

    If the block raises, what was there remains. Raises OSError.
    """
    if path.exists() and not path.is_file():
        raise FileExistsError(f"{path}: expected a file, found something else")
    with tempfile.TemporaryDirectory(prefix=f"{path.name}.", dir=path.parent) as folder:
        yield (part := Path(folder, path.name))
        part.replace(path)


def real_folder(path: Path) -> Path:
    """Make a folder unless it is there, and return it. Raises OSError, also for a link to one."""
    path.mkdir(exist_ok=True)
    if path.is_symlink():
        raise NotADirectoryError(f"{path}: expected a folder, found a link")
    return path
