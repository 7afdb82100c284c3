"""An extension of Phalanx: ferries in a harbour, with one class of each kind, and a command.

pip install ./examples/extension
phalanx run examples/extension/harbour.toml
phalanx closest runs/harbour-1 --trust
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
import typer

import phalanx
from phalanx.extend import (
    DELIVER,
    DROP,
    Array,
    Body,
    Dynamics,
    Message,
    Obstacle,
    PairRow,
    SingleIntegrator,
    Treatment,
    View,
    echo,
    echo_error,
)


@dataclass(frozen=True)
class Ferry(SingleIntegrator):
    """Dynamics: any velocity up to `speed`, in a current along x."""

    current: float = 0.1  # m/s

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.SX([self.current, 0])

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        return super().travel(x, time, disturbance) + abs(self.current) * time


@dataclass(frozen=True)
class Berth:
    """Safe-set function: each ferry keeps out of an ellipse around the other."""

    along: float  # m
    across: float  # m

    def between(self, a: Body, b: Body) -> ca.SX:
        return 1 - ca.sumsqr((a.p - b.p) / ca.DM([self.along, self.across]))

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return obstacle.intrusion(a.p)


@dataclass(frozen=True)
class Channel:
    """Limit: ferries stay between two lines along x."""

    half_width: float  # m

    def alone(self, a: Body) -> ca.SX:
        return (a.p[1] / self.half_width) ** 2 - 1

    def outline(self) -> Sequence[Sequence[tuple[float, float]]]:
        return [[(-20.0, y), (20.0, y)] for y in (-self.half_width, self.half_width)]


@dataclass(frozen=True)
class Bold:
    """Class-K function: approach the faster, the farther away."""

    gain: float  # 1/s

    def value(self, s: ca.SX) -> ca.SX:
        return self.gain * (s + 0.1 * s * ca.fabs(s))


@dataclass(frozen=True)
class Wake:
    """Margin: pays for a wake that pushes the ferry at this speed until its next sample."""

    speed: float  # m/s

    def at_sample(self, row: PairRow) -> ca.SX:
        steepness = ca.norm_2(row.chain.actuation[row.own])
        return row.share * self.speed * row.horizon * steepness


@dataclass
class Cross:
    """Law: go to the far end of the harbour and back."""

    speed: float  # m/s
    end: float = 6.0  # m

    def prepare(self, dynamics: Dynamics) -> None:
        if len(dynamics.inputs) != 2:
            raise ValueError("Cross: expected dynamics in the plane, with two inputs")
        self.side = 1.0

    def input(self, view: View) -> Array:
        x, y = view.positions[view.i]
        if self.side * x > self.end:
            self.side = -self.side
        return np.array([self.side * self.speed, -0.5 * y])


@dataclass(frozen=True)
class Fog:
    """Link rule: the farther apart, the more is lost."""

    per_metre: float  # 1/m

    def treat(self, message: Message) -> Treatment:
        return DROP if message.draw("fog") < self.per_metre * message.distance else DELIVER


def register(app: typer.Typer) -> None:
    """Add the command; the entry point in pyproject.toml names this function."""
    app.command()(closest)


def closest(run: Path, trust: bool = False) -> int:
    """Print the pair of a run that came closest to its limit."""
    if not run.exists():
        echo_error(f"{run}: no such run")
        return 64
    h = phalanx.open(run, trust=trust).h.drop("run", "scenario", "seed", "t")
    largest = dict(zip(h.columns, h.max().row(0), strict=True))
    pair = max(largest, key=largest.__getitem__)
    echo(f"{pair} came closest: its largest h is {largest[pair]:.3f}, and safe is at most 0")
    return 0
