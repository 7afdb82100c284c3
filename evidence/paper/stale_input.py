"""False certificates: how often, and how far, a row held that did not hold jointly.

    python evidence/paper/stale_input.py                                  # two agents
    python evidence/paper/stale_input.py --scenario unicycles --seeds 2 --models paper,in-flight

After each update the recording says which inputs are in force; with them
J = Σ drift + Σ_N c_l u_l + Σ_A max c_j u + α_q(ψ_{q-1}) + η must not be above 0. An update is a
false certificate if its row held and J > 0; where every agent keeps its share, if all their rows
held. J <= η means that sampling and disturbance are left with less margin than asked for, but the
condition itself held.

The table has the worst J of certified steps by delay and information model, over all losses and
seeds, and in parentheses how many certificates were false and how many of these had J > η.
"""

import argparse
import itertools
from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from variants import simulated

from phalanx.recording.read import Recording
from phalanx.recording.records import Step
from phalanx.schema.built_in import BUILT_IN
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.information import Information
from phalanx.theory.rows.row import Terms

ROUNDING = 1e-4
"""What solvers leave of a row."""


class Certificates(NamedTuple):
    """Counts of certified and false steps."""

    steps: int
    certified: int
    """Updates whose row held; with shares, after which every agent's row had held."""
    false: int
    """Of these, those with J > 0."""
    short: int
    """Of these, those with J > η."""
    worst: float
    """Largest J at a certified update."""

    def joined(self, other: "Certificates") -> "Certificates":
        """Add the counts of both."""
        return Certificates(
            self.steps + other.steps,
            self.certified + other.certified,
            self.false + other.false,
            self.short + other.short,
            max(self.worst, other.worst),
        )


NONE = Certificates(0, 0, 0, 0, -np.inf)


def main() -> None:
    """Run every combination and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--scenario", default="stale-inputs")
    arguments.add_argument("--models", default=",".join(BUILT_IN[Information]))
    arguments.add_argument("--delays", default="0.0,0.002,0.005,0.02,0.1", help="[s]")
    arguments.add_argument("--losses", default="0.0,0.1,0.3")
    arguments.add_argument("--seeds", type=int, default=1)
    arguments.add_argument("--set", action="append", default=[], dest="overrides")
    options = arguments.parse_args()
    models, delays, losses = (
        getattr(options, axis).split(",") for axis in ("models", "delays", "losses")
    )
    sums: dict[tuple[str, str], Certificates] = defaultdict(lambda: NONE)
    jobs = list(itertools.product(delays, models, losses, range(options.seeds)))
    for delay, model, loss, seed in track(jobs, "running", console=Console(stderr=True)):
        network = [f"network.delay={delay}", f"network.loss={loss}"]
        overrides = [*options.overrides, *rows_with(model), *network]
        of_run = certificates(simulated(options.scenario, overrides, seed).recording)
        sums[delay, model] = sums[delay, model].joined(of_run)
    print(f"| delay [s] | {' | '.join(f'`{model}`' for model in models)} |")
    print("|---" * (len(models) + 1) + "|")
    for delay in delays:
        print(f"| {delay} | {' | '.join(words(sums[delay, model]) for model in models)} |")
    print(f"\n{sum(c.steps for c in sums.values())} steps of normal agents.")


def rows_with(model: str) -> tuple[str, str]:
    """Return the overrides of an information model; halves are of a pair, and J of two agents."""
    composition = "pairs" if model == "split" else "lse"
    return f"safety.information={model}", f"safety.composition={composition}"


def words(results: Certificates) -> str:
    """A cell of the table."""
    if not results.certified:
        return "nothing certified"
    counts = f"{results.false} of {results.certified} false"
    return f"{results.worst:.3f} ({counts}{f', {results.short} above η' if results.short else ''})"


def certificates(recording: Recording) -> Certificates:
    """Judge every update of the normal agents by the inputs that were in force after it."""
    split = recording.scenario.safety.information_model.shares
    steps = certified = false = short = 0
    worst = -np.inf
    for now in joint_sums(recording):
        for agent in now.updated:
            steps += 1
            if all(now.held.values()) if split else now.held[agent]:
                certified += 1
                false += now.joint > ROUNDING
                short += now.joint > now.eta + ROUNDING
                worst = max(worst, now.joint)
    return Certificates(steps, certified, false, short, worst)


class JointSum(NamedTuple):
    """J with the inputs in force at one instant."""

    joint: float
    eta: float
    """What of it is η."""
    updated: list[str]
    """Normal agents whose inputs have just taken effect."""
    held: dict[str, bool]
    """Whether the row of each normal agent's input held."""


def joint_sums(recording: Recording) -> Iterator[JointSum]:
    """J at every recorded instant, from the first input of every normal agent on.

    Each instant comes twice: with the inputs until then, before any update, and with those
    from then on.
    """
    rows = build_rows(build_swarm(recording.scenario))
    swarm, first = rows.swarm, rows.swarm.normal[0]
    margin = rows.margin(first)
    evaluate = rows.terms_of_all(margin.eta)
    states = {state.t: np.array(state.x) for state in recording.states}
    in_force: dict[int, NDArray[np.float64]] = {}
    held: dict[str, bool] = {}
    for t, together in itertools.groupby(recording.steps, key=lambda step: step.t_apply):
        steps = [step for step in together if swarm.names.index(step.agent) in swarm.normal]
        terms = evaluate(states[t])
        if len(in_force) == len(swarm.normal):
            yield JointSum(_joint_sum(terms, in_force), margin.eta, [], held)
        in_force.update({swarm.names.index(step.agent): np.array(step.u) for step in steps})
        held = held | {step.agent: _holds(step) for step in steps}
        if len(in_force) == len(swarm.normal):
            updated = [step.agent for step in steps]
            yield JointSum(_joint_sum(terms, in_force), margin.eta, updated, held)


def _joint_sum(terms: Terms, in_force: Mapping[int, NDArray[np.float64]]) -> float:
    joint = terms.unforced + terms.margin
    for l, most in terms.most.items():
        joint += float(terms.c[l] @ in_force[l]) if l in in_force else most
    return joint


def _holds(step: Step) -> bool:
    return step.residual is not None and step.residual <= ROUNDING


if __name__ == "__main__":
    main()
