"""Small changes of a room's code, drawn by a seed: Cosmic Ray's operators, and four of our own.

mutmut was not chosen: its third version skips decorated functions, and wants to run the tests.
Nothing is changed in annotations, in texts of errors, and in f-strings.
"""

import random
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from difflib import SequenceMatcher
from itertools import permutations, zip_longest
from typing import Any, NamedTuple

import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator

from tests.hostile.mutants import ROOT
from tests.hostile.rooms import SEED, Room

EQUIVALENT = ROOT / "tests/hostile/equivalent_mutants.toml"

Node = Any  # parso has no base class of nodes that have a parent, a type and positions
Position = tuple[tuple[int, int], tuple[int, int]]


class _InPlace(Operator):
    """An operator that puts one text in the place of a node of the syntax."""

    def replacement(self, node: Node) -> tuple[Node, str] | None:
        """Return a part of the node and what replaces it, if the operator applies to the node."""
        raise NotImplementedError

    def mutation_positions(self, node: Node) -> Iterator[Position]:
        if change := self.replacement(node):
            yield change[0].start_pos, change[0].end_pos

    def mutate(self, node: Node, index: int) -> Node:
        part, text = self.replacement(node)
        new = parso.parse(part.get_first_leaf().prefix + text)
        if part is node:
            return new
        node.children[node.children.index(part)] = new
        return node

    @classmethod
    def examples(cls) -> tuple[()]:
        return ()


class Never(_InPlace):
    """A guard that never holds: what developers forget, and AddNot does not show."""

    def replacement(self, node: Node) -> tuple[Node, str] | None:
        position = {"if_stmt": 1, "test": 2, "comp_if": 1}.get(node.type)
        return None if position is None else (node.children[position], "False")


_PAIRS = (
    ("min", "max"), ("any", "all"), ("minimum", "maximum"), ("floor", "ceil"),
    ("lower", "upper"), ("in", "not in"),
)  # fmt: skip
_OTHER = {one: other for pair in _PAIRS for one, other in permutations(pair)}


class Opposite(_InPlace):
    """The other of two functions, or of two operators, that Cosmic Ray does not replace."""

    def replacement(self, node: Node) -> tuple[Node, str] | None:
        is_part = node.parent and node.parent.type in ("for_stmt", "sync_comp_for", "comp_op")
        is_word = node.type in ("name", "keyword", "comp_op") and not is_part
        other = _OTHER.get(" ".join(node.get_code(False).split())) if is_word else None
        return (node, other) if other else None


class Dropped(_InPlace):
    """A call whose result is not used, left out."""

    def replacement(self, node: Node) -> tuple[Node, str] | None:
        statement = node.children[0] if node.type == "simple_stmt" else None
        is_call = statement and statement.type in ("atom_expr", "power")
        return (statement, "pass") if is_call and statement.children[-1].type == "trailer" else None


class Uncaught(_InPlace):
    """An error that a handler catches no more. Cosmic Ray's fails at names with dots."""

    def replacement(self, node: Node) -> tuple[Node, str] | None:
        clause = node.parent
        while clause and clause.type in ("atom", "testlist_comp"):
            clause = clause.parent
        is_caught = clause and clause.type == "except_clause" and node.type in ("name", "atom_expr")
        is_caught = is_caught and node.end_pos <= clause.children[1].end_pos
        return (node, "StopAsyncIteration") if is_caught else None


_ORDER = ("Eq", "NotEq", "Lt", "LtE", "Gt", "GtE")
_BINARY = (
    "Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Mul", "Mod_Mul", "Pow_Mul",
    "BitOr_BitAnd", "BitAnd_BitOr", "LShift_RShift", "RShift_LShift",
)  # fmt: skip
"""Others raise TypeError in most places, which would count as noticed."""
_NAMES = (
    *(f"ReplaceBinaryOperator_{pair}" for pair in _BINARY),
    *(f"ReplaceComparisonOperator_{a}_{b}" for a, b in permutations(_ORDER, 2)),
    *(f"ReplaceComparisonOperator_{pair}" for pair in ("Is_IsNot", "IsNot_Is")),
    *(f"ReplaceUnaryOperator_Delete_{sign}" for sign in ("USub", "Invert", "Not")),
    *("ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd"),
    *("ReplaceBreakWithContinue", "ReplaceContinueWithBreak"),
    *("AddNot", "NumberReplacer", "ZeroIterationForLoop"),
)
OPERATORS: tuple[Operator, ...] = (
    *(get_operator(f"core/{name}")() for name in _NAMES),
    *(Never(), Opposite(), Dropped(), Uncaught()),
)


class Change(NamedTuple):
    """An operator, and which of the places of a file where it applies."""

    file: str
    operator: Operator
    occurrence: int

    def text(self) -> str:
        """The whole file, changed."""
        source = (ROOT / self.file).read_text("utf-8")
        return mutate_code(source, self.operator, self.occurrence)


def drawn(name: str, room: Room, number: int) -> list[Change]:
    """Draw positions in the room's files, and one change for each; then a second, and so on."""
    draw = random.Random(f"{SEED} {name}")
    files = sorted({str(f.relative_to(ROOT)) for p in room.sources for f in ROOT.glob(p)})
    positions = [draw.sample(c, len(c)) for file in files for c in _by_position(file)]
    draw.shuffle(positions)
    return [c for turn in zip_longest(*positions) for c in turn if c][:number]


def _by_position(file: str) -> Iterable[list[Change]]:
    """All changes of a file, together where they change the same part."""
    counts = [0] * len(OPERATORS)
    changes: dict[Position, list[Change]] = defaultdict(list)
    # The order in which mutate_code counts.
    for node in ast_nodes(get_ast((ROOT / file).read_text("utf-8"))):
        for i, operator in enumerate(OPERATORS):
            for position in operator.mutation_positions(node):
                if not _is_left_out(node):
                    changes[position].append(Change(file, operator, counts[i]))
                counts[i] += 1
    return changes.values()


def _is_left_out(node: Node) -> bool:
    """Return whether a node belongs to an annotation, an error's text or what only mypy reads."""
    while parent := node.parent:
        if parent.type in ("fstring", "raise_stmt", "tfpdef"):
            return True
        if parent.type == "argument" and parent.children[0].get_code().strip() == "frozen":
            return True
        if parent.type == "annassign" and parent.children[1] is node:
            return True
        if parent.type == "funcdef" and parent.annotation is node:
            return True
        if parent.type == "file_input" and node.type == "simple_stmt" and "|" in node.get_code():
            return True  # a name for a type
        if node.type == "if_stmt" and node.children[1].get_code().strip() == "TYPE_CHECKING":
            return True
        node = parent
    return False


class Place(NamedTuple):
    """The lines that differ, without their indents."""

    number: int
    old: str
    new: str


def difference(old: str, new: str) -> Place:
    """The first line that differs, and all lines that do."""
    a, b = old.splitlines(), new.splitlines()
    blocks = [c for c in SequenceMatcher(None, a, b, False).get_opcodes() if c[0] != "equal"]
    olds = [a[i].strip() for _, start, end, _, _ in blocks for i in range(start, end)]
    news = [b[i].strip() for *_, start, end in blocks for i in range(start, end)]
    return Place(blocks[0][1] + 1, "\n".join(olds), "\n".join(news))


def equivalents() -> list[dict[str, str]]:
    """Return mutants that no test can notice: their file, line, what it becomes, and why."""
    return tomllib.loads(EQUIVALENT.read_text("utf-8"))["mutant"]
