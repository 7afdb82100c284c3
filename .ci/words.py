"""Check the words of docstrings, comments and pages, and names; with --count, count dialect.

A docstring begins with a verb or a noun phrase. Words that stop a reader who is new are banned,
in the names of tests too. At most MOST_BARE in 1000 names of a folder say no noun: a bare
participle, pronoun or determiner. Locals count where their function or comprehension is of more
than SHORT lines.
`--count FOLDER...` prints how often dialect occurs, to compare this project with others.
"""

import argparse
import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
SOURCES = (
    "phalanx", "agent", "plant", "viewer", "tests", "bench", "evidence", "examples", "packages",
)  # fmt: skip
PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs")

NO_FIRST_WORD = re.compile(
    r"(what|who|whom|whose|whoever|whatever|how|whether|which|when|where|why|that|those|if|of|from"
    r"|as|at|for|in|to|by|with)\b",
    re.IGNORECASE,
)
DIALECT = re.compile(
    r"\b(whoever|whomever|whosever|beside|besides|alike|told|somebody|everybody|nobody|anybody"
    r"|thereby|whence|anew|door|strikes?|struck|befalls?|befell|by and by|scribe|harness"
    r"|what (?:\w+ ){1,3}c[ao]mes? to|put to use"
    r"|lean(?:s|ed)? on)\b",
    re.IGNORECASE,
)
LONGEST = 25
BARE = re.compile(
    r"_*(found|made|given|taken|kept|left|seen|known|wanted|asked|told|said|shown|drawn|held|used"
    r"|sent|done|named|stated|gathered|placed|apart|alike|place|places|own|each|it|this|that|these"
    r"|those|one|ones|what|which|who|whose|another)_*"
)
"""Names that say no noun."""
SHORT = 5
"""Lines of a scope in which a local may have any name."""
MOST_BARE = 10
"""Most bare names in 1000 names of a folder."""


class Passage(NamedTuple):
    """A docstring, a comment, a test's name or a line of a page, and where it is."""

    path: Path
    line: int
    text: str
    docstring: bool = False


def python_passages(path: Path) -> Iterator[Passage]:
    source = path.read_text()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield Passage(path, node.body[0].lineno, text, docstring=True)
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            yield Passage(path, node.lineno, node.name.replace("_", " "))
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield Passage(path, token.start[0], token.string.lstrip("# "))


def page_passages(path: Path) -> Iterator[Passage]:
    """Return the lines of a page that are prose: no code, no table's rule, no front matter."""
    fenced = False
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif not fenced:
            yield Passage(path, number, re.sub(r"`[^`]*`|\]\([^)]*\)", " ", line))


def passages(folders: list[Path]) -> Iterator[Passage]:
    for folder in folders:
        for path in sorted([folder] if folder.is_file() else folder.rglob("*")):
            if path.suffix == ".py":
                yield from python_passages(path)
            elif path.suffix == ".md":
                yield from page_passages(path)


def faults_of(passage: Passage) -> Iterator[str]:
    if passage.docstring and (first := NO_FIRST_WORD.match(passage.text)):
        yield f"a docstring begins with a verb or a noun phrase, not with {first.group()!r}"
    for word in DIALECT.findall(passage.text):
        yield f"{word!r}: say it in plainer words"


def bound_names(node: ast.AST, long_scope: bool = True) -> Iterator[tuple[str, int]]:
    """Yield the names that a syntax tree binds, each with its line; no locals of short scopes."""
    match node:
        case (ast.FunctionDef() | ast.AsyncFunctionDef() | ast.Lambda()) | (
            ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp()
        ):
            long_scope = (node.end_lineno or node.lineno) - node.lineno >= SHORT
    match node:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
            yield name, node.lineno
        case ast.Attribute(attr=name, ctx=ast.Store()) | ast.arg(arg=name):
            yield name, node.lineno
        case ast.Name(id=name, ctx=ast.Store()) if long_scope:
            yield name, node.lineno
    for child in ast.iter_child_nodes(node):
        yield from bound_names(child, long_scope)


def print_bare_names(folder: Path) -> bool:
    """Print the bare names of a folder if they are too many; return whether they are."""
    names = [
        (path, line, name)
        for path in sorted(folder.rglob("*.py"))
        for name, line in bound_names(ast.parse(path.read_text()))
    ]
    bare = [entry for entry in names if BARE.fullmatch(entry[2])]
    share = 1000 * len(bare) / max(len(names), 1)
    if share <= MOST_BARE:
        return False
    for path, line, name in bare:
        print(f"{path.relative_to(ROOT)}:{line}: {name!r}: a name says what it is, by a noun")
    print(f"{folder.name}: {share:.1f} of 1000 names are bare, where {MOST_BARE} are allowed")
    return True


def print_count(found: list[Passage]) -> None:
    words: Counter[str] = Counter()
    total = sentences = long = docstrings = first = 0
    for passage in found:
        total += len(re.findall(r"[A-Za-z'-]+", passage.text))
        words.update(word.lower() for word in DIALECT.findall(passage.text))
        docstrings += passage.docstring
        first += passage.docstring and bool(NO_FIRST_WORD.match(passage.text))
        for sentence in re.split(r"[.:;?!](?:\s|$)|\n\n", passage.text):
            sentences += bool(sentence.strip())
            long += len(sentence.split()) > LONGEST
    dialect = sum(words.values())
    print(f"{total} words, {dialect} of dialect: {1000 * dialect / max(total, 1):.2f} in 1000")
    print(f"{docstrings} docstrings, {first} begin with neither a verb nor a noun phrase")
    print(f"{sentences} sentences, {long} of more than {LONGEST} words")
    print(", ".join(f"{word} {count}" for word, count in words.most_common(15)))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", nargs="*", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    if options.count is not None:
        print_count(list(passages(options.count or [ROOT / name for name in (*SOURCES, *PAGES)])))
        return 0
    wrong = 0
    for passage in passages([ROOT / name for name in (*SOURCES, *PAGES)]):
        for fault in faults_of(passage):
            print(f"{passage.path.relative_to(ROOT)}:{passage.line}: {fault}")
            wrong += 1
    too_many = [print_bare_names(ROOT / name) for name in SOURCES]
    return int(wrong > 0 or any(too_many))


if __name__ == "__main__":
    raise SystemExit(main())
