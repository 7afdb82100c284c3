"""Compare trajectory hashes of the shipped scenarios under other kernels, CPUs, libms and Pythons.

    python bench/speed/portability.py --python 3.12=path/to/python --python 3.13=path/to/python
    python bench/speed/portability.py --only compiled [--engine processes]

Each run is a `phalanx run` of its own. The first column is this Python with CasADi's interpreter;
*compiled* is machine code, as `phalanx compile` makes it. Other cells are `same` or
another hash. Exits with 1 if any differs. The last line compares the sines of libm itself.
"""

import argparse
import ctypes
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

import phalanx
from phalanx.launcher.engine import ENGINES
from phalanx.native.library import COMPILER, FOLDER

_NUMPY = np._core._multiarray_umath  # type: ignore[attr-defined]
_DISPATCHED = [f for f in _NUMPY.__cpu_dispatch__ if _NUMPY.__cpu_features__.get(f)]
SETTINGS: Mapping[str, Mapping[str, str]] = {
    "BLAS Prescott": {"OPENBLAS_CORETYPE": "Prescott"},
    "BLAS Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "no SIMD": {"NPY_DISABLE_CPU_FEATURES": " ".join(_DISPATCHED)},
    "libm without FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4"},
    "compiled": {COMPILER: shutil.which("cc") or ""},
}


def main() -> None:
    """Run every scenario under every setting, and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    shipped = [name for name in phalanx.shipped() if not name.startswith("worlds/")]
    arguments.add_argument(
        "scenarios", nargs="*", default=shipped, help="by default all but worlds/"
    )
    arguments.add_argument("--duration", type=float, help="virtual time [s]; whole runs otherwise")
    arguments.add_argument("--only", action="append", choices=list(SETTINGS), help="a setting")
    arguments.add_argument("--engine", choices=list(ENGINES), default="in-process")
    arguments.add_argument("--python", action="append", default=[], help="NAME=path of another")
    arguments.add_argument("--libm", action="store_true", help=argparse.SUPPRESS)
    options = arguments.parse_args()
    if options.libm:
        print(libm_here())
        return
    others = dict(given.split("=", 1) for given in options.python)
    chosen = options.only or SETTINGS
    columns = {name: (sys.executable, SETTINGS[name]) for name in chosen}
    columns |= {f"Python {name}": (path, {}) for name, path in others.items()}
    print("|", " | ".join(["scenario", "here", *columns]), "|")
    print("|---" * (2 + len(columns)) + "|")
    differed = False
    for scenario in options.scenarios:
        run = partial(trajectory, scenario, options.duration, options.engine)
        here = run(sys.executable, {})
        hashes = [run(*column) for column in columns.values()]
        cells = ["same" if there == here else there[:12] for there in hashes]
        differed |= set(cells) != {"same"}
        print("|", " | ".join([scenario, here[:12], *cells]), "|", flush=True)
    print("libm itself:", "differs" if libm_without_fma() != libm_here() else "same", "without FMA")
    sys.exit(differed)


def trajectory(
    scenario: str, duration: float | None, engine: str, python: str, setting: Mapping[str, str]
) -> str:
    """Run a scenario; return the hash of its states and inputs."""
    shorter: Sequence[str] = () if duration is None else ("--set", f"duration={duration}")
    with tempfile.TemporaryDirectory(prefix="phalanx-") as parent:
        # The cache is as temporary as the run: without a compiler it is not looked at.
        environment = {**os.environ, COMPILER: "", FOLDER: f"{parent}/cache", **setting}
        phalanx_with, to = [python, "-m", "phalanx"], ["--engine", engine, "--no-report"]
        if environment[COMPILER]:
            command = [*phalanx_with, "compile", scenario, *shorter]
            subprocess.run(command, env=environment, capture_output=True, check=True)
        run = subprocess.run(
            [*phalanx_with, "run", scenario, *shorter, *to, "--out", parent],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        summaries = list(Path(parent).glob("*/summary.json"))
        if not summaries:
            raise RuntimeError(f"{scenario}: no verdict\n{run.stderr}{run.stdout}")
        return str(json.loads(summaries[0].read_text("utf-8"))["trajectory"])


def libm_here() -> str:
    """Return a hash of many sines by the C library."""
    sine = ctypes.CDLL("libm.so.6").sin
    sine.restype, sine.argtypes = ctypes.c_double, [ctypes.c_double]
    values = np.array([sine(x) for x in np.linspace(0.0, 3.0, 100_000).tolist()])
    return hashlib.sha256(values.tobytes()).hexdigest()


def libm_without_fma() -> str:
    """Return the same from a process whose libm may not use FMA."""
    environment = {**os.environ, **SETTINGS["libm without FMA"]}
    answer = subprocess.run(
        [sys.executable, __file__, "--libm"], env=environment, capture_output=True, check=True
    )
    return answer.stdout.decode().strip()


if __name__ == "__main__":
    main()
