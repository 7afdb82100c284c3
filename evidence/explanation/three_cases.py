"""Three runs that end guaranteed with no robot at its goal, explained, and after what is advised.

    python -m evidence.explanation.three_cases

For each: what the explanation names, then arrivals and verdicts with each advised change, and with
the law `unstick` around the scenario's.
"""

from pathlib import Path
from typing import Any

from phalanx_explain import moments
from phalanx_explain.explanation import explain

import phalanx
from phalanx.launcher.run import Run
from phalanx.recording.metrics.table import in_words, metrics_of
from phalanx.recording.read import swarm_of

FOLDER = Path(__file__).parent


def main() -> None:
    for name in ("swap", "drives", "lagged"):
        path = FOLDER / f"{name}.toml"
        before = phalanx.run(path, engine="in-process")
        agent, t, _ = moments.stuck(before.recording)
        explanation = explain(before.recording, agent, t)
        print(f"\n{name}: {outcome(before)}", *explanation.sentences(), sep="\n")
        for change in explanation.advice or ():
            print(f"  with {', '.join(change.overrides)}: {outcome(after(path, change.overrides))}")
        law = dict(phalanx.load(path).agents[0].law)
        cure = {"agents.0.law": {"type": "unstick", "of": law}}
        print(f"  with the law unstick: {outcome(after(path, cure))}")


def after(path: Path, overrides: dict[str, Any]) -> Run:
    return phalanx.run(phalanx.load(path, overrides), engine="in-process")


def outcome(run: Run) -> str:
    """Describe the verdict and the task."""
    swarm = swarm_of(run.recording)
    normal = [swarm.names[i] for i in swarm.normal]
    return f"{run.verdict}, {in_words(metrics_of(run.recording, swarm), normal)}"


if __name__ == "__main__":
    main()
