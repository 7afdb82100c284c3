"""Regressions: scenarios of failed tests as files, each a test of the claim that failed."""

import inspect
import json
from collections.abc import Iterator, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from phalanx.files import whole_file
from phalanx.scenario.load import scenario_text
from phalanx.scenario.model import ScenarioError
from phalanx.testing import CheckedRun, run
from phalanx.testing.claims import Claim, ClaimError

_CLAIM = "# claim: "


def keep(folder: Path, table: Mapping[str, Any], claim: Claim) -> str:
    """Write a scenario as a regression; return its path, or why there is none."""
    try:
        arguments = json.dumps(dict(claim.arguments))
    except TypeError:
        return f"not kept: a file cannot hold the arguments of {claim.method}"
    text = f"{_CLAIM}{claim.method} {arguments}\n\n{scenario_text(table)}"
    name = f"{table['name']}-{sha256(text.encode()).hexdigest()[:8]}.toml"
    folder.mkdir(parents=True, exist_ok=True)
    with whole_file(folder / name) as part:
        part.write_text(text, encoding="utf-8")
    return str(folder / name)


def claim_of(file: Path) -> tuple[str, dict[str, Any]]:
    """Return the method and arguments of a regression's claim; without one, that it is safe.

    Raises ValueError: there is no such claim.
    """
    first, *_ = file.read_text(encoding="utf-8").splitlines() or [""]
    if not first.startswith(_CLAIM):
        return "assert_safe", {}
    method, _, arguments = first.removeprefix(_CLAIM).partition(" ")
    if not (method.startswith("assert_") and inspect.isfunction(vars(CheckedRun).get(method))):
        raise ValueError(f"{file}: expected a claim of CheckedRun, got {method}")
    return method, json.loads(arguments or "{}")


class RegressionFile(pytest.File):
    """A file of the folder of regressions."""

    def collect(self) -> Iterator["Regression"]:
        """Yield its one test."""
        yield Regression.from_parent(self, name=self.path.stem)


class Regression(pytest.Item):
    """A scenario, and the claim that it must keep."""

    def runtest(self) -> None:
        """Run the scenario. Raises ClaimError."""
        method, arguments = claim_of(self.path)
        finished = run(self.path, engine=self.config.option.phalanx_engine or "in-process")
        getattr(finished, method)(**arguments)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> str:
        """Return the claim that failed, and how to repeat the run."""
        expected = isinstance(excinfo.value, ClaimError | ScenarioError)
        why = str(excinfo.value) if expected else str(super().repr_failure(excinfo, style))
        return f"{why}\nreplay: phalanx run {self.path}"

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return file, line and name."""
        return self.path, 0, self.name
