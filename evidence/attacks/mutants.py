"""Break safeguards on purpose, one at a time, and see which layer of tests notices first.

    python evidence/attacks/mutants.py [WORD]

In a copy of the sources. One line for each: `quick`, `test` or `SURVIVED`. Exits with 1 if one
was not noticed.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.hostile.mutants import MUTANTS, ROOT, Mutant, broken

COPIED = (
    *("phalanx", "agent", "plant", "viewer", "packages"),
    *("tests", "scenarios", "docs", "examples"),
)
LAYERS = {"quick": "not slow and not nightly and not swarm", "test": "not nightly"}
"""What each selects, as in the Makefile; the first is the fastest."""
SURVIVED = "SURVIVED"
_PASSED, _FAILED, _NONE_SELECTED = 0, 1, 5
"""Exit statuses of pytest."""


def first_to_notice(mutant: Mutant) -> str:
    """Return the first layer of which a test fails in a copy with the safeguard broken."""
    with tempfile.TemporaryDirectory() as parent:
        copy = Path(parent)
        for name in COPIED:
            shutil.copytree(ROOT / name, copy / name)
        shutil.copy(ROOT / "pyproject.toml", copy)
        (copy / mutant.file).write_text(broken(mutant), encoding="utf-8")
        layers = (layer for layer, marked in LAYERS.items() if notices(mutant, copy, marked))
        return next(layers, SURVIVED)


def notices(mutant: Mutant, copy: Path, marked: str) -> bool:
    """Return whether one of the mutant's tests that are so marked fails in the copy."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", marked, *mutant.tests.split()]
    paths = [str(copy / name) for name in ("", "agent", "plant", "viewer")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    ended = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True)
    if ended.returncode not in (_PASSED, _FAILED, _NONE_SELECTED):
        raise RuntimeError(f"{mutant.what}: {ended.stdout[-500:]}")
    return ended.returncode == _FAILED


def main() -> None:
    """Try all, or those whose description contains the word."""
    word = (*sys.argv, "")[1]
    counts: Counter[str] = Counter()
    for mutant in MUTANTS:
        if word in mutant.what:
            layer = first_to_notice(mutant)
            counts[layer] += 1
            print(f"{layer:9} {mutant.what}", flush=True)
    print(f"of {counts.total()}: {', '.join(f'{counts[layer]} by {layer}' for layer in LAYERS)}")
    sys.exit(bool(counts[SURVIVED]))


if __name__ == "__main__":
    main()
