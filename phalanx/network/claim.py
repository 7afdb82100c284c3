"""A claim: what a broadcast says of its sender's input, true or not."""

import msgspec


class Claim(msgspec.Struct, array_like=True, frozen=True):
    """An input, and since when it is said to be in force."""

    t_apply: float
    """[s]"""
    u: tuple[float, ...]
    """Native input, shape (m_i,)."""
