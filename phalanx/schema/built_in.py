"""Names of the classes that Phalanx brings, by kind: the protocol that each fulfils.

A scenario writes the name as `type`. Only the modules of named classes are imported.
"""

from collections.abc import Mapping

from phalanx.theory.laws.goals import Reference
from phalanx.theory.laws.law import Controller, Law
from phalanx.theory.margins.margin import Margin
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.world import World
from phalanx.theory.rows.information import Information
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.function import Limit, SafeSetFunction

BUILT_IN: Mapping[type, Mapping[str, str]] = {
    Dynamics: {
        "unicycle": "phalanx.theory.models.wheeled:Unicycle",
        "dynamic-unicycle": "phalanx.theory.models.wheeled:DynamicUnicycle",
        "single-integrator": "phalanx.theory.models.integrators:SingleIntegrator",
        "double-integrator": "phalanx.theory.models.integrators:DoubleIntegrator",
        "triple-integrator": "phalanx.theory.models.integrators:TripleIntegrator",
        "differential-drive": "phalanx.theory.models.wheeled:DifferentialDrive",
        "quadrotor": "phalanx.theory.models.aerial:Quadrotor",
        "identified-quadrotor": "phalanx.theory.models.aerial:IdentifiedQuadrotor",
    },
    ClassK: {
        "linear": "phalanx.theory.safety.class_k:Linear",
        "power": "phalanx.theory.safety.class_k:Power",
    },
    SafeSetFunction: {
        "separation": "phalanx.theory.safety.function:Separation",
        "distance": "phalanx.theory.safety.function:Distance",
        "heading-aware": "phalanx.theory.safety.function:HeadingAware",
    },
    Limit: {
        "fence": "phalanx.theory.safety.function:Fence",
    },
    Margin: {
        "paper": "phalanx.theory.margins.margin:PaperMargin",
        "corrected": "phalanx.theory.margins.margin:CorrectedMargin",
        "local": "phalanx.theory.margins.local:LocalMargin",
        "integrated": "phalanx.theory.margins.integrated:IntegratedMargin",
    },
    Information: {
        "paper": "phalanx.theory.rows.information:Paper",
        "in-flight": "phalanx.theory.rows.information:InFlight",
        "split": "phalanx.theory.rows.information:Split",
        "worst-case": "phalanx.theory.rows.information:WorstCase",
        "unknown": "phalanx.theory.rows.information:Unknown",
    },
    Reference: {
        "point": "phalanx.theory.laws.goals:FixedPoint",
        "waypoints": "phalanx.theory.laws.goals:Waypoints",
        "path": "phalanx.theory.laws.goals:PathAtSpeed",
    },
    Law: {
        "track-velocity": "phalanx.theory.laws.tracking:TrackVelocity",
        "track": "phalanx.theory.laws.tracking:Track",
        "give-way": "phalanx.theory.laws.give_way:GiveWay",
        "unstick": "phalanx.theory.laws.unstick:Unstick",
        "pursue": "phalanx.theory.laws.tracking:Pursue",
        "chase": "phalanx.theory.laws.attacks:Chase",
        "worst": "phalanx.theory.laws.attacks:WorstCase",
        "script": "phalanx.theory.laws.attacks:Script",
    },
    Controller: {
        "none": "phalanx.theory.baselines.controllers:Nominal",
        "cbf-qp": "phalanx.theory.baselines.controllers:BarrierQP",
        "clf-cbf": "phalanx.theory.baselines.controllers:LyapunovBarrierQP",
        "escape": "phalanx.theory.baselines.controllers:Escape",
    },
}
"""Module and class by name, by kind."""

PACKAGES: Mapping[type, Mapping[str, str]] = {
    World: {
        "crazyflies": "phalanx-worlds",
        "mujoco": "phalanx-worlds",
        "ros2": "phalanx-ros2",
    },
}
"""Packages of this repository by the names that they register, by kind."""

BY_OPTION: Mapping[str, str] = {
    "agents.controller": "phalanx.swarm.own_controller:own_controller",
    "agents.program": "phalanx_agent.program:ProgramController",
    "agents.protocol": "phalanx_agent.program:become",
    "agents.radio": "phalanx.swarm.radio:RadioFilter",
    "agents.radio judged": "phalanx_plant.judge.knowledge:Knowledge",
    "agents.controller certified": "phalanx.guarantee.certificates:certified_for",
    "safety.control": "phalanx_agent.centralised:CentralisedController",
    "safety.keep": "phalanx.swarm.flight:keeper",
    "safety.keep judged": "phalanx_plant.judge.promise:PromiseLedger",
    "safety.prove": "phalanx.guarantee.proven_filter:ProvenFilter",
    "safety.watch": "phalanx.swarm.watch:Watch",
}
"""Parts of an agent, or of its judge, that an option of its scenario asks for, by the option."""
