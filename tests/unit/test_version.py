"""One version: of the package, its distributions, the citation and the newest changes."""

import re
import runpy
import shutil
import tomllib
from datetime import date
from pathlib import Path

import yaml

import phalanx

ROOT = Path(__file__).parents[2]
RELEASE = runpy.run_path(str(ROOT / ".ci" / "release.py"))
FILES = ("phalanx/__init__.py", "CITATION.cff", "CHANGELOG.md", *map(str, (
    file.relative_to(ROOT) for file in (ROOT / "packages").glob("*/pyproject.toml")
)))  # fmt: skip


def test_all_that_names_a_version_names_the_same():
    named = RELEASE["versions"](ROOT)
    assert named == {file: {phalanx.__version__} for file in FILES}


def test_packages_need_the_core_of_their_own_version():
    for file in (ROOT / "packages").glob("*/pyproject.toml"):
        project = tomllib.loads(file.read_text("utf-8"))["project"]
        (core,) = (d for d in project["dependencies"] if d.startswith("phalanx-swarm"))
        assert core.partition("==")[2] == project["version"] == phalanx.__version__


def test_a_release_is_written_everywhere_and_what_was_unreleased_is_its(tmp_path):
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    before = (tmp_path / "CHANGELOG.md").read_text("utf-8")
    RELEASE["write"](tmp_path, "12.3.45")
    assert RELEASE["versions"](tmp_path) == {file: {"12.3.45"} for file in FILES}
    after = (tmp_path / "CHANGELOG.md").read_text("utf-8")
    today = date.today()
    assert after.replace(f"\n## [12.3.45] - {today}\n", "", 1) == before
    assert re.search(r"## \[Unreleased\]\s+## \[12.3.45\][- \d]+\n\n\S", after)
    citation = yaml.safe_load((tmp_path / "CITATION.cff").read_text())
    assert (citation["version"], citation["date-released"]) == ("12.3.45", today)


def test_a_tag_is_published_only_if_it_is_the_version_and_all_tests_pass():
    workflow = yaml.safe_load((ROOT / ".github/workflows/release.yml").read_text("utf-8"))
    jobs = workflow["jobs"]
    assert workflow[True] == {"push": {"tags": ["v*"]}}  # YAML reads `on` as true
    assert ".ci/release.py --check" in str(jobs["build"])
    for name in ("index", "site", "image"):
        needed = jobs[name]["needs"]
        assert {"build", "test", "macos"} <= set(needed), name
    assert "macos" in jobs["macos"]["runs-on"]
