"""The goals of a run as tables: pieces of polynomials in time, places to reach, or to stay."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from phalanx.native.loop.kernels import begins
from phalanx.scenario.placement import Flow
from phalanx.theory.arrays import Array
from phalanx.theory.laws.formation import Slot
from phalanx.theory.laws.goals import (
    FixedPoint,
    PathAtSpeed,
    Polyline,
    Reference,
    Stay,
    Waypoints,
)

PIECES, PLACES, STAY = range(3)


class Piece(NamedTuple):
    """A goal from a time on: a polynomial of (t - begin) / scale."""

    begin: float
    """[s]"""
    terms: Array
    """Position, velocity and acceleration of each power, the highest first, shape (k, 3 d)."""
    scale: float = 1.0
    """[s]"""


class GoalTable(NamedTuple):
    """An agent's goal."""

    kind: int
    pieces: Sequence[Piece]
    tolerance: float = 0.0
    """Of places [m]."""


def goal_tables(references: Sequence[Reference], axes: int) -> dict[str, Any]:
    """Return the tables of all agents' goals: those that run.h declares from goal to reached."""
    goals = [goal for goal in (goal_table(r, axes) for r in references) if goal]
    pieces = [piece for goal in goals for piece in goal.pieces]
    return {
        "goal": [goal.kind for goal in goals],
        "piece_at": begins(len(goal.pieces) for goal in goals),
        "piece_begin": [piece.begin for piece in pieces],
        "piece_scale": [piece.scale for piece in pieces],
        "term_at": begins(len(piece.terms) for piece in pieces),
        "term": np.concatenate([piece.terms.ravel() for piece in pieces]),
        "tolerance": [goal.tolerance for goal in goals],
        "reached": [0] * len(goals),
    }


def goal_table(reference: Reference, axes: int) -> GoalTable | None:
    """Return the table of a reference; None if there is none for it."""
    match reference:
        case Stay():
            return GoalTable(STAY, [Piece(0.0, np.zeros((1, 3 * axes)))])
        case FixedPoint():
            return GoalTable(PIECES, [_rest(-math.inf, np.array(reference.position))])
        case Flow():
            return GoalTable(PIECES, [_line(0.0, reference.start, reference.velocity)])
        case Slot(formation=formation, slot=slot):
            terms = formation.polynomial(slot)[::-1]
            after = np.concatenate(formation.goal(slot, formation.finish))[None]
            moving = Piece(0.0, terms, formation.finish)
            return GoalTable(PIECES, [moving, Piece(formation.finish, after)])
        case PathAtSpeed():
            return GoalTable(PIECES, _polyline(reference.polyline))
        case Waypoints(tolerance=None):
            assert reference.timed is not None
            return GoalTable(PIECES, _polyline(reference.timed))
        case Waypoints(tolerance=float(tolerance)):
            places = [_rest(0.0, np.array(point)) for point in reference.points]
            return GoalTable(PLACES, places, tolerance)
    return None


def _rest(begin: float, position: Array) -> Piece:
    return Piece(begin, np.concatenate([position, np.zeros(2 * len(position))])[None])


def _line(begin: float, position: Array, velocity: Array) -> Piece:
    nothing = np.zeros(len(position))
    rising = np.concatenate([velocity, nothing, nothing])
    return Piece(begin, np.stack([rising, np.concatenate([position, velocity, nothing])]))


def _polyline(line: Polyline) -> list[Piece]:
    legs = zip(line.times, line.points, line.velocities, strict=False)
    pieces = [_line(*leg) for leg in legs]
    ends = _rest(-math.inf, line.points[0]), _rest(line.times[-1], line.points[-1])
    return [ends[0], *pieces, ends[1]]
