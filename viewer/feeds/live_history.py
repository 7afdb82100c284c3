"""The past of a live run, gathered frame by frame."""

from itertools import chain

import numpy as np
from numpy.typing import NDArray

from phalanx.viewer.feeds.history import (
    History,
    TimeSeries,
    nan_if_none,
    shortest_and_median,
)
from phalanx.viewer.feeds.recent_paths import RecentPaths
from phalanx.viewer.scene.model import SceneModel
from phalanx.wire.frames import AgentStatus, Frame

Array = NDArray[np.float64]


class LiveHistory:
    """Time series and recent paths of the frames that were added."""

    def __init__(self, model: SceneModel) -> None:
        self._model = model
        self.history = History(TimeSeries(5 + len(model.psi_levels)), self._agent)
        self.recent_paths = RecentPaths(len(model.names))
        self._steps = TimeSeries(1 + 4 * len(model.names) + model.kinematics.inputs[-1].stop)
        """t; of every agent: backup, age, solve time, certified; all inputs."""
        self._backups = np.zeros(len(model.names))
        self._normal = model.swarm.normal
        self._taus = np.array([model.swarm.horizon(i) for i in self._normal])

    def add(self, frame: Frame) -> None:
        """Append what a frame says."""
        x = np.frombuffer(frame.x, dtype="<f8")
        positions = self._model.kinematics.poses(x).positions
        distance = self._model.smallest_distance(positions)
        psi = self._model.values.higher_psi(x)
        proven = np.array([[nan_if_none(frame.agents[i].certified) for i in self._normal]])
        horizons = shortest_and_median(proven / self._taus)[0]
        self.history.swarm.append(frame.t, frame.h_tot, distance, *horizons, *psi)
        self.recent_paths.add(frame.t, positions)
        self._add_steps(frame.t, frame.agents)

    def _add_steps(self, t: float, agents: tuple[AgentStatus, ...]) -> None:
        # A frame tells of each agent's last step alone. Its count of backups tells whether there
        # was one among the steps between two frames; it is plotted at the later frame.
        backups = np.array([status.backups for status in agents], dtype=float)
        if all(status.u for status in agents):
            self._steps.append(
                t,
                *(backups > self._backups),
                *[nan_if_none(status.age) for status in agents],
                *[status.solve_time for status in agents],
                *[nan_if_none(status.certified) for status in agents],
                *chain.from_iterable(status.u for status in agents),
            )
        self._backups = backups

    def _agent(self, i: int) -> Array:
        n, own = len(self._model.names), self._model.kinematics.inputs[i]
        inputs = range(1 + 4 * n + own.start, 1 + 4 * n + own.stop)
        columns = [0, *(1 + k * n + i for k in range(4)), *inputs]
        return np.asarray(self._steps.rows[:, columns])
