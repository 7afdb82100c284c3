"""Installed libraries: the tested versions, pinned by hashes; and from where, without any index."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from phalanx.schema.extensions import HERE

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
FOLDERS = ["phalanx", "agent", "plant", "viewer", "docs", "examples", "scenarios", "tests",
           "bench", "evidence", "packages"]  # fmt: skip
IGNORED = {"pyproject.toml", Path(__file__).name}
KINDS = {".py", ".md", ".toml", ".ipynb", ".html", ".yml", ".yaml"}
BESIDE = sorted((ROOT / "packages").glob("*/pyproject.toml"))
PACKAGES = {file.parent.name for file in BESIDE}
PIP = re.compile(r"pip install ([^`|\n]*(?:\n {10,}.*)*)")
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


def test_a_package_is_installed_together_with_those_that_it_needs():
    projects = [tomllib.loads(file.read_text("utf-8"))["project"] for file in BESIDE]
    needed = {
        p["name"]: PACKAGES & {Requirement(d).name for d in p["dependencies"]} for p in projects
    }
    for line in (line for text in texts().values() for line in PIP.findall(text)):
        named = set(re.findall(r"packages/(phalanx-[a-z]\w*)", line))
        assert named >= set().union(*(needed.get(name, set()) for name in named)), line


def test_every_extra_that_is_named_exists():
    pattern = re.compile(r"install (?:-e )?'\.\[([\w,-]+)\]'")
    matches = {name: pattern.findall(text) for name, text in texts().items()}
    extras = {extra for each in matches.values() for text in each for extra in text.split(",")}
    assert extras <= PROJECT["optional-dependencies"].keys()
    assert len(extras) > 2


PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
LOCKS = {"image": ("view",), "all": ("test", "docs")}


def locked(name: str) -> dict[str, tuple[str, int]]:
    """The version and the number of hashes of each project in a lock."""
    text = (ROOT / "locks" / f"{name}.txt").read_text()
    assert not re.search(r"://|index|\s-[^-]|--(?!hash=sha256:[0-9a-f]{64}\b)", text)
    entries = text.replace("\\\n", " ").splitlines()
    pins = [re.fullmatch(r"(\S+)==(\S+)( ; .*?)?((\s+--hash=\S+)+)\s*", line) for line in entries]
    assert all(pins), [line for line, match in zip(entries, pins, strict=True) if not match]
    return {match[1]: (match[2], len(match[4].split())) for match in pins if match}


def pinned() -> dict[str, str]:
    """The versions of constraints.txt."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()[1:]
    return {
        canonicalize_name(name): version for name, _, version in (x.partition("==") for x in lines)
    }


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_has_the_tested_versions_of_all_that_is_needed(name: str) -> None:
    versions = {project: version for project, (version, _) in locked(name).items()}
    assert versions.items() <= pinned().items(), "else: make locks"
    extras = PYPROJECT["project"]["optional-dependencies"]
    requirements = [*PYPROJECT["project"]["dependencies"], *PYPROJECT["build-system"]["requires"]]
    if name == "all":
        beside = [tomllib.loads(file.read_text())["project"]["dependencies"] for file in BESIDE]
        assert all(beside)
        requirements += [text for texts in beside for text in texts]
    for text in (*requirements, *(each for extra in LOCKS[name] for each in extras[extra])):
        needed = Requirement(text)
        if needed.name not in ("phalanx-swarm", "phalanx-studies"):
            assert needed.specifier.contains(versions[canonicalize_name(needed.name)]), text


@pytest.mark.parametrize("file", ["Dockerfile", "Makefile"])
def test_nothing_is_installed_without_its_hash(file: str) -> None:
    """But Phalanx itself, which brings nothing along."""
    installs = re.findall(r"pip install (.*)", (ROOT / file).read_text())
    first, phalanx_install = installs
    assert "--require-hashes" in first
    assert {"--no-deps", "--no-build-isolation"} <= set(phalanx_install.split())
