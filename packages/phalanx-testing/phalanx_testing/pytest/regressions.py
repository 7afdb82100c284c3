"""Regressions: scenarios of failed tests as files, with which the same tests are run again."""

import subprocess
import sys
from collections.abc import Iterator, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from phalanx.native.files import whole_file
from phalanx.scenario.load import scenario_text
from phalanx_testing import run

_TEST = "# test: "


def keep(folder: Path, table: Mapping[str, Any], test: str) -> Path:
    """Write the scenario in which a test failed, by its node id; return the file."""
    text = f"{_TEST}{test}\n\n{scenario_text(table)}"
    file = folder / f"{table['name']}-{sha256(text.encode()).hexdigest()[:8]}.toml"
    folder.mkdir(parents=True, exist_ok=True)
    with whole_file(file) as part:
        part.write_text(text, encoding="utf-8")
    return file


class RegressionFile(pytest.File):
    """A file of the folder of regressions."""

    def collect(self) -> Iterator["Regression"]:
        """Yield its one test."""
        yield Regression.from_parent(self, name=self.path.stem)


class Regression(pytest.Item):
    """A scenario, and the test that failed in it; without one, the claim that it is safe."""

    def runtest(self) -> None:
        """Run the test in a process of its own. Raises AssertionError, with what pytest says."""
        first, *_ = self.path.read_text(encoding="utf-8").splitlines() or [""]
        if not first.startswith(_TEST):
            run(self.path, engine=self.config.option.phalanx_engine or "in-process").assert_safe()
            return
        test = [first.removeprefix(_TEST), "--phalanx-scenario", str(self.path)]
        again = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *test],
            capture_output=True,
            text=True,
            cwd=self.config.rootpath,
        )
        if again.returncode:
            raise AssertionError(again.stdout + again.stderr)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> str:
        """Return why it failed, and how to repeat the run."""
        return f"{excinfo.value}\nreplay: phalanx run {self.path}"

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return file, line and name."""
        return self.path, 0, self.name
