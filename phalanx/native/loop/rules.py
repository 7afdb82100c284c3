"""The link rules of a run as tables for links.c: which rule, its numbers, its keys of draws."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from phalanx.network.delay import (
    ConstantDelay,
    DelayFloor,
    JitteredDelay,
    Rate,
    Reorder,
    Slot,
    UniformDelay,
    quantile_table,
)
from phalanx.network.draws import key_of
from phalanx.network.link import Stage
from phalanx.network.loss import Bursts, Corrupt, DistanceLoss, Duplicate, RandomLoss
from phalanx.network.rule import BASIC, Rule
from phalanx.network.trace import Trace
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.user_methods import is_built_in

_NUMBERS, _COPIES = 6, 2
MOST_DECLARED = 64
"""Bits of a fate's faults."""


class RuleEntry(NamedTuple):
    """A rule as links.c has it."""

    number: int
    """Among those of links.c, in this order."""
    numbers: Sequence[float] = ()
    purpose: str | None = None
    """Of its draws."""
    table: Sequence[float] = ()


def entry_of(rule: Rule) -> RuleEntry | None:
    """Return a rule's entry; None if links.c has no such rule."""
    match rule:
        case RandomLoss(probability=p):
            return RuleEntry(0, [p], BASIC)
        case Bursts():
            both, either = sorted((rule.p, 1.0 - rule.r))
            first, swaps = rule.p / (rule.p + rule.r), rule.p > 1.0 - rule.r
            return RuleEntry(1, [both, either, first, swaps], "state of the link")
        case DistanceLoss(none_within=near, all_beyond=far):
            return RuleEntry(2, [near, far - near], "distance")
        case Duplicate(probability=p):
            return RuleEntry(3, [p], "duplicate")
        case Corrupt(probability=p):
            return RuleEntry(4, [p], "corrupt")
        case ConstantDelay(time=time):
            return RuleEntry(5, [time])
        case UniformDelay(low=low, high=high):
            return RuleEntry(6, [low, high - low], BASIC)
        case JitteredDelay(distribution=kind):
            table = () if kind == "uniform" else quantile_table(kind).tolist()
            numbers = [rule.time, rule.jitter, rule.correlation, bool(table)]
            return RuleEntry(7, numbers, BASIC, table)
        case DelayFloor(time=time, per_metre=per_metre):
            return RuleEntry(8, [time, per_metre])
        case Reorder(probability=p, gap=gap):
            return RuleEntry(9, [p, gap], "reorder")
        case Rate():
            return RuleEntry(10, [rule.takes, rule.longest_wait])
        case Slot(every=every):
            return RuleEntry(11, [every])
        case Trace(t=t, delay=delay):
            return RuleEntry(12, [len(t)], None, [*t, *delay, rule.period])
    return None


def has_entries(stages: Sequence[Stage]) -> bool:
    """Return whether links.c knows all rules of a link, and makes no more copies than it counts."""
    doubles = sum(isinstance(stage.rule, Duplicate) for stage in stages)
    known = all(is_built_in(stage.rule) and entry_of(stage.rule) for stage in stages)
    return known and 2**doubles <= _COPIES


def rule_tables(swarm: Swarm) -> dict[str, Any]:
    """Return the tables of all links: those that run.h declares from stage_at to left."""
    names, at, by_distance = swarm.names, [0], list[bool]()
    stages, keys, table_at, table = list[Stage](), list[int](), list[int](), list[float]()
    rules, numbers = list[int](), list[float]()
    for i, receiver in enumerate(names):
        heard = set(swarm.heard_by(i))
        for j, sender in enumerate(names):
            model = swarm.links.model(sender, receiver).stages if j in heard else ()
            by_distance.append(any(getattr(s.rule, "asks_distance", False) for s in model))
            for stage in model:
                entry = entry_of(stage.rule)
                assert entry is not None
                stages.append(stage)
                rules.append(entry.number)
                numbers += [*entry.numbers, *[0.0] * (_NUMBERS - len(entry.numbers))]
                table_at.append(len(table))
                table += entry.table
                keys += _keys(swarm.seed, entry.purpose, sender, receiver)
            at.append(len(stages))
    return {
        "stage_at": at,
        "by_distance": by_distance,
        "rule": rules,
        "declared": [stage.declared for stage in stages],
        "number": numbers,
        "key": keys,
        "table_at": table_at,
        "table": table,
        "left": [float("-inf")] * len(stages),
    }


def _keys(seed: int, purpose: str | None, *ends: str) -> list[int]:
    """Return for each copy of a message the key of its draws, and of those that decide on them."""
    words: list[int] = []
    for copy in range(_COPIES):
        name = purpose or ""
        if copy and purpose != "state of the link":
            name = f"{name} of copy {copy}"
        for table in (name, f"{name} kept"):
            words += words_of(key_of(seed, ("link", *ends, table) if table else ("link", *ends)))
    return words


def words_of(key: int) -> tuple[int, int]:
    """Return a key as two words."""
    return key & 0xFFFFFFFFFFFFFFFF, key >> 64
