"""The minimiser's C pieces under several compilers: the hash of all their answers."""

import hashlib
import importlib.util
import shutil
import struct
import subprocess
import sys
from pathlib import Path

from phalanx.theory.arrays import Array
from phalanx.theory.rows import least_violation, nearest_in_box, nearest_point
from phalanx.theory.rows.nearest_in_box import TOLERANCE

MODULES = (nearest_point, nearest_in_box, least_violation)
SOURCES = [Path(str(module.__file__)).with_suffix(".c") for module in MODULES]
OPTIONS = ["-ffp-contract=off", "-O2", "-lm"]
COMPILERS = {
    "cc": (["cc"], []),
    "cc -O3 -march=native": (["cc", "-O3", "-march=native"], []),
    "ziglang": ([sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"], []),
    "AArch64": (["aarch64-linux-gnu-gcc", "-static"], ["qemu-aarch64"]),
}
MAIN = r"""
#include <stdio.h>
#include <stdlib.h>
int nearest_point(int, int, double *, const double *, const double *, double, int, const double *,
                  int *);
int nearest_in_box(int, double *, double, double);
int least_vertex(int, int, const double *, double *);
static double *numbers_of(int count, int room) {
  double *numbers = malloc((count + room) * sizeof(double));
  if (fread(numbers, 8, count, stdin) != (size_t)count) exit(1);
  return numbers;
}
static void write_answer(int found, int count, const double *numbers) {
  fwrite(&found, 4, 1, stdout);
  if (found >= 0) fwrite(numbers, 8, count, stdout);
}
int main(void) {
  int head[3];
  double *limits = numbers_of(6, 0);
  while (fread(head, 4, 3, stdin) == 3) {
    int m = head[1], k = head[2];
    if (head[0] == 0) {
      double *p = numbers_of(m + m * k + k + 1, 0), *v = malloc((2 * m + k) * sizeof(double));
      int *rows = malloc((m + 2 * k) * sizeof(int));
      for (int c = 0; c < m; ++c) v[c] = p[c];
      int count = nearest_point(m, k, v, p + m, p + m + m * k, p[m + m * k + k], -1, limits, rows);
      write_answer(count, m, v + m);
      if (count > 0) fwrite(rows, 4, count, stdout);
      free(p), free(v), free(rows);
    } else if (head[0] == 1) {
      double *bounds = numbers_of(2, 0), *p = numbers_of(5 * m, 3 * m);
      write_answer(nearest_in_box(m, p, bounds[0], bounds[1]) - 1, m, p + 5 * m);
      free(bounds), free(p);
    } else {
      double *table = numbers_of(k * (m + 1), m), *x = table + k * (m + 1);
      write_answer(least_vertex(m, k, table, x) - 1, m, x);
      free(table);
    }
  }
  return 0;
}
"""


def packed_point(n: list[float], G: Array, g: Array, size: float) -> bytes:
    """A program of nearest_point as the C program reads it."""
    numbers = struct.pack(f"{len(n)}d", *n) + G.tobytes() + g.tobytes() + struct.pack("d", size)
    return struct.pack("iii", 0, G.shape[1], len(g)) + numbers


def packed_box(numbers: Array, bound: float) -> bytes:
    """A program of nearest_in_box; numbers: shape (5, m)."""
    head = struct.pack("=iiidd", 1, numbers.shape[1], 0, bound, TOLERANCE)
    return head + numbers.tobytes()


def packed_vertex(table: Array) -> bytes:
    """A program of least_vertex; table: shape (count, d + 1)."""
    return struct.pack("iii", 2, table.shape[1] - 1, len(table)) + table.tobytes()


def hash_by(compiler: str, data: bytes, folder: Path) -> str:
    """The hash of all answers of the C program that this compiler makes."""
    command, emulator = COMPILERS[compiler]
    if any(shutil.which(program) is None for program in (command[0], *emulator)):
        return "not installed"
    if compiler == "ziglang" and importlib.util.find_spec("ziglang") is None:
        return "not installed"
    source, target = folder / "main.c", folder / "main"
    source.write_text(MAIN)
    subprocess.run([*command, source, *SOURCES, "-o", target, *OPTIONS], check=True)
    limits = nearest_point.LIMITS.tobytes()
    answers = subprocess.run(
        [*emulator, target], input=limits + data, stdout=subprocess.PIPE, check=True
    )
    return hashlib.sha256(answers.stdout).hexdigest()[:16]


def library(folder: Path) -> Path:
    """All pieces as one library, by cc."""
    target = folder / "minimiser.so"
    subprocess.run(["cc", *SOURCES, "-fPIC", "-shared", *OPTIONS, "-o", target], check=True)
    return target
