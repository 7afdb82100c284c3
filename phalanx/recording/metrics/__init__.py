"""Metrics of a run's task: how well and how soon, at what effort, how close to others."""

from phalanx.recording.metrics.measures import Thresholds
from phalanx.recording.metrics.table import METRICS, of

__all__ = ["METRICS", "Thresholds", "of"]
