"""Write the version of a release into every file that names it.

python .ci/release.py 0.4.0            # then look at the change, commit it, and tag it v0.4.0
python .ci/release.py --check v0.4.0   # whether a tag is the version of this folder

The day of the release is today.
"""

import argparse
import re
from datetime import date
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_NUMBER = r"\d+\.\d+\.\d+"
PLACES = {
    "phalanx/__init__.py": rf'(?<=^__version__ = "){_NUMBER}',
    "CITATION.cff": rf"(?<=^version: ){_NUMBER}",
    "packages/*/pyproject.toml": rf'((?<=^version = ")|(?<=[ms\]]==)){_NUMBER}',
}
"""Where the version stands, by patterns of files."""
UNRELEASED = "## [Unreleased]\n"


def versions(root: Path) -> dict[str, set[str]]:
    """Return the versions that each file names, in the changelog the newest."""
    named = {
        str(file.relative_to(root)): {match[0] for match in _found(pattern, file)}
        for files, pattern in PLACES.items()
        for file in sorted(root.glob(files))
    }
    newest = re.search(rf"^## \[({_NUMBER})\]", (root / "CHANGELOG.md").read_text("utf-8"), re.M)
    return {**named, "CHANGELOG.md": {newest[1]} if newest else set()}


def _found(pattern: str, file: Path) -> list[re.Match[str]]:
    return list(re.finditer(pattern, file.read_text("utf-8"), re.MULTILINE))


def write(root: Path, version: str) -> None:
    """Write a version everywhere; what is unreleased in the changelog becomes its."""
    for files, pattern in PLACES.items():
        for file in root.glob(files):
            text = file.read_text("utf-8")
            file.write_text(re.sub(pattern, version, text, flags=re.MULTILINE), "utf-8")
    log = root / "CHANGELOG.md"
    text = log.read_text("utf-8")
    today = date.today().isoformat()
    heading = f"{UNRELEASED}\n## [{version}] - {today}\n"
    log.write_text(text.replace(UNRELEASED, heading, 1), "utf-8")
    citation = root / "CITATION.cff"
    dated = re.sub(r"(?m)(?<=^date-released: ).*", today, citation.read_text("utf-8"))
    citation.write_text(dated, "utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("version", nargs="?")
    parser.add_argument("--check", metavar="TAG")
    options = parser.parse_args()
    if options.version:
        write(ROOT, options.version)
    every = versions(ROOT)
    wanted = {options.check.removeprefix("v")} if options.check else every["phalanx/__init__.py"]
    wrong = {file: named for file, named in every.items() if named != wanted}
    for file, named in wrong.items():
        print(f"{file}: expected {', '.join(wanted)}, got {', '.join(sorted(named)) or 'none'}")
    return int(bool(wrong))


if __name__ == "__main__":
    raise SystemExit(main())
