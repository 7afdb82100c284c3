"""phalanx.parallel_env: a scenario as an environment for learned agents."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from phalanx.extensions.registered import extension
from phalanx.scenario.model import Scenario


def parallel_env(
    scenario: Scenario | str | Path,
    *,
    acting: str | Iterable[str] = "attackers",
    every: float | None = None,
) -> Any:
    """Return a scenario as PettingZoo's ParallelEnv, in which some agents' inputs are the actions.

    It runs in this process, at the speed of the in-process engine.

    Args:
        scenario: as load returns it, or a file or name that load takes.
        acting: "attackers", "defenders", "both", or names of agents. A defender's action is its
            nominal input, which the scenario's filter or controller makes safe.
        every: virtual time of a step [s]; by default the shortest period of an acting agent.

    Returns:
        A phalanx.learning.env.SwarmEnv.

    Raises:
        ImportError: PettingZoo is not installed.
        ScenarioError: the scenario cannot be run.
        ValueError: no agent acts, or none has that name; or a step is not above 0.
    """
    try:
        env = extension("parallel-env")
    except ModuleNotFoundError as error:
        raise ImportError(
            f"{error.name} is not here: pip install 'phalanx-swarm[pettingzoo]'"
        ) from error
    return env(scenario, acting=acting, every=every)
