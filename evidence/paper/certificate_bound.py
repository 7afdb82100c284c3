"""The integrated certificate's bound against random and greedy trajectories, and recorded runs.

    python evidence/paper/certificate_bound.py [--trajectories 1000000] [--seeds 2]

The first table asks of every dynamics and q: how much of what D and g allow do trajectories use?
(V(t) - V_k - t r) / (t D + ½ t² g), its largest and median over all trajectories; above 1 the bound
would be wrong. In every step of a trajectory the others' inputs and all disturbances are drawn
(random), or chosen to raise V most (greedy). The second table certifies recorded runs.
"""

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

import phalanx
from examples.bicycles import Bicycle
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.margins.enclosure import admissible_inputs, enclose
from phalanx.theory.margins.integrated import INFLATIONS, growth
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.integrators import (
    DoubleIntegrator,
    SingleIntegrator,
    TripleIntegrator,
)
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Sphere

STEPS = 12
BATCH = 5000


class Kind(NamedTuple):
    """Dynamics of a pair, and what is drawn about it."""

    normal: Dynamics
    adversary: Dynamics
    alphas: list[float]
    bound: float
    """φ^max."""
    tau: float
    """[s]"""
    radius: float
    """R [m]."""
    rate: float
    """Velocities and accelerations are drawn up to this."""


KINDS = {
    "single integrators": Kind(
        SingleIntegrator(2.0), SingleIntegrator(1.5), [2.0], 0.5, 0.05, 1.0, 2.0
    ),
    "unicycles (Simulation 1)": Kind(
        Unicycle(4.0, 2.0), Unicycle(2.0, 1.0), [2.0], 1.73, 0.012, 1.0, 3.0
    ),
    "double integrators (Simulation 2)": Kind(
        DoubleIntegrator(2.0, 2 / 3),
        DoubleIntegrator(1.5, 2 / 3),
        [0.4, 0.4],
        0.4899,
        0.1,
        5.0,
        3.0,
    ),
    "bicycles": Kind(Bicycle(2.0, 0.7), Bicycle(1.5, 0.7), [1.0, 1.0], 0.4, 0.02, 1.0, 3.0),
    "triple integrators": Kind(
        TripleIntegrator(2.0), TripleIntegrator(1.5), [1.0, 1.0, 1.0], 0.3, 0.05, 1.0, 2.0
    ),
}


class Pair:
    """One pair with its bound on V = ψ_degree, over whole batches: a column is a trajectory."""

    def __init__(self, kind: Kind, degree: int, obstacle: bool) -> None:
        self.kind = kind
        members = [Member("a", kind.normal, False), Member("b", kind.adversary, True)]
        dimension = kind.normal.position(ca.SX.sym("x", len(kind.normal.states))).numel()
        sphere = Sphere((0.0,) * dimension, kind.radius)
        composed = compose(members, [sphere], Separation(kind.radius), 1.0)
        pair = composed.alone(1 if obstacle else 0)
        self.parts = pair.parts
        bounds = [kind.bound] * len(pair.members)
        horizon, rest = ca.SX.sym("T"), ca.SX.sym("rest")
        moving = [
            enclose(m, pair.x[p], admissible_inputs(m) if l else None, b, horizon, INFLATIONS)
            for l, (m, p, b) in enumerate(zip(pair.members, pair.parts, bounds, strict=True))
        ]
        V = build_chain(pair, kind.alphas, None, bounds).psi[degree]
        parts = ca.vertcat(*growth(V, pair, 0, moving, bounds))
        self.bound = ca.Function("bound", [pair.x, moving[0].u, horizon], [parts])
        u, phi = ca.vertcat(*[e.u for e in moving]), ca.vertcat(*[e.phi for e in moving])
        rates = ca.vertcat(*[e.rate + e.phi for e in moving])
        drift = ca.substitute(ca.substitute(rates, u, 0 * u), phi, 0 * phi)
        # What is left of V's drift at the end counts too: so inputs that V' lacks have a direction.
        pull = ca.jacobian(V + rest * (ca.jacobian(V, pair.x) @ drift), pair.x)
        force = (pull @ ca.jacobian(rates, u)).T
        self.pull = ca.Function("pull", [pair.x, rest], [pull.T, force])
        self.step = _runge_kutta(pair.x, u, phi, rates)
        self.value = ca.Function("V", [pair.x], [V])
        self.corners = [_corners(m.dynamics) for m in pair.members]

    def states(self, rng: np.random.Generator, count: int) -> Array:
        """Pairs within three radii of one another, shape (n̄, count)."""
        kind = self.kind
        x = rng.uniform(-kind.rate, kind.rate, (self.parts[-1].stop, count))
        for part, member in zip(self.parts, (kind.normal, kind.adversary), strict=False):
            axes = [part.start + k for k, name in enumerate(member.states) if name in "xyz"]
            x[axes] = rng.uniform(-1.5, 1.5, (len(axes), count)) * kind.radius
        return x

    def used(self, rng: np.random.Generator, horizon: float, greedy: bool, count: int) -> Array:
        """The largest share of the bound that each trajectory uses; of those that have one."""
        x, chosen = self.states(rng, count), rng.integers(len(self.corners[0]), size=count)
        inputs = (self.corners[0][chosen] * rng.uniform(0, 1, (count, 1))).T
        value, rate, disturbance, bend, bounded = np.array(self.bound(x, inputs, horizon))
        largest, dt = np.full(count, -np.inf), horizon / STEPS
        for k in range(STEPS):
            pull, force = (np.array(a) for a in self.pull(x, horizon - k * dt))
            u = np.vstack([inputs, self._others(rng, force[len(inputs) :], greedy)])
            phi = self._disturbances(rng, pull, greedy)
            x = np.array(self.step(x, u, phi, dt))
            t = dt * (k + 1)
            beyond = np.array(self.value(x))[0] - value - t * rate
            largest = np.maximum(largest, beyond / (t * disturbance + t * t / 2 * bend))
        shares: Array = largest[bounded == 1.0]
        return shares

    def _others(self, rng: np.random.Generator, force: Array, greedy: bool) -> Array:
        if len(self.corners) == 1:
            return np.zeros((0, force.shape[1]))
        gains = self.corners[1] @ force
        best = gains.argmax(axis=0) if greedy else rng.integers(len(gains), size=gains.shape[1])
        return np.array(self.corners[1][best].T)

    def _disturbances(self, rng: np.random.Generator, pull: Array, greedy: bool) -> Array:
        way = pull if greedy else rng.normal(size=pull.shape)
        norms = [np.linalg.norm(way[part], axis=0) + 1e-300 for part in self.parts]
        unit = np.vstack([way[part] / n for part, n in zip(self.parts, norms, strict=True)])
        return np.array(self.kind.bound * unit)


def _runge_kutta(x: ca.SX, u: ca.SX, phi: ca.SX, rates: ca.SX) -> ca.Function:
    """One classical step of fourth order."""
    f, dt = ca.Function("f", [x, u, phi], [rates]), ca.SX.sym("dt")
    k1 = f(x, u, phi)
    k2 = f(x + dt / 2 * k1, u, phi)
    k3 = f(x + dt / 2 * k2, u, phi)
    k4 = f(x + dt * k3, u, phi)
    return ca.Function("step", [x, u, phi, dt], [x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])


def _corners(dynamics: Dynamics) -> Array:
    polytope = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", len(dynamics.states))))
    assert polytope is not None
    return polytope.corners


def bound_table(trajectories: int) -> None:
    """Trajectories, shared evenly by all lines; over horizons of 1, 2, 4 and 8 τ."""
    lines = [
        (name, degree, obstacle)
        for name, kind in KINDS.items()
        for degree in sorted({0, len(kind.alphas) - 1})
        for obstacle in (False, True)
    ]
    share = -(-trajectories // (len(lines) * 8))
    print("| dynamics | q | V | other | trajectories | random: largest, median | greedy |")
    print("|---|---|---|---|---|---|---|")
    total, worst = 0, -np.inf
    for name, degree, obstacle in lines:
        kind, rng = KINDS[name], np.random.default_rng(len(name) + degree)
        pair, columns, count = Pair(kind, degree, obstacle), [], 0
        for greedy in (False, True):
            used = np.concatenate(
                [
                    pair.used(rng, multiple * kind.tau, greedy, size)
                    for multiple in (1, 2, 4, 8)
                    for size in _batches(share)
                ]
            )
            count, worst = count + len(used), max(worst, float(used.max()))
            columns.append(f"{used.max():.3f}, {np.median(used):.3f}")
        assert 0.9 < used.max() <= 1.0, "greedy trajectories hardly try the bound, or refute it"
        total += count
        V, other = (f"ψ_{degree}" if degree else "h"), "obstacle" if obstacle else "adversary"
        print(f"| {name} | {len(kind.alphas)} | {V} | {other} | {count} | {' | '.join(columns)} |")
    print(f"\n{total} trajectories, largest {worst:.6f}", flush=True)


def _batches(count: int) -> list[int]:
    return [min(BATCH, count - start) for start in range(0, count, BATCH)]


class Certified(NamedTuple):
    """One recorded run, by its normal agents' samples."""

    samples: int
    share: float
    """Of samples at which every pair is certified for τ."""
    shortest: float
    """Shortest certified time of any pair [τ]."""
    first: float | None
    """The first sample that is not certified for τ [s]."""
    violation: float | None
    """When a pair became unsafe [s]."""


def certify(name: str, overrides: Sequence[str], seed: int) -> Certified:
    """Run a scenario and certify every sample of its recording."""
    run = phalanx.run(phalanx.load(name, overrides, seed), engine="in-process")
    swarm = build_swarm(run.scenario)
    every = SwarmCertificates(swarm)
    certificates = {swarm.names[i]: every.of(i) for i in swarm.normal}
    states = {state.t: np.array(state.x) for state in run.recording.states}
    times, shares = [], []
    for step in run.recording.steps:
        if (certificate := certificates.get(step.agent)) is not None:
            proven = certificate(states[step.t_apply], np.array(step.u))
            times.append(step.t_apply)
            shares.append(float(proven.min()) / certificate.tau)
    missing = [t for t, share in zip(times, shares, strict=True) if share < 1.0]
    assert run.summary is not None
    violations = [v.first for v in run.summary.violations]
    share = 1.0 - len(missing) / len(times)
    first, violation = min(missing, default=None), min(violations, default=None)
    return Certified(len(times), share, min(shares), first, violation)


def run_table(seeds: int) -> None:
    """The paper's two simulations, and the first one without its margin."""
    cases: list[tuple[str, list[str]]] = [
        ("unicycles", []),
        ("formation3d", []),
        ("unicycles", ["safety.eta=0"]),
    ]
    print(
        "| run | seed | samples | certified for τ | shortest [τ] | warning before violation [ms] |"
    )
    print("|---|---|---|---|---|---|")
    for name, overrides in cases:
        for seed in range(seeds):
            result = certify(name, overrides, seed)
            warning = "-"
            if result.violation is not None:
                ahead = None if result.first is None else result.violation - result.first
                warning = "none" if ahead is None else f"{ahead * 1e3:.0f}"
            label = " ".join([name, *overrides])
            numbers = f"{result.samples} | {result.share:.2%} | {result.shortest:.2f}"
            print(f"| {label} | {seed} | {numbers} | {warning} |", flush=True)


def main() -> None:
    """Print both tables."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--trajectories", type=int, default=1_000_000)
    arguments.add_argument("--seeds", type=int, default=2)
    options = arguments.parse_args()
    bound_table(options.trajectories)
    run_table(options.seeds)


if __name__ == "__main__":
    main()
