"""The picture of one frame: poses, roles, arrows and lines; the same for page, HTML and PNG."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import Array, Index, Mask
from phalanx.guarantee.verdict import Violation
from phalanx.wire.messages import Frame
from phalanx_viewer.scene.colours import COLOURS, Role, role
from phalanx_viewer.scene.kinematics import unit
from phalanx_viewer.scene.model import SceneModel

Colours = NDArray[np.uint8]


@dataclass(frozen=True)
class Picture:
    """One frame, ready to draw; everything in 3-D and in metres."""

    positions: Array
    """Output points, shape (N, 3)."""
    goals: Array
    """Their goals, shape (N, 3); NaN where none is known."""
    headings: Array
    """Unit vectors, shape (N, 3): an agent's heading, else its input's direction, else zero."""
    roles: list[Role]
    applied: Array
    """Applied inputs as arrows, shape (N, 3)."""
    u_nom: Array
    """Nominal inputs as arrows, shape (N, 3)."""
    pair: int
    """The pair whose h is largest."""
    worst_pair: tuple[Array, Array]
    """Its ends, shapes (3,)."""
    worst_pair_text: str
    unsafe: list[int]
    """The pairs with h > 0, the largest h first."""
    unsafe_ends: Array
    """Positions of their sides, shape (v, 2, 3)."""
    unsafe_agents: Mask
    """True for agents in one of them, shape (N,)."""
    liars: Mask
    """Agents that sent false broadcasts, shape (N,)."""
    unsafe_lines: list[str]
    """A line of text for each unsafe pair: its name, distance, h, and since when."""
    past_lines: list[str]
    """A line of text for each pair that was unsafe before."""
    links: Array
    """Links that lost or delayed a broadcast, from sender to receiver, shape (l, 2, 3)."""
    link_agents: Index
    """Their senders and receivers, shape (l, 2)."""
    lost: Mask
    """True for links that lost it, shape (l,)."""

    def links_of(self, i: int | None) -> Mask:
        """True for links that agent i sends or receives on, shape (l,)."""
        found: Mask = (self.link_agents == (-1 if i is None else i)).any(axis=1)
        return found

    @cached_property
    def colours(self) -> Colours:
        """The agents' colours, shape (N, 3)."""
        return np.array([COLOURS[role] for role in self.roles], dtype=np.uint8)


def picture(model: SceneModel, frame: Frame) -> Picture:
    """Compute the picture of a frame."""
    x = np.frombuffer(frame.x, dtype="<f8")
    poses = model.kinematics.poses(x)
    p = poses.positions
    steps = [status.step for status in frame.agents]
    applied = _arrows(model, x, [step.u if step else () for step in steps])
    has_heading = poses.headings.any(axis=1, keepdims=True)
    # h_tot is never below the largest h.
    unsafe = [] if frame.h_tot <= 0.0 else model.values.unsafe(x).tolist()
    sides = [(event.sender, event.receiver) for event in frame.link_events]
    links = np.array(sides, dtype=np.intp).reshape(-1, 2)
    return Picture(
        positions=p,
        goals=model.goals(frame.t, x),
        headings=np.where(has_heading, poses.headings, unit(applied)),
        roles=[role(s, bool(bad)) for s, bad in zip(frame.agents, model.adversary, strict=True)],
        applied=applied,
        u_nom=_arrows(model, x, [step.u_nom if step else () for step in steps]),
        pair=frame.pair,
        worst_pair=model.ends(frame.pair, p),
        worst_pair_text=f"{model.label(frame.pair)}: {model.pair_text(frame.pair, x, p)}",
        unsafe=unsafe,
        unsafe_ends=np.array([model.ends(pair, p) for pair in unsafe]).reshape(-1, 2, 3),
        unsafe_agents=np.isin(np.arange(len(p)), list(model.agents_of(unsafe))),
        liars=np.array([status.lies > 0 for status in frame.agents]),
        unsafe_lines=unsafe_lines(model, unsafe, frame.violations, x, p),
        past_lines=past_lines(model, unsafe, frame.violations, frame.t),
        links=p[links],
        link_agents=links,
        lost=np.array([event.delay < 0.0 for event in frame.link_events], dtype=bool),
    )


def _arrows(model: SceneModel, x: Array, inputs: list[tuple[float, ...]]) -> Array:
    """Each agent's input as an arrow, shape (N, 3); zero for an agent without one."""
    parts = model.kinematics.inputs
    u = np.zeros(parts[-1].stop)
    for own, given in zip(parts, inputs, strict=True):
        if given:
            u[own] = given
    return model.kinematics.effects(x, u)


def unsafe_lines(
    model: SceneModel, unsafe: list[int], violations: tuple[Violation, ...], x: Array, p: Array
) -> list[str]:
    """A line of text for each unsafe pair, at a state, shape (n̄,).

    p: output points, shape (N, 3).
    """
    since = {violation.pair: violation.first for violation in violations}
    lines = []
    for pair in unsafe:
        label = model.label(pair)
        first = f", since t = {since[label]:.3f} s" if label in since else ""
        lines.append(f"{label} unsafe: {model.pair_text(pair, x, p)} where 0 is allowed{first}")
    return lines


def past_lines(
    model: SceneModel, unsafe: list[int], violations: tuple[Violation, ...], t: float
) -> list[str]:
    """A line of text for each pair that was unsafe before t [s], and is not any more."""
    now = {model.label(pair) for pair in unsafe}
    lines = []
    for violation in violations:
        if violation.pair not in now and violation.first <= t:
            deepest = f", up to h = {violation.worst:.3g}" if violation.worst_at <= t else ""
            lines.append(
                f"{violation.pair} was unsafe from t = {violation.first:.3f} s on{deepest}"
            )
    return lines
