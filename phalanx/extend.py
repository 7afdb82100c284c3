"""Public names for code of your own: dynamics, safe sets, laws, controllers, margins, link rules.

A class of your own is a dataclass with the methods of one of the protocols here. A scenario names
it as `type = "package.module:Name"`; the other fields of that table are its own. Expressions are
CasADi's, arrays numpy's, units SI, and safe is h <= 0.

    from phalanx.extend import Body, ClassK, Obstacle, box_polytope

Each has an example, which begins with `import casadi as ca, numpy as np` and all names from here.
Names that are not in this module may change at any time.
"""

from phalanx.launcher.streams import echo, echo_error
from phalanx.network.rule import (
    CORRUPT,
    DELIVER,
    DROP,
    DUPLICATE,
    Copy,
    Message,
    Rule,
    Treatment,
    delay,
)
from phalanx.theory.arrays import Array
from phalanx.theory.baselines.controllers import BarrierQP, Escape, LyapunovBarrierQP, Nominal
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import added, dot, length
from phalanx.theory.expressions.portable import portable_value
from phalanx.theory.laws.attacks import Chase, Script, WorstCase
from phalanx.theory.laws.give_way import GiveWay
from phalanx.theory.laws.goals import (
    FixedPoint,
    Goal,
    Motion,
    PathAtSpeed,
    Reference,
    Sight,
    Waypoints,
)
from phalanx.theory.laws.law import (
    ControlledAgent,
    Controller,
    ControllerView,
    Law,
    Received,
    TeamLaw,
    View,
)
from phalanx.theory.laws.tracking import Pursue, Track, TrackVelocity
from phalanx.theory.laws.unstick import Unstick
from phalanx.theory.margins.integrated import IntegratedMargin
from phalanx.theory.margins.local import LocalMargin
from phalanx.theory.margins.margin import Margin, PairRow
from phalanx.theory.models.aerial import IdentifiedQuadrotor, Quadrotor
from phalanx.theory.models.dynamics import Bounded, Dynamics, Measured, box_polytope
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.models.wheeled import (
    DifferentialDrive,
    DynamicUnicycle,
    Unicycle,
)
from phalanx.theory.models.world import World, WorldAgent, WorldStates
from phalanx.theory.rows.least_violation import least_violation
from phalanx.theory.rows.pairs import PairTerms
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows
from phalanx.theory.safety.chain import Chain
from phalanx.theory.safety.class_k import ClassK, Linear, Power
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.function import (
    Body,
    Distance,
    Drawable,
    Fence,
    HeadingAware,
    Limit,
    SafeSetFunction,
    Separation,
)
from phalanx.theory.safety.obstacles import Box, Obstacle, Polygon, Sphere, Wall

__all__ = [  # noqa: RUF022 - in groups, as a scenario's tables come
    # Dynamics
    "Dynamics",
    "Bounded",
    "Measured",
    "box_polytope",
    "SingleIntegrator",
    "DoubleIntegrator",
    "TripleIntegrator",
    "Unicycle",
    "DynamicUnicycle",
    "DifferentialDrive",
    "Quadrotor",
    "IdentifiedQuadrotor",
    # Worlds
    "World",
    "WorldAgent",
    "WorldStates",
    # Safe-set functions, obstacles, limits
    "SafeSetFunction",
    "Body",
    "Separation",
    "Distance",
    "HeadingAware",
    "Obstacle",
    "Sphere",
    "Wall",
    "Box",
    "Polygon",
    "Limit",
    "Drawable",
    "Fence",
    # Class-K functions and margins
    "ClassK",
    "Linear",
    "Power",
    "Margin",
    "PairRow",
    "Chain",
    "LocalMargin",
    "IntegratedMargin",
    # Laws and attacks
    "Law",
    "TeamLaw",
    "View",
    "Goal",
    "Member",
    "Track",
    "TrackVelocity",
    "Unstick",
    "Chase",
    "GiveWay",
    "Pursue",
    "WorstCase",
    "Script",
    # Goals
    "Reference",
    "Sight",
    "Motion",
    "FixedPoint",
    "Waypoints",
    "PathAtSpeed",
    # Controllers
    "Controller",
    "ControllerView",
    "ControlledAgent",
    "Received",
    "PairTerms",
    "Polytope",
    "Rows",
    "NearestInput",
    "least_violation",
    "Nominal",
    "BarrierQP",
    "LyapunovBarrierQP",
    "Escape",
    # Link rules
    "Rule",
    "Message",
    "Treatment",
    "Copy",
    "DELIVER",
    "DROP",
    "DUPLICATE",
    "CORRUPT",
    "delay",
    # Arithmetic that is the same on every machine
    "CompiledFunction",
    "dot",
    "length",
    "added",
    "portable_value",
    # Arrays, and the output of commands
    "Array",
    "echo",
    "echo_error",
]
