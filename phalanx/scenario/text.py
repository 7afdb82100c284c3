"""Scenarios as TOML text that a person reads: short tables and lists stay on one line."""

import json
import re
from collections.abc import Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")


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
    return json.dumps(value) if isinstance(value, str | bool) else str(value)


def _lines(table: Mapping[str, Any]) -> str:
    return "".join(f"{_key(key)} = {inline(value)}\n" for key, value in table.items())


def _tables(value: Any) -> bool:
    """Return whether a value is a list of tables that is not empty."""
    is_list = isinstance(value, list | tuple) and len(value) > 0
    return is_list and all(isinstance(each, Mapping) for each in value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else json.dumps(key)
