"""CasADi expressions over boxes: one walk through their instructions, in interval arithmetic."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.arrays import Mask
from phalanx.certify.checker.intervals import Interval, UndecidedError, point
from phalanx.certify.checker.rules import JUMPS, RULES


class IntervalFunction:
    """Expressions of vectors, bounded over boxes: one walk through CasADi's instructions.

    The numbers in an expression are taken as CasADi has them, folded in float64.
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        """Column inputs, shape (n,) each, made of symbols; outputs of any shape.

        Raises UndecidedError, naming an operation for which there is no rule.
        """
        flat = [ca.densify(ca.vec(output)) for output in outputs]
        self._sizes = [output.numel() for output in flat]
        f = self._f = ca.Function("f", [ca.vec(i) for i in inputs], flat, {"cse": True})
        self._program = [
            (f.instruction_id(k), f.instruction_input(k), f.instruction_output(k))
            for k in range(f.n_instructions())
        ]
        known = {*RULES, *JUMPS, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}
        for op, _, _ in self._program:
            if op not in known:
                raise UndecidedError(f"no interval rule for the operation {_name(op)!r}")

    def __call__(self, *inputs: Interval) -> tuple[list[Interval], Mask]:
        """Bounds of each output, shapes (size, s), over s boxes, inputs (n, s) each.

        And whether nothing in them can jump there, shape (s,): a sign, a comparison or a rounding
        that is not the same all over a box is a jump, be it only in a derivative (a kink).
        """
        shape = np.broadcast_shapes(*[i.lo.shape[1:] for i in inputs])
        results = [Interval(np.zeros((n, *shape)), np.zeros((n, *shape))) for n in self._sizes]
        smooth = np.ones(shape, dtype=bool)
        work: dict[int, Interval] = {}
        with np.errstate(all="ignore"):
            for k, (op, sources, targets) in enumerate(self._program):
                if op == ca.OP_CONST:
                    work[targets[0]] = point(self._f.instruction_constant(k))
                elif op == ca.OP_INPUT:
                    work[targets[0]] = inputs[sources[0]][sources[1]]
                elif op == ca.OP_OUTPUT:
                    result, value = results[targets[0]], work[sources[0]]
                    result.lo[targets[1]], result.hi[targets[1]] = value.lo, value.hi
                elif op in RULES:
                    work[targets[0]] = RULES[op](*[work[s] for s in sources])
                else:
                    work[targets[0]], constant = JUMPS[op](*[work[s] for s in sources])
                    smooth &= constant
        return results, smooth


def _name(op: int) -> str:
    names = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
    return names.get(op, str(op)).removeprefix("OP_").lower()
