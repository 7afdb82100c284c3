"""What a frame of a run looks like: a viewer draws no other."""

import numpy as np

from phalanx.viewer.scene.model import SceneModel
from phalanx.wire.frames import Frame
from phalanx.wire.seal import Malformed


def check_frame(frame: Frame, model: SceneModel) -> None:
    """Raise Malformed unless a frame has the sizes of its run, and finite states."""
    members, pairs = model.swarm.members, model.swarm.safe_set.pairs
    states = sum(len(member.dynamics.states) for member in members)
    if len(frame.x) != 8 * states or len(frame.agents) != len(members):
        raise Malformed("wrong size")
    if not np.isfinite(np.frombuffer(frame.x, dtype="<f8")).all():
        raise Malformed("not finite")
    for status, member in zip(frame.agents, members, strict=True):
        # An agent has no input before its first.
        if not {len(status.u), len(status.u_nom)} <= {0, len(member.dynamics.inputs)}:
            raise Malformed("wrong size")
    ends = [end for event in frame.link_events for end in (event.sender, event.receiver)]
    if any(not 0 <= end < len(members) for end in ends) or not 0 <= frame.pair < len(pairs):
        raise Malformed("wrong agents")
