"""Whom the hub of a run lets in: the scenario's programs and viewers, each in its own name."""

from phalanx.swarm.swarm import Swarm
from phalanx.wire.access import Subject, access_control
from phalanx.wire.credentials import Admission
from phalanx.wire.keys import CLAIMANT, PLANT, ROUTER, VIEWER
from phalanx.wire.membership import Membership


def admission(swarm: Swarm, membership: Membership) -> Admission:
    """What the hub asks for and allows; membership is its own: the plant's, or a router's."""
    at_router = membership.identity == ROUTER
    programs = swarm.programs
    names = (VIEWER, ROUTER, CLAIMANT, *programs, *([PLANT] if at_router else []))
    heard = {swarm.names[j] for i in range(len(swarm.names)) for j in swarm.heard_by(i)}
    subject: Subject = "cert_common_names" if membership.certificates else "usernames"
    return Admission(
        {name: membership.password_of(name) for name in names},
        access_control(membership.keys, programs, heard, subject, with_plant=at_router),
        membership.certificates,
    )
