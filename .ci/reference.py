"""Write into pages what a code host cannot: names of modules, and files in titled blocks of code.

The docs site makes the rest of the reference from docstrings. Of a package there is a line for each
of its files; of a module with `__all__` one for each name.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = ROOT / "docs"
BEGIN, END = "<!-- names, by .ci/reference.py -->", "<!-- end of names -->"
LIST = re.compile(f"{re.escape(BEGIN)}.*?{re.escape(END)}\n\n", re.DOTALL)
DIRECTIVE = re.compile(r"^::: (phalanx[\w.]*)$", re.MULTILINE)
SHOWN = re.compile(r'^(```\w+ title="([^"]+)"\n).*?^```$', re.DOTALL | re.MULTILINE)

Docstrings = dict[str, str]
"""First sentences by name."""


def file_of(module: str) -> Path:
    parts = module.split(".")
    top = next((p for p in (ROOT / "packages").iterdir() if (p / parts[0]).is_dir()), ROOT)
    path = top.joinpath(*parts)
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def sentence(docstring: str | None) -> str:
    """Return the first sentence on one line; characters that Markdown would take are in code."""
    first, *_ = re.split(r"(?<=\.)\s+(?=[A-Z])|\n\n", docstring or "", maxsplit=1)
    plain = " ".join(first.split()).replace("``", "`")
    return re.sub(r"(?<!`)(\b\w*[_*<>]\w*\b)(?![`(])", r"`\1`", plain)


@cache
def parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_text("utf-8"))


def docstrings(file: Path) -> Docstrings:
    """Return the first sentences of a module's public names that have a docstring."""
    found: Docstrings = {}
    body = parsed(file).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found[node.name] = sentence(ast.get_docstring(node))
        elif isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(after, ast.Expr):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if isinstance(target, ast.Name) and isinstance(after.value, ast.Constant):
                found[target.id] = sentence(str(after.value.value))
    return {name: text for name, text in found.items() if text and not name.startswith("_")}


def exported(file: Path) -> Iterator[str]:
    """Yield a line for each name that a module imports and lists in `__all__`, in that order."""
    homes: dict[str, str] = {}
    names: list[str] = []
    for node in ast.walk(parsed(file)):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("phalanx"):
            for alias in node.names:
                home = file_of(f"{node.module}.{alias.name}")
                if home.is_file():
                    text = sentence(ast.get_docstring(parsed(home)))
                else:
                    text = docstrings(file_of(str(node.module))).get(alias.name, "")
                homes[alias.asname or alias.name] = text
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            names = ast.literal_eval(node.value)
    yield from (f"- `{name}`: {homes[name]}" for name in names)


def listed(module: str) -> Iterator[str]:
    """Yield the lines of a module, or of a package's files."""
    file = file_of(module)
    if module in ("phalanx", "phalanx.extend"):
        yield from exported(file)
        return
    folder = file.parent if file.name == "__init__.py" else None
    for each in sorted(folder.rglob("*.py")) if folder else [file]:
        names = ", ".join(f"`{name}`" for name in docstrings(each))
        text = sentence(ast.get_docstring(parsed(each)))
        if names:
            yield f"- `{each.relative_to(ROOT)}`: {text} {names}"


def with_names(page: str) -> str:
    """Return a page of the reference with the names of the modules that it is about."""
    bare = LIST.sub("", page)
    lines = [line for module in DIRECTIVE.findall(bare) for line in listed(module)]
    at = DIRECTIVE.search(bare)
    assert at is not None
    text = "\n".join([BEGIN, "", *lines, "", END])
    return f"{bare[: at.start()]}{text}\n\n{bare[at.start() :]}"


def with_files(page: str) -> str:
    """Return a page whose blocks of code that have a file's path as title have its text."""
    return SHOWN.sub(lambda block: f"{block[1]}{(ROOT / block[2]).read_text('utf-8')}```", page)


def main() -> None:
    for page in sorted((PAGES / "reference").glob("*.md")):
        page.write_text(with_names(page.read_text("utf-8")), "utf-8")
    for page in sorted(PAGES.glob("*.md")):
        page.write_text(with_files(page.read_text("utf-8")), "utf-8")


if __name__ == "__main__":
    main()
