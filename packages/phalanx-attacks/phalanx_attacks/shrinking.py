"""Shrinking: from a scenario in which something fails to the smallest in which it still does.

Delta debugging on a scenario's table: fewer parts, nearer to the scenario that was attacked,
shorter, rounder numbers; again until nothing changes. What failing means is the caller's.
"""

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from typing import Any, TypeVar

T = TypeVar("T")
Fields = dict[str, Any]
KeyPath = tuple[str | int, ...]
"""Keys and indices on the path to a value of a table."""
Observe = Callable[[Fields], float | None]
"""Time at which a scenario fails [s]; None if it does not, or is not valid."""

_ROUNDS = 8
"""Most repetitions of all passes; two or three are usual."""
_DIGITS = (0, 1, 2, 3)
"""Decimals to try, the roundest first."""
_LISTS = ("faults", "limits", "obstacles", "reseed")
_TABLES = ("attack", "description", "flows", "formation", "network", "scatter", "workspace")
_OF_AGENTS = ("disturbance", "goal", "sensing", "slots", "spread", "start")
_OF_ATTACK = {"agents", "duration", "name", "names", "start", *_LISTS}
"""Fields that need not have the value of the scenario attacked."""
_EACH = ("names", "slots", "start", "goal")
"""Fields of a group with one entry for each agent."""


def ddmin(items: Sequence[T], fails: Callable[[list[T]], bool]) -> list[T]:
    """Return a sublist that fails, of which no single item can be left out.

    Chunks are left out, of all items first, then of half as many, down to one.

    Args:
        items: which fail together.
        fails: whether a sublist fails; the same answer for the same sublist.
    """
    rest, size = list(items), len(items)
    while size:
        begin, before = 0, len(rest)
        while begin < len(rest):
            fewer = rest[:begin] + rest[begin + size :]
            if fails(fewer):
                rest = fewer
            else:
                begin += size
        if size > 1:
            size = min(size // 2, len(rest))
        elif len(rest) == before:
            break
    return rest


def shrink(table: Fields, origin: Fields, observe: Observe) -> Fields:
    """Return the smallest scenario found that fails as a given one does.

    Args:
        table: of the scenario, as its file has it. It fails.
        origin: of the scenario that was attacked.
        observe: called for every candidate; candidates may repeat.
    """
    for _ in range(_ROUNDS):
        before = table
        for reduced in (_shorter, _fewer, _nearer, _rounder):
            table = reduced(table, origin, observe)
        if table == before:
            break
    return table


def size_of(table: Fields) -> int:
    """Return the number of values in a table."""
    return sum(1 for _ in leaves(table))


def leaves(node: Any, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    """Yield every value that is neither a table nor a list, with its path."""
    if isinstance(node, dict | list):
        pairs = node.items() if isinstance(node, dict) else enumerate(node)
        for key, child in pairs:
            yield from leaves(child, (*path, key))
    else:
        yield path, node


def _fewer(table: Fields, origin: Fields, observe: Observe) -> Fields:
    """Leave out adversaries and other agents, faults, obstacles, switches, then optional fields."""
    for listed in (_agents, _elements, _switches, _optional):
        table = _with_fewest(table, list(listed(table)), observe)
    return table


def _with_fewest(table: Fields, parts: list[KeyPath], observe: Observe) -> Fields:
    def with_(chosen: list[KeyPath]) -> Fields:
        return _without(table, [part for part in parts if part not in chosen])

    return with_(ddmin(parts, lambda chosen: observe(with_(chosen)) is not None))


def _agents(table: Fields) -> Iterator[KeyPath]:
    groups = list(enumerate(table.get("agents", ())))
    for g, group in sorted(groups, key=lambda entry: entry[1].get("role") != "adversary"):
        for member in range(len(group.get("names", ()))):
            yield "agents", g, "names", member


def _elements(table: Fields) -> Iterator[KeyPath]:
    for name in _LISTS:
        yield from ((name, k) for k in range(len(table.get(name, ()))))


def _switches(table: Fields) -> Iterator[KeyPath]:
    for g, group in enumerate(table.get("agents", ())):
        law = group.get("law", {})
        if law.get("type") == "script":
            yield from (("agents", g, "law", "at", k) for k in range(len(law["at"])))


def _optional(table: Fields) -> Iterator[KeyPath]:
    yield from ((name,) for name in _TABLES if name in table)
    yield from (("network", name) for name in table.get("network", ()))
    for g, group in enumerate(table.get("agents", ())):
        yield from (("agents", g, name) for name in _OF_AGENTS if name in group)
        if "jitter" in group.get("clock", ()):
            yield "agents", g, "clock", "jitter"


def _without(table: Fields, parts: Sequence[KeyPath]) -> Fields:
    """Return a copy of a table without some of its parts."""
    table = copy.deepcopy(table)
    for part in sorted(parts, reverse=True):  # later elements first: the others keep their index
        match part:
            case ("agents", int(g), "names", int(member)):
                group = table["agents"][g]
                for name in _EACH:
                    if name in group:
                        del group[name][member]
            case ("agents", int(g), "law", "at", int(switch)):
                law = table["agents"][g]["law"]
                del law["at"][switch], law["inputs"][switch]
                law["at"][:1] = [0.0] * len(law["at"][:1])
            case _:
                *above, last = part
                del _at(table, above)[last]
    table["agents"] = [group for group in table["agents"] if group.get("names", True)]
    return {key: value for key, value in table.items() if key == "agents" or value not in ([], {})}


def _nearer(table: Fields, origin: Fields, observe: Observe) -> Fields:
    """Give as many fields as possible the value that they have in the scenario attacked."""
    targets = _of_origin(table, origin)
    now = {path: _at(table, path) for path in targets}
    changed = [path for path in targets if now[path] != targets[path]]

    def with_(chosen: list[KeyPath]) -> Fields:
        back = {path: targets[path] for path in changed if path not in chosen}
        return _with(table, back)

    return with_(ddmin(changed, lambda chosen: observe(with_(chosen)) is not None))


def _of_origin(table: Fields, origin: Fields) -> dict[KeyPath, Any]:
    """Return the values of the scenario attacked at the paths that both have."""
    pairs: list[tuple[KeyPath, Fields, Fields]] = [((), table, origin)]
    for g, group in enumerate(table.get("agents", ())):
        names = set(group.get("names", ()))
        for other in origin.get("agents", ()):
            if names and names <= set(other.get("names", ())):
                pairs.append((("agents", g), group, other))
    values: dict[KeyPath, Any] = {}
    for above, here, there in pairs:
        for name in (here.keys() & there.keys()) - _OF_ATTACK:
            if isinstance(here[name], dict) and name in ("safety", "network", "time", "clock"):
                inner = here[name].keys() & there[name].keys()
                values |= {(*above, name, key): there[name][key] for key in inner}
            else:
                values[*above, name] = there[name]
    if "seed" in table:
        values.setdefault(("seed",), 0)
    return {path: values[path] for path in sorted(values, key=str)}


def _shorter(table: Fields, origin: Fields, observe: Observe) -> Fields:
    """End the run soon after it has failed."""
    failed = observe(table)
    for digits in _DIGITS:
        end = math.floor((failed or 0.0) * 10**digits + 1.0) / 10**digits
        if end >= table["duration"]:
            break
        shorter = {**table, "duration": end}
        if observe(shorter) is not None:
            return shorter
    return table


def _rounder(table: Fields, origin: Fields, observe: Observe) -> Fields:
    """Round starts, laws and faults: all at once, then each as far as it goes."""
    paths = [path for path, value in leaves(table) if _may_be_rounded(path, value)]
    for digits in _DIGITS:
        rounded = _with(table, {path: _round(_at(table, path), digits) for path in paths})
        if rounded == table or observe(rounded) is not None:
            table = rounded
            break
    for path, digits in chain.from_iterable(((p, d) for d in _DIGITS) for p in paths):
        now, value = _at(table, path), _round(_at(table, path), digits)
        if len(f"{value:g}") < len(f"{now:g}"):
            rounded = _with(table, {path: value})
            table = rounded if observe(rounded) is not None else table
    return table


def _may_be_rounded(path: KeyPath, value: Any) -> bool:
    searched = path[0] == "faults" or (path[0] == "agents" and path[2] in ("start", "law"))
    return searched and isinstance(value, float)


def _round(value: float, digits: int) -> float:
    return round(value, digits) + 0.0  # no -0.0


def _with(table: Fields, values: dict[KeyPath, Any]) -> Fields:
    """Return a copy of a table with some values replaced."""
    table = copy.deepcopy(table)
    for (*above, last), value in values.items():
        _at(table, above)[last] = copy.deepcopy(value)
    return table


def _at(table: Any, path: Sequence[str | int]) -> Any:
    for key in path:
        table = table[key]
    return table
