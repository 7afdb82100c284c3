"""The past of a recording as the report needs it: as arrays, and its records."""

from phalanx.curves.history import RecordedHistory
from phalanx.curves.values import SafetyValues
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm


class ReportHistory(RecordedHistory):
    """The past of a recording, with its records."""

    def __init__(self, recording: Recording, values: SafetyValues | None = None) -> None:
        """Build the recorded scenario's rows unless `values` are given. Raises ScenarioError."""
        values = values or SafetyValues(build_rows(build_swarm(recording.scenario)))
        super().__init__(recording, values)
        self.recording = recording
        self.steps = list(steps_by_agent(recording).values())
        """Recorded control steps of each agent."""
