"""Agents' reports on control steps, as tests make them."""

from phalanx.messages.kinds import Telemetry
from phalanx.messages.step_report import StepReport
from phalanx.theory.rows.origin import Origin

STEP = StepReport(origin=Origin.QP, residual=0.0, u_nom=(0.0, 0.0), solve_time=0.0)


def report(k: int, step: StepReport = STEP, **fields) -> Telemetry:
    """Return a report on a control step, by default one that a QP made."""
    return Telemetry(k=k, report=step, **{"ages": (), **fields})
