"""Pieces of the loop in C, each alone against its reference in Python, over drawn inputs.

`python -m tests.hostile.native_pieces 20000`: so many of each piece. Laws, rows, terms, motion and
the order of events are compared by whole runs: drawn_runs.
"""

import argparse
import ctypes
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from unittest.mock import patch

import numpy as np

from phalanx.native import library
from phalanx.native.library import address, build, missing, require_compiler
from phalanx.native.loop.eligible import reason_against
from phalanx.native.loop.kernels import Kernels
from phalanx.native.loop.memory import MOST_INPUTS, source
from phalanx.native.loop.rules import words_of
from phalanx.native.loop.tables import RunMemory
from phalanx.network.draws import Draws, key_of
from phalanx.network.link import Link, RuleError
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.rows.decision import NotANumberError, decide_pairs
from phalanx.theory.rows.least_violation import compiled_vertex
from phalanx.theory.rows.nearest_in_box import compiled_nearest
from phalanx.theory.rows.nearest_point import compiled_point
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows
from tests.hostile.drawn_scenarios import FAMILY, scenario_of

_ENTRANCES = """
int fate_alone(Run *r, I link, I k, double sent, double distance, double *out, U *faults) {
  Copy copies[MOST_COPIES];
  int n = fate(r, link, k, sent, distance, copies, faults);
  for (int c = 0; c < n; ++c) {
    out[2 * c] = copies[c].after;
    out[2 * c + 1] = copies[c].corrupt;
  }
  return n;
}
void goal_alone(Run *r, I i, double t, double *goal) { goal_at(r, i, t, goal); }
int choice_alone(Run *r, I i, I count, const double *wish) {
  r->bindings = 0;
  return decide_pairs(r, i, count, wish, 0);
}
"""
_LINKS = 4
"""Receivers of a scenario, and senders to each, whose links are compared."""
_ORIGINS = Origin.QP, Origin.SOLVER_FAILED, Origin.BACKUP
Case = tuple[object, object]
"""What C and what Python says, as texts would be equal to the bit."""


def pieces(options: tuple[str, ...] = ("-O1",)) -> ctypes.PyDLL:
    """The loop with an entrance to each piece, and the compiled QP and backup in the cache."""
    require_compiler()
    with missing() as functions:
        compiled_nearest(), compiled_point(), compiled_vertex()
    build(functions, lambda _: None)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "loop.c")
        file.write_text(source() + _ENTRANCES)
        shared = file.with_suffix(".so")
        command = ["cc", *options, "-ffp-contract=off", "-fPIC", "-shared", "-w"]
        subprocess.run([*command, str(file), "-o", str(shared), "-lm"], check=True)
        return ctypes.PyDLL(str(shared))


def draws(loop: ctypes.PyDLL, seed: int) -> Iterator[Case]:
    """Rows of draws by key and number."""
    rng = np.random.default_rng(seed)
    for width in (1, 2, 3, 9):
        first, out = int(rng.integers(0, 10**6)), np.empty((64, width))
        words = words_of(key_of(seed, ("piece",)))
        key, reference = (
            np.array(words, np.uint64).view(np.float64),
            Draws(seed, "piece", width=width),
        )
        numbers = map(ctypes.c_longlong, (first, len(out), width))
        loop.draw_rows(address(key), *numbers, address(out))
        yield from ((row.tolist(), reference[first + k].tolist()) for k, row in enumerate(out))


class Drawn:
    """A drawn scenario's rows and memory, of which no formula is compiled."""

    def __init__(self, loop: ctypes.PyDLL, seed: int) -> None:
        self.loop, self.rng = loop, np.random.default_rng(seed)
        for number in count(FAMILY * seed):
            self.rows: SafetyRows = build_rows(build_swarm(scenario_of(number, [12])))
            if reason_against(self.rows) is None:
                break
        self.swarm, self._tables = self.rows.swarm, RunMemory(self.rows, Kernels())
        self.memory = self._tables.run
        self.run = ctypes.c_void_p(self.memory.words.ctypes.data)


def fates(loop: ctypes.PyDLL, seed: int) -> Iterator[Case]:
    """Copies and faults of messages on each link, one after the other."""
    drawn = Drawn(loop, seed)
    names, out, faults = drawn.swarm.names, np.empty(16), np.empty(1)
    for i, receiver in enumerate(names[:_LINKS]):
        for j in sorted(drawn.swarm.heard_by(i))[:_LINKS]:
            model = drawn.swarm.links.model(names[j], receiver)
            link, sent = Link(drawn.swarm.seed, names[j], receiver, model), 0.0
            for k in range(12 if model.stages else 0):
                distance = float(drawn.rng.uniform(0.0, 20.0))
                where = ctypes.c_longlong(i * len(names) + j), ctypes.c_longlong(k)
                numbers = ctypes.c_double(sent), ctypes.c_double(distance)
                result = address(out), address(faults)
                copies = loop.fate_alone(drawn.run, *where, *numbers, *result)
                bits = int(faults.view(np.uint64)[0])
                said = {n for n in range(64) if bits >> n & 1}
                try:
                    delivery = link.fate(k, sent, distance)
                except RuleError:
                    yield copies, -1
                    break
                wanted = [
                    number for copy in delivery.copies for number in (copy.after, copy.corrupt)
                ]
                yield (
                    ([float(x) for x in out[: 2 * copies]], said),
                    ([float(x) for x in wanted], set(delivery.faults)),
                )
                sent += float(drawn.rng.choice([0.0, 0.01, 0.3]))


def goals(loop: ctypes.PyDLL, seed: int) -> Iterator[Case]:
    """Goals at rising times, of agents at their starts."""
    drawn = Drawn(loop, seed)
    swarm, x = drawn.swarm, drawn.swarm.start()
    states, axes = {l: x[part] for l, part in enumerate(swarm.safe_set.parts)}, swarm.groups[0].axes
    for i in range(len(swarm.members)):
        goal, out = swarm.goal(i), np.empty(3 * axes)
        for t in np.sort(drawn.rng.uniform(0.0, 3.0, 20)):
            loop.goal_alone(drawn.run, ctypes.c_longlong(i), ctypes.c_double(t), address(out))
            yield out.tolist(), np.concatenate(goal(float(t), states)).tolist()


def choices(loop: ctypes.PyDLL, seed: int) -> Iterator[Case]:
    """The nearest input that keeps rows, or the one with the least violation."""
    drawn = Drawn(loop, seed)
    if not drawn.swarm.safety.pairwise:
        return
    memory, rng, qp_of = drawn.memory, drawn.rng, dict[int, NearestInput]()
    polytopes, begin = drawn.rows.composed.members.constant_polytopes, memory["row_at"]
    for _ in range(60):
        i = int(rng.choice(drawn.swarm.normal))
        most = int(begin[i + 1] - begin[i])
        metric = drawn.swarm.members[i].dynamics.input_metric()
        rows, wish = _drawn_rows(rng, int(rng.integers(0, most + 1)), len(metric), most)
        size = len(rows.bound)
        memory["row_a"][: rows.a.size] = rows.a.ravel()
        memory["row_bound"][:size], memory["row_margin"][:size] = rows.bound, rows.margin
        memory["row_of"][:size] = rows.others
        where = ctypes.c_longlong(i), ctypes.c_longlong(size)
        failed = loop.choice_alone(drawn.run, *where, address(np.pad(wish, (0, MOST_INPUTS))))
        if i not in qp_of:
            with patch.object(library, "_folder", lambda: None):
                qp_of[i] = NearestInput(metric)
        qp = qp_of[i]
        try:
            decision = decide_pairs(polytopes[i], rows, wish, qp)
        except NotANumberError:
            yield failed, -1
            continue
        if failed:  # numbers are too large: the run is then made in process
            assert np.nanmax(np.abs([*rows.a.ravel(), *rows.bound])) > 1e30
            continue
        residual, margin = (float(memory[f"step_{n}"][0]) for n in ("residual", "margin"))
        binding = memory["binding_of"][: int(memory.number("bindings")[0])]
        yield (
            (memory["step_u"][0, : len(metric)].tolist(), _ORIGINS[int(memory["step_origin"][0])],
             None if math.isnan(residual) else residual,
             None if math.isnan(margin) else margin, tuple(binding.tolist())),
            (decision.u.tolist(), decision.origin, decision.residual, decision.margin,
             decision.binding),
        )  # fmt: skip


def _drawn_rows(rng: np.random.Generator, size: int, m: int, most: int) -> tuple[Rows, Array]:
    """Rows of all kinds: through one point, parallel, zero, without a margin, and a wish."""
    a = rng.normal(size=(size, m)) * 10.0 ** rng.integers(-3, 3, size=(size, 1))
    bound = rng.normal(size=size) * 10.0 ** rng.integers(-4, 2, size=size)
    wish = rng.normal(size=m) * 10.0 ** rng.integers(-1, 3)
    kind = rng.integers(0, 8)
    if kind == 0:
        bound = (a * 0.1).sum(axis=1)
    elif kind == 1 and size:
        a[:] = a[0]
    elif kind == 2 and size:
        bound[rng.integers(size)] = rng.choice([-math.inf, math.inf, -1e31])
    elif kind == 3 and size:
        a[rng.integers(size)] = 0.0
    elif kind == 4:
        a, bound, wish = np.round(2.0 * np.sign(a)), np.round(bound), np.round(wish)
    margin = np.where(np.isneginf(bound), math.inf, rng.uniform(0.0, 2.0, size))
    return Rows(a, bound, margin, tuple(rng.permutation(most + 1)[:size].tolist())), wish


PIECES: tuple[Callable[[ctypes.PyDLL, int], Iterator[Case]], ...] = draws, fates, goals, choices


def different(loop: ctypes.PyDLL, numbers: Sequence[int], first: int = 0) -> Iterator[str]:
    """Compare each piece over so many inputs; yield what differs, and print a line for each."""
    for piece, number in zip(PIECES, numbers, strict=True):
        compared, wrong, began = 0, 0, time.process_time()
        for seed in count(first):
            for made, wanted in piece(loop, seed):
                compared += 1
                if repr(made) != repr(wanted):
                    wrong += 1
                    yield f"DIFFERENT {piece.__name__}, seed {seed}: {made}, in Python {wanted}"
            if compared >= number:
                break
        seconds = time.process_time() - began
        print(f"{piece.__name__}: {compared} inputs, {wrong} differ, {seconds:.0f} s", flush=True)


def main() -> int:
    """Compare pieces; return whether any differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("number", type=int)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    arguments = parser.parse_args()
    lines = list(different(pieces(), [arguments.number] * len(PIECES), arguments.first))
    print("\n".join(lines[:20]))
    return bool(lines)


if __name__ == "__main__":
    sys.exit(main())
