"""A law's nominal input, checked: a law may be a user's."""

import math

import numpy as np
from numpy.typing import NDArray

from phalanx.theory.expressions.asked import MistakenMethodError, ask, in_short
from phalanx.theory.laws.law import Law, View
from phalanx.theory.safety.composition import Member

Array = NDArray[np.float64]


def nominal_input(law: Law, view: View, member: Member) -> Array:
    """Ask a law for agent i's nominal input, shape (m_i,).

    Args:
        law: the agent's.
        view: what it may look at.
        member: agent i.

    Raises:
        MistakenMethodError: it returned something else, raised, or does not return.
    """
    inputs = len(member.dynamics.inputs)
    expected = f"an array of {inputs} finite numbers"
    found = ask(law, "input", expected, view, agent=member.name)
    if not isinstance(found, np.ndarray):
        got = repr(found)
    elif found.shape != (inputs,) or found.dtype.kind not in "fi":
        got = f"shape {found.shape} of {found.dtype}"
    elif not all(map(math.isfinite, found.tolist())):  # of few numbers faster than through numpy
        got = in_short(found)
    else:
        return found
    raise MistakenMethodError(law, "input", expected, got, agent=member.name)
