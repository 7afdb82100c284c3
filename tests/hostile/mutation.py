"""Small changes to what is right: of trees of values, of bytes, of texts; each drawn at random."""

import copy
import random
from collections.abc import Iterator
from typing import Any

_DEEP: Any = 0
for _ in range(100):
    _DEEP = [_DEEP]
HOSTILE: tuple[Any, ...] = (
    None, True, False, -1, 0, 1, 7, 255, 2**31, 2**53, 2**63 - 1, -(2**63), 2**64 - 1,
    -0.0, 0.5, 5e-324, 1e-9, 1e300, 1.7e308, -1.7e308, float("nan"), float("inf"), float("-inf"),
    "", "1", "*", "**", "../..", "\0", "\ud7ff", "none", "os:system", "x" * 5000,
    b"", b"\0" * 8, b"\xff" * 24, bytes(50_000), [], [[]], {}, {"k": 1}, [0] * 3000, [1e300] * 15,
    _DEEP,
)  # fmt: skip
"""What may stand in the place of a value."""


def of_tree(tree: Any, draw: random.Random, changes: int = 1) -> Any:
    """A copy of lists, tables and values that differs in a few places."""
    spoilt = copy.deepcopy(tree)
    for _ in range(changes):
        positions = list(_positions(spoilt))
        if not positions:
            return _hostile(draw)
        _spoil(*draw.choice(positions), draw)
    return spoilt


def of_numbers(tree: Any, draw: random.Random, changes: int = 1) -> Any:
    """A copy of lists, tables and values in which a few numbers are much smaller or larger."""
    spoilt = copy.deepcopy(tree)
    for _ in range(changes):
        numbers = [(c, key) for c, key in _positions(spoilt) if type(c[key]) in (int, float)]
        container, key = draw.choice(numbers)
        size = 10.0 ** draw.choice((draw.uniform(-4.0, 4.0), draw.uniform(-323.0, 308.0)))
        number = int(size) if draw.random() < 0.2 else size
        container[key] = -number if draw.random() < 0.2 else number
    return spoilt


def of_bytes(whole: bytes, draw: random.Random) -> bytes:
    """A copy with bits flipped, cut short, or with some bytes taken out, doubled or put in."""
    spoilt, at = bytearray(whole), draw.randrange(len(whole) + 1)
    match draw.randrange(5):
        case 0:
            for _ in range(draw.choice((1, 1, 2, 8))):
                spoilt[draw.randrange(len(whole))] ^= 1 << draw.randrange(8)
        case 1:
            del spoilt[at:]
        case 2:
            del spoilt[at : at + draw.randrange(1, 40)]
        case 3:
            spoilt[at:at] = spoilt[at : at + draw.randrange(1, 400)]
        case _:
            spoilt[at:at] = draw.randbytes(draw.randrange(1, 40))
    return bytes(spoilt)


def _positions(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every container in a tree with each of its keys or indices."""
    keys = tree.keys() if isinstance(tree, dict) else range(len(tree)) if _is_list(tree) else ()
    for key in list(keys):
        yield tree, key
        yield from _positions(tree[key])


def _hostile(draw: random.Random) -> Any:
    return copy.deepcopy(draw.choice(HOSTILE))


def _is_list(tree: Any) -> bool:
    return isinstance(tree, list) and len(tree) < 100


def _spoil(container: Any, key: Any, draw: random.Random) -> None:
    match draw.randrange(8):
        case 0:
            del container[key]
        case 1 if isinstance(container, list):
            container.insert(key, _hostile(draw))
        case 2 if isinstance(container, list):
            container.insert(key, copy.deepcopy(container[draw.randrange(len(container))]))
        case 1 | 2:
            container[draw.choice(("", "k", "type", key, f"{key}s"))] = _hostile(draw)
        case 3 if type(container[key]) in (int, float):
            container[key] = _near(container[key], draw)
        case 4:
            other = draw.choice(list(container) if isinstance(container, dict) else range(key + 1))
            container[key] = copy.deepcopy(container[other])
        case _:
            container[key] = _hostile(draw)


def _near(number: float, draw: random.Random) -> float:
    # What is larger is no integer of msgpack or TOML any more.
    factor = 1000 if abs(number) < 2**50 else 0
    return draw.choice((number * factor, -number * factor, number // 2 + 1, number / 1000))
