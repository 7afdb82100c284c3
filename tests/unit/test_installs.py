"""Commands of pages and messages that install Phalanx work: no package index has it."""

import re
import tomllib
from pathlib import Path

from phalanx.schema.extensions import HERE

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
FOLDERS = [
    "phalanx",
    "agent",
    "plant",
    "viewer",
    "docs",
    "examples",
    "scenarios",
    "tests",
    "bench",
    "evidence",
    "packages",
]
IGNORED = {"pyproject.toml", Path(__file__).name}
KINDS = {".py", ".md", ".toml", ".ipynb", ".html", ".yml", ".yaml"}
FROM_AN_INDEX = re.compile(
    rf"{PROJECT['name']}[\[=<>~]|pip3? install [^\n&;|]*\b{PROJECT['name']}\b"
)


def texts() -> dict[str, str]:
    files = [*ROOT.glob("*.md"), *(f for folder in FOLDERS for f in (ROOT / folder).rglob("*"))]
    read = [file for file in files if file.suffix in KINDS and file.name not in IGNORED]
    return {str(file.relative_to(ROOT)): file.read_text("utf-8") for file in read}


def test_nothing_says_to_install_phalanx_from_an_index():
    found = {name: FROM_AN_INDEX.findall(text) for name, text in texts().items()}
    assert {name: each for name, each in found.items() if each} == {}


def test_pages_and_messages_install_from_where_one_constant_says():
    pattern = re.compile(r"pip install (?:-e )?(?:'([^'\[]+)\[|([\w./{}-]+)/packages/phalanx-)")
    matches = {name: pattern.findall(text) for name, text in texts().items()}
    sources = {name: {"".join(pair) for pair in pairs} for name, pairs in matches.items() if pairs}
    assert {n: s for n, s in sources.items() if s - {HERE, "{HERE}"}} == {}
    assert len(sources) > 8


def test_every_extra_that_is_named_exists():
    pattern = re.compile(r"install (?:-e )?'\.\[([\w,-]+)\]'")
    matches = {name: pattern.findall(text) for name, text in texts().items()}
    extras = {extra for each in matches.values() for text in each for extra in text.split(",")}
    assert extras <= PROJECT["optional-dependencies"].keys()
    assert len(extras) > 2
