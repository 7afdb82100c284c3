"""False certificates: how often, and how far, a row held that did not hold jointly.

    python bench/stale_input.py [--scenario stale-inputs] [--models paper,split] [--losses 0.0]

Every run is a real one. After each update the recording says which inputs are in force; with them
J = Σ drift + Σ_N c_l u_l + Σ_A max c_j u + α_q(ψ_{q-1}) + η must not be above 0. An update is a
false certificate if its row held and J > 0; where every agent keeps its share, if all their rows
held. J <= η means that sampling and disturbance are left with less margin than asked for, but the
condition itself held.
"""

import argparse
import itertools
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from phalanx.launch import launch, new_folder
from phalanx.recording.read import Recording, read
from phalanx.scenario.load import load
from phalanx.scenario.swarm import build_swarm
from phalanx.theory.row import Information
from phalanx.theory.terms import TermsFunction
from phalanx.wire.session import free_endpoint

_ROUNDING = 1e-4


class Certificates(NamedTuple):
    """What the updates of one run were worth."""

    updates: int
    certified: int
    """Updates whose row held; with shares, after which every agent's row had held."""
    false: int
    """Of these, those with J > 0."""
    short: int
    """Of these, those with J > η."""
    worst: float
    """Largest J at a certified update."""
    worst_h: float


def main() -> None:
    """Run every combination and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--scenario", default="stale-inputs")
    arguments.add_argument("--models", default="paper,in-flight,split,worst-case")
    arguments.add_argument("--delays", default="0.0,0.01,0.02,0.05,0.1")
    arguments.add_argument("--losses", default="0.0,0.1,0.3")
    arguments.add_argument("--set", action="append", default=[], dest="overrides")
    options = arguments.parse_args()
    print("| model | delay [s] | loss | updates | certified | false | worst J | max h_tot |")
    print("|---|---|---|---|---|---|---|---|")
    axes = (options.models, options.delays, options.losses)
    for model, delay, loss in itertools.product(*[axis.split(",") for axis in axes]):
        network = [f"network.delay={delay}", f"network.loss={loss}"]
        overrides = [*options.overrides, f"safety.information={model}", *network]
        found = certificates(run(options.scenario, overrides))
        print(
            f"| {model} | {delay} | {loss} | {found.updates} | {found.certified} | {found.false} "
            f"| {found.worst:.3f} | {found.worst_h:.3f} |",
            flush=True,
        )


def run(name: str, overrides: list[str]) -> Recording:
    """A run of plant, hub and agents, as it was recorded."""
    with tempfile.TemporaryDirectory(prefix="phalanx-") as parent:
        folder = new_folder(Path(parent), name)
        launch(load(name, overrides), folder, free_endpoint(), lambda _: None)
        return read(folder)


def certificates(recording: Recording) -> Certificates:
    """Judge every update of the normal agents by the inputs that were in force after it."""
    swarm = build_swarm(recording.scenario)
    evaluate, eta = TermsFunction(swarm.chain), swarm.eta(swarm.normal[0])
    names, in_force = swarm.names, {}
    states = {state.t: np.array(state.x) for state in recording.states}
    split = recording.scenario.safety.information is Information.SPLIT
    held: dict[int, bool] = {}
    updates = certified = false = short = 0
    worst = -np.inf
    for t, together in itertools.groupby(recording.steps, key=lambda step: step.t_apply):
        steps = [step for step in together if names.index(step.agent) in swarm.normal]
        in_force.update({names.index(step.agent): np.array(step.u) for step in steps})
        held.update({names.index(step.agent): step.residual <= _ROUNDING for step in steps})
        if len(in_force) < len(swarm.normal):
            continue
        terms = evaluate(states[t])
        joint = terms.unforced + terms.margin + eta
        for l, most in enumerate(terms.most.tolist()):
            joint += float(terms.c[l] @ in_force[l]) if l in in_force else most
        for step in steps:
            updates += 1
            if all(held.values()) if split else held[names.index(step.agent)]:
                certified += 1
                false += joint > _ROUNDING
                short += joint > eta + _ROUNDING
                worst = max(worst, joint)
    return Certificates(updates, certified, false, short, worst, float(recording.h_tot.max()))


if __name__ == "__main__":
    main()
