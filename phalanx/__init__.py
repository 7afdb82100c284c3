"""Phalanx: robot swarms that stay safe over a bad network while some of their members attack.

    import phalanx

    scenario = phalanx.load("unicycles", seed=7, overrides={"network.loss": 0.3})
    run = phalanx.run(scenario, engine="in-process")
    print(run.verdict, run.summary.worst_h)
    run.states  # a data frame: t, h_tot, and every agent's states

It implements Usevitch & Panagou, *Adversarial Resilience for Sampled-Data Systems under
High-Relative-Degree Safety Constraints*. Safe is ``h <= 0`` throughout.
"""

import ast
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from phalanx.faults.commands import Command, CommandKind, CommandPolicy
    from phalanx.guarantee.check import check
    from phalanx.guarantee.check_report import CheckReport
    from phalanx.guarantee.verdict import Assumption, Outcome, Summary, Violation
    from phalanx.launcher.engine import Engine, EngineError, RunOptions
    from phalanx.launcher.run import Run, run
    from phalanx.launcher.run import open_run as open
    from phalanx.launcher.stepped import SteppedRun, start
    from phalanx.launcher.verify import Verification, verify
    from phalanx.messages.kinds import Status
    from phalanx.recording import metrics
    from phalanx.recording.read import UnreadableRecordingError
    from phalanx.scenario.load import load, shipped
    from phalanx.scenario.model import Scenario, ScenarioError

__version__ = "0.4.0"

__all__ = [  # noqa: RUF022 - in the order of the documentation
    "load",
    "check",
    "run",
    "start",
    "open",
    "verify",
    "metrics",
    "Run",
    "RunOptions",
    "SteppedRun",
    "Scenario",
    "ScenarioError",
    "shipped",
    "CheckReport",
    "Engine",
    "EngineError",
    "Status",
    "Outcome",
    "Summary",
    "Assumption",
    "Violation",
    "Verification",
    "UnreadableRecordingError",
    "Command",
    "CommandKind",
    "CommandPolicy",
]
OF_PACKAGES = ("study", "open_study")
"""More public names: entry points of packages that may not be installed."""


@cache
def _homes(file: str) -> dict[str, tuple[str, str]]:
    """Return the module of each public name, and its name there, as a file's imports say."""
    tree = ast.walk(ast.parse(Path(file).read_text("utf-8")))
    imports = [(str(node.module), node.names) for node in tree if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name: (m, alias.name) for m, names in imports for alias in names}


def public_name(name: str, module: dict[str, Any]) -> Any:
    """Import a public name of a module when it is first used: some take a second."""
    if name not in module["__all__"]:
        raise AttributeError(f"module {module['__name__']!r} has no attribute {name!r}")
    from phalanx.schema.extensions import extras_named

    home, attribute = _homes(module["__file__"])[name]
    with extras_named():
        module[name] = getattr(__import__(home, fromlist=[attribute]), attribute)
    return module[name]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, or from the package that brings it."""
    if name in OF_PACKAGES:
        from phalanx.schema.extensions import extension

        return extension(name)
    return public_name(name, globals())


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *OF_PACKAGES})
