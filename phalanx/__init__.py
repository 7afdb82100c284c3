"""Phalanx: robot swarms that stay safe over a bad network while some of their members attack.

    import phalanx

    scenario = phalanx.load("unicycles", seed=7, overrides={"network.loss": 0.3})
    run = phalanx.run(scenario, engine="in-process")
    print(run.verdict, run.summary.worst_h)
    run.states  # a data frame: t, h_tot, and every agent's states

It implements Usevitch & Panagou, *Adversarial Resilience for Sampled-Data Systems under
High-Relative-Degree Safety Constraints*. Safe is ``h <= 0`` throughout.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from phalanx.faults.commands import Command, CommandKind, CommandPolicy
    from phalanx.guarantee.check import check
    from phalanx.guarantee.check_report import CheckReport
    from phalanx.guarantee.verdict import Assumption, Outcome, Summary, Violation
    from phalanx.launcher.engine import Engine, EngineError
    from phalanx.launcher.run import Run
    from phalanx.launcher.run import open_run as open
    from phalanx.launcher.run import verify_run as verify
    from phalanx.launcher.start import run
    from phalanx.launcher.stepped import SteppedRun, start
    from phalanx.launcher.verify import Verification
    from phalanx.messages.kinds import Status
    from phalanx.recording import metrics
    from phalanx.recording.read import UnreadableRecordingError
    from phalanx.scenario.load import ScenarioError, load, shipped
    from phalanx.scenario.model import Scenario
    from phalanx.studies.study import Study, open_study, study

__version__ = "0.3.0"

_HOMES = {
    "Assumption": "phalanx.guarantee.verdict",
    "CheckReport": "phalanx.guarantee.check_report",
    "Command": "phalanx.faults.commands",
    "CommandKind": "phalanx.faults.commands",
    "CommandPolicy": "phalanx.faults.commands",
    "Engine": "phalanx.launcher.engine",
    "EngineError": "phalanx.launcher.engine",
    "Outcome": "phalanx.guarantee.verdict",
    "Run": "phalanx.launcher.run",
    "Scenario": "phalanx.scenario.model",
    "ScenarioError": "phalanx.scenario.load",
    "Status": "phalanx.messages.kinds",
    "SteppedRun": "phalanx.launcher.stepped",
    "Study": "phalanx.studies.study",
    "Summary": "phalanx.guarantee.verdict",
    "UnreadableRecordingError": "phalanx.recording.read",
    "Verification": "phalanx.launcher.verify",
    "Violation": "phalanx.guarantee.verdict",
    "check": "phalanx.guarantee.check",
    "load": "phalanx.scenario.load",
    "metrics": "phalanx.recording.metrics:",
    "open": "phalanx.launcher.run:open_run",
    "run": "phalanx.launcher.start",
    "shipped": "phalanx.scenario.load",
    "open_study": "phalanx.studies.study",
    "start": "phalanx.launcher.stepped",
    "study": "phalanx.studies.study",
    "verify": "phalanx.launcher.run:verify_run",
}
"""The module of each public name, imported when the name is first used: some take a second."""

__all__ = [  # noqa: RUF022 - in the order of the documentation
    "load",
    "check",
    "run",
    "start",
    "open",
    "verify",
    "study",
    "open_study",
    "metrics",
    "Run",
    "SteppedRun",
    "Study",
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


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, colon, attribute = _HOMES[name].partition(":")
    from phalanx.schema.extensions import extras_named

    with extras_named():
        value = importlib.import_module(module)
    if attribute or not colon:  # else the package itself
        value = getattr(value, attribute or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
