"""Numbers as a person reads them: three figures, and no powers of ten."""

import math

_WHOLE = 1e3
_BEYOND = 1e9
"""From here on a number only says that nothing compares with it."""


def in_words(value: float) -> str:
    """A number with three significant figures, such as 0.0123, 8.06 or 36 900."""
    if not math.isfinite(value):
        return "unlimited"
    if abs(value) >= _BEYOND:
        return "more than a thousand million"
    rounded = float(f"{value:.3g}")
    return f"{rounded:,.0f}".replace(",", " ") if abs(rounded) >= _WHOLE else f"{rounded:g}"
