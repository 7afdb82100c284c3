"""One version: of the distribution, the package and the newest entry of the changelog."""

import re
import tomllib
from pathlib import Path

import phalanx

ROOT = Path(__file__).parents[2]


def test_package_distribution_and_changelog_have_one_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    newest = re.search(r"^## \[(\d.*?)\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert newest
    assert phalanx.__version__ == project["version"] == newest[1]
