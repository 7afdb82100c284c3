"""What an exported log says: the events, the assumptions that failed, and the verdict."""

from phalanx.guarantee.verdict import Outcome
from phalanx.recording.read import Recording
from phalanx.recording.records import Level, Log

_LEVELS = {
    Outcome.GUARANTEED: Level.INFO,
    Outcome.SAFE: Level.WARNING,
    Outcome.VIOLATED: Level.ERROR,
    Outcome.BROKEN: Level.ERROR,
    Outcome.STOPPED: Level.INFO,
}


def log_lines(recording: Recording) -> list[Log]:
    """Every line by time, the verdict last."""
    end = recording.states[-1].t if recording.states else 0.0
    summary = recording.summary
    if summary is None:
        verdict = Log(end, f"no verdict: {recording.unfinished}", Level.ERROR)
        return [*_by_time(recording.log), verdict]
    failed = [
        Log(a.first, f"failed: {a.name} ({a.failed} of {a.checked} checks)", Level.WARNING)
        for a in summary.assumptions
        if a.failed and a.first is not None
    ]
    told = f"{summary.outcome}: {summary.reason}"
    verdict = Log(max(summary.t, end), told, _LEVELS[summary.outcome])
    return [*_by_time([*recording.log, *failed]), verdict]


def _by_time(lines: list[Log]) -> list[Log]:
    return sorted(lines, key=lambda line: line.t)
