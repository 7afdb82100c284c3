"""Evaluation of a CasADi function's instructions on values of any other type."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import casadi as ca

_Value = TypeVar("_Value")


def evaluate(
    function: ca.Function,
    inputs: Sequence[Sequence[_Value]],
    constant: Callable[[float], _Value],
    operation: Callable[[int, list[_Value]], _Value],
) -> list[_Value]:
    """Evaluate a function of SX with one output instruction by instruction.

    Args:
        function: to evaluate.
        inputs: the values of each input's components.
        constant: makes the value of a number.
        operation: (CasADi's number of an operation, values of its arguments) -> value.

    Returns:
        The values of the output's components.
    """
    values: dict[int, _Value] = {}
    results = [constant(0.0)] * function.numel_out(0)
    for k in range(function.n_instructions()):
        op, sources = function.instruction_id(k), function.instruction_input(k)
        targets = function.instruction_output(k)
        if op == ca.OP_CONST:
            values[targets[0]] = constant(function.instruction_constant(k))
        elif op == ca.OP_INPUT:
            values[targets[0]] = inputs[sources[0]][sources[1]]
        elif op == ca.OP_OUTPUT:
            results[targets[1]] = values[sources[0]]
        else:
            values[targets[0]] = operation(op, [values[s] for s in sources])
    return results
