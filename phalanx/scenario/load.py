"""Reading of scenarios: a file or the name of one that ships, plus --set overrides; their text."""

import copy
import difflib
import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import ValidationError

from phalanx.network.trace import TraceFileError, with_traces
from phalanx.scenario.declared import KINDS
from phalanx.scenario.model import Reading, Scenario, ScenarioError
from phalanx.schema.fields import field_path
from phalanx.schema.registry import as_table
from phalanx.schema.user_code import UntrustedCodeError, code_trusted

_CHECKOUT = Path(__file__).parents[2]
_BARE = re.compile(r"[A-Za-z0-9_-]+")
"""Keys that TOML needs no quotes for."""
_DEEPEST, _LONGEST = 64, 1024
"""Most tables and lists inside one another, and bits of an integer."""
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(rf"(?<![\w-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{_DEEPEST}}}")


def shipped() -> dict[str, Traversable]:
    """Return the scenarios that ship with Phalanx, by name; a folder's name precedes theirs.

    A wheel has them inside the package, a checkout at its top, a copy of the package nowhere.
    """
    inside = files(__package__) / "shipped"
    if inside.is_dir():
        return dict(_in_folder(inside, ""))
    is_checkout = (_CHECKOUT / "plant" / "phalanx_plant").is_dir()
    return dict(_in_folder(_CHECKOUT / "scenarios", "")) if is_checkout else {}


def _in_folder(folder: Traversable, above: str) -> Iterator[tuple[str, Traversable]]:
    entries = sorted(folder.iterdir(), key=lambda entry: (entry.is_dir(), entry.name))
    for entry in entries:
        if entry.is_dir():
            yield from _in_folder(entry, f"{above}{entry.name}/")
        elif entry.name.endswith(".toml"):
            yield above + entry.name.removesuffix(".toml"), entry


def load(
    source: str | Path | Mapping[str, Any],
    overrides: Sequence[str] | Mapping[str, Any] = (),
    seed: int | None = None,
    *,
    trust: bool = True,
) -> Scenario:
    """Read a scenario, override some of its fields, and validate it.

    Args:
        source: path of a TOML file, the name of a shipped scenario, or a scenario's table.
        overrides: values by "path.to.field", or texts "path.to.field=value" with the value as
            TOML, in which a bare word is a string. A value may be an object of a dataclass, such
            as a controller: its class and fields count.
        seed: replaces the scenario's seed.
        trust: import, and so run, the Python modules that it names.

    Raises:
        ScenarioError: unreadable, not TOML, or not a valid scenario.
    """
    where = "scenario" if isinstance(source, Mapping) else str(source)
    if not isinstance(overrides, Mapping):
        overrides = dict(map(field_and_value, overrides))
    overrides = {path: _as_table(path, value) for path, value in overrides.items()}
    table = read_table(source, overrides)
    if seed is not None:
        table["seed"] = seed
    # No command can read a table.
    reading = None if isinstance(source, Mapping) else reading_of(where, overrides)
    with code_trusted(trust):
        return validate(table, where).model_copy(update={"reading": reading})


def reading_of(source: str, overrides: Mapping[str, Any]) -> Reading:
    """Return how a scenario is read, from which its command follows."""
    return Reading(source=source, overrides={p: inline(v) for p, v in overrides.items()})


def read_table(
    source: str | Path | Mapping[str, Any], overrides: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """Return a copy of the table of a scenario that load takes, with some fields set by path.

    Traces are read: of a file relative to its folder, of overrides to the current one.

    Raises ScenarioError.
    """
    name, folder = "scenario", Path()
    if isinstance(source, Mapping):
        table = copy.deepcopy(dict(source))
    else:
        name = str(source)
        table, folder = _parsed(name), Path(str(shipped().get(name, name))).parent
    try:
        with_traces(table, folder)
        for path, value in overrides.items():
            set_field(table, path, value)
        return with_traces(table, Path())
    except TraceFileError as error:
        raise ScenarioError(f"{name}: trace {error}") from error


def described(error: ValidationError, source: str) -> str:
    """List every problem that was found in a table, a line each; source: its file."""
    found = error.errors()
    # A list with invalid items is also too short: what is inside says more.
    around = {e["loc"][:n] for e in found for n in range(len(e["loc"]))}
    problems = [
        _describe(e["loc"], e["msg"], e["input"], e["type"])
        for e in found
        if e["loc"] not in around
    ]
    return "\n".join(f"{source}: {p}" for p in problems)


def validate(table: Mapping[str, Any], source: str, *, drawn: bool = True) -> Scenario:
    """Build a scenario from its table. Raises ScenarioError that lists every problem found.

    drawn: with the starts and obstacles that its seed draws.
    """
    try:
        found = Scenario.model_validate(table)
        return found.resolved() if drawn else found
    except ValidationError as error:
        raise ScenarioError(described(error, source)) from error
    except UntrustedCodeError as error:
        raise ScenarioError(f"{source}: {error}") from error


def from_json(text: str) -> Scenario:
    """Invert to_json. Raises ScenarioError with the first problem found."""
    try:
        return Scenario.model_validate_json(text)
    except ValidationError as error:
        first, *_ = described(error, "recorded scenario").split("\n")
        raise ScenarioError(first) from error
    except UntrustedCodeError as error:
        raise ScenarioError(f"recorded scenario: {error}") from error


def field_and_value(override: str) -> tuple[str, Any]:
    """Parse an override such as "network.loss=0.3" or "agents.0.clock.period=0.02".

    Raises ScenarioError if it has no "=".
    """
    path, separator, text = override.partition("=")
    if not separator:
        raise ScenarioError(f"--set {override}: expected path.to.field=value")
    return path.strip(), value_from(text)


def value_from(text: str) -> Any:
    """Read a value as TOML, but also .5 as a number; any other text is a string."""
    try:
        return _toml(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        pass
    try:  # TOML has no number that begins with a point
        return float(text)
    except ValueError:
        return text


def set_field(table: dict[str, Any], path: str, value: Any) -> None:
    """Set one field in place by its path. Raises ScenarioError if there is no such path."""
    keys = path.split(".")
    if not all(keys) or len(keys) > _DEEPEST:
        raise ScenarioError(f"--set {path[:80]}: expected path.to.field")
    node: Any = table
    for key in keys[:-1]:
        node = _step(node, key, path)
    if isinstance(node, list):
        node[_index(node, keys[-1], path)] = value
    else:
        node[keys[-1]] = value


def _step(node: Any, key: str, override: str) -> Any:
    if isinstance(node, list):
        return node[_index(node, key, override)]
    child = node.setdefault(key, {})
    if not isinstance(child, dict | list):
        raise ScenarioError(f"--set {override}: {key} is a value, not a table")
    return child


def _index(node: list[Any], key: str, override: str) -> int:
    if not key.isdecimal() or len(key) > 9 or int(key) >= len(node):
        got = f"expected an index from 0 to {len(node) - 1}, got {_short(key)}"
        raise ScenarioError(f"--set {override[:80]}: {got}")
    return int(key)


def _as_table(path: str, value: Any) -> Any:
    try:
        return as_table(value)
    except ValueError as error:
        raise ScenarioError(f"{path}: {error}") from error


def _parsed(source: str) -> dict[str, Any]:
    text = _read(source)
    try:
        return _toml(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{source}: not valid TOML: {error}") from error


def _toml(text: str) -> dict[str, Any]:
    """Parse TOML. Raises ValueError, RecursionError: no TOML, too deep, or too long to be shown."""
    if _DEEP_KEY.search(text):  # tomllib's time grows with the square of a key's parts
        raise ValueError(f"a key of more than {_DEEPEST} parts")
    return dict(_bounded(tomllib.loads(text)))


def _bounded(value: Any, depth: int = 0) -> Any:
    """Return a value of TOML. Raises ValueError: it is too deep, or too long, to be shown."""
    if depth > _DEEPEST or (isinstance(value, int) and value.bit_length() > _LONGEST):
        raise ValueError(f"more than {_DEEPEST} tables in one another, or {_LONGEST} bits")
    inside = value.values() if isinstance(value, dict) else value
    for each in inside if isinstance(value, dict | list) else ():
        _bounded(each, depth + 1)
    return value


def _read(source: str) -> str:
    path, known = Path(source), shipped()
    if source in known:
        return known[source].read_text(encoding="utf-8")
    looks_like_path = path.suffix == ".toml" or "/" in source
    if not looks_like_path and not path.exists():
        close = difflib.get_close_matches(source, known, n=1)
        listed = "`phalanx scenarios` lists those that ship"
        hint = f"did you mean {close[0]!r}?" if close else listed
        raise ScenarioError(f"{source}: no such scenario; {hint}")
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{source}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{source}: cannot be read: {error}") from error


def _describe(location: tuple[int | str, ...], message: str, got: Any, kind: str) -> str:
    if location[:1] == ("faults",) and location[2:3] and location[2] in KINDS:
        location = (*location[:2], *location[3:])
    field = ".".join(field_path(location)) or "scenario"
    expected = message.removeprefix("Value error, ").replace("Input should be", "expected")
    if kind in ("missing", "missing_argument") or message == "Field required":
        return f"{field}: expected a value, got nothing"
    if kind == "extra_forbidden" or message == "Unexpected keyword argument":
        return f"{field}: unknown field (misspelt, or retired?), got {_short(got)}"
    if kind in ("too_short", "too_long"):
        expected = f"expected{message.partition('have')[2].partition(' after')[0]}"
    if kind == "union_tag_invalid":
        expected = f"expected one of {message.rpartition(': ')[2]}"
    return f"{field}: {expected}, got {_short(got)}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def scenario_text(table: Mapping[str, Any]) -> str:
    """Return a scenario's table as TOML: numbers first, then a section for each table."""
    values = {k: v for k, v in table.items() if not isinstance(v, Mapping) and not _tables(v)}
    sections = [_lines(values)]
    for key, value in table.items():
        if isinstance(value, Mapping):
            sections.append(f"[{_key(key)}]\n{_lines(value)}")
        elif _tables(value):
            sections += [f"[[{_key(key)}]]\n{_lines(each)}" for each in value]
    return "\n".join(sections)


def inline(value: Any) -> str:
    """Return a value as TOML on one line."""
    if isinstance(value, Mapping):
        items = ", ".join(f"{_key(key)} = {inline(each)}" for key, each in value.items())
        return f"{{ {items} }}" if items else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(inline, value)) + "]"
    if isinstance(value, str):
        return _quoted(value)
    return json.dumps(value) if isinstance(value, bool) else str(value)


def _lines(table: Mapping[str, Any]) -> str:
    return "".join(f"{_key(key)} = {inline(value)}\n" for key, value in table.items())


def _tables(value: Any) -> bool:
    """Return whether a value is a list of tables that is not empty."""
    is_list = isinstance(value, list | tuple) and len(value) > 0
    return is_list and all(isinstance(each, Mapping) for each in value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _quoted(key)


def _quoted(text: str) -> str:
    # Unlike JSON, TOML has neither pairs of surrogates nor a bare DEL.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
