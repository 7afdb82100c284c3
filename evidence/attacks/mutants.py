"""Break safeguards on purpose, one at a time, and see whether a test fails.

    python evidence/attacks/mutants.py [WORD]

In a copy of the sources. One line for each; exit with 1 if one was not noticed.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.hostile.mutants import MUTANTS, ROOT, Mutant, broken

COPIED = ("phalanx", "agent", "plant", "viewer", "tests", "scenarios", "docs")


def noticed(mutant: Mutant) -> bool:
    """Return whether a test fails in a copy of the sources with the safeguard broken."""
    with tempfile.TemporaryDirectory() as parent:
        copy = Path(parent)
        for name in COPIED:
            shutil.copytree(ROOT / name, copy / name)
        shutil.copy(ROOT / "pyproject.toml", copy)
        (copy / mutant.file).write_text(broken(mutant), encoding="utf-8")
        command = [sys.executable, "-m", "pytest", "-q", "-x", *mutant.tests.split()]
        paths = [str(copy / name) for name in ("", "agent", "plant", "viewer")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
        ended = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True)
        if ended.returncode not in (0, 1):
            raise RuntimeError(f"{mutant.what}: {ended.stdout[-500:]}")
        return ended.returncode == 1


def main() -> None:
    """Try all, or those whose description contains the word."""
    word = (*sys.argv, "")[1]
    chosen = [mutant for mutant in MUTANTS if word in mutant.what]
    survivors = 0
    for mutant in chosen:
        found = noticed(mutant)
        survivors += not found
        print(f"{'noticed' if found else 'SURVIVED':9} {mutant.what}", flush=True)
    print(f"{len(chosen) - survivors} of {len(chosen)} noticed")
    sys.exit(bool(survivors))


if __name__ == "__main__":
    main()
