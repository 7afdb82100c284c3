"""Disturbances that Crazyflies need under simpler declared dynamics, for the same inputs."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import phalanx
from phalanx.extend import (
    DoubleIntegrator,
    Dynamics,
    IdentifiedQuadrotor,
    Quadrotor,
    World,
    WorldAgent,
)
from phalanx.guarantee.disturbance_ledger import DisturbanceLedger
from phalanx.recording.disturbances import disturbances_of
from phalanx.recording.read import steps_by_agent, swarm_of
from phalanx.schema.registry import construct
from phalanx.theory.arrays import Array
from phalanx.theory.models.aerial import GRAVITY


class Flight(NamedTuple):
    """States of `quadrotor` of one drone, and the inputs that it held in between."""

    dynamics: IdentifiedQuadrotor
    times: Array
    """[s], shape (w + 1,)."""
    x: Array
    """Shape (w + 1, 9)."""
    u: Array
    """Shape (w, 3)."""


def needed_by(run: phalanx.Run) -> dict[str, Array]:
    """Return ‖φ̂‖ of all intervals of a run by dynamics that might have been declared."""
    ledgers = disturbances_of(run.recording, swarm_of(run.recording))
    flights = [*_flown_again(run)]
    return {
        "`identified-quadrotor`": np.concatenate([each.size for each in ledgers]),
        "`quadrotor`": np.concatenate([_as_quadrotor(each) for each in flights]),
        "`double-integrator`": np.concatenate([_as_double_integrator(each) for each in flights]),
    }


def _flown_again(run: phalanx.Run) -> Iterator[Flight]:
    """Yield flights with the inputs of a run, by drones that do not filter their thrust."""
    swarm = swarm_of(run.recording)
    for i, steps in enumerate(steps_by_agent(run.recording).values()):
        applied = sorted((step for step in steps if step.t_apply > 0.0), key=lambda s: s.t_apply)
        dynamics = swarm.members[i].dynamics
        assert isinstance(dynamics, IdentifiedQuadrotor)
        start = swarm.start()[swarm.safe_set.parts[i]][:9]
        world = construct(World, dict(run.scenario.world or {}))
        world.begin([WorldAgent("one", _quadrotor(dynamics), start)], 0, 1e-3)
        times = np.array([0.0, *(step.t_apply for step in applied), swarm.scenario.duration])
        inputs = np.array([np.zeros(3), *(step.u for step in applied)])
        keep = np.diff(times) > 0.0
        times, inputs = np.append(times[:-1][keep], times[-1]), inputs[keep]
        x = [start]
        for until, u in zip(times[1:].tolist(), inputs, strict=True):
            world.hold("one", u)
            x.append(world.advance(until).x["one"][-1])
        yield Flight(dynamics, times, np.array(x), inputs)


def _quadrotor(of: IdentifiedQuadrotor) -> Quadrotor:
    """Return the quadrotor whose angles lag as much in the mean."""
    return Quadrotor(of.thrust, of.tilt, of.thrust_lag, of.damping / of.stiffness)


def _as_quadrotor(flight: Flight) -> Array:
    return _explained(_quadrotor(flight.dynamics), flight, flight.x, flight.u)


def _as_double_integrator(flight: Flight) -> Array:
    """Return ‖φ̂‖ where a drone had the acceleration at once that its inputs lead to."""
    c, theta, phi = flight.u.T
    n = np.cos(phi) * np.sin(theta), -np.sin(phi), np.cos(phi) * np.cos(theta)
    acceleration = ((GRAVITY + c) * np.array(n)).T - [0.0, 0.0, GRAVITY]
    dynamics = DoubleIntegrator(acceleration=5.0, drag=flight.dynamics.drag)
    return _explained(dynamics, flight, flight.x[:, :6], acceleration)


def _explained(dynamics: Dynamics, flight: Flight, x: Array, u: Array) -> Array:
    return DisturbanceLedger(dynamics).explain(x[:-1], x[1:], u, np.diff(flight.times)).size
