"""Admission of programs by the hub of a run, and its access-control rules.

What no rule allows is denied. Each session has authenticated itself by a password or a TLS
identity, and rules are by session. So no program can put, declare or withdraw anything in
another's name, even if it has another's keys. Zenoh does not notify a denied sender.
"""

from collections.abc import Container, Iterator, Mapping
from itertools import chain
from typing import Any, Literal

from phalanx.messages.credentials import Admission
from phalanx.messages.keys import OPERATOR, PLANT, ROUTER, VIEWER, Keys
from phalanx.messages.membership import Membership
from phalanx.swarm.swarm import Swarm

Subject = Literal["usernames", "cert_common_names"]
"""Zenoh's name of a session: that with its password, or that in its TLS identity."""


def admission(swarm: Swarm, membership: Membership) -> Admission:
    """Make the admission for a hub; membership: its own, the plant's or a router's."""
    at_router = membership.identity == ROUTER
    programs = swarm.programs
    names = (VIEWER, ROUTER, *programs, *([PLANT] if at_router else []))
    heard = {swarm.names[j] for i in range(len(swarm.names)) for j in swarm.heard_by(i)}
    subject: Subject = "cert_common_names" if membership.identity_folder else "usernames"
    return Admission(
        {name: membership.password_of(name) for name in names},
        access_control(membership.keys, programs, heard, subject, with_plant=at_router),
        membership.identity_folder,
    )


def access_control(
    keys: Keys,
    agents: Mapping[str, tuple[str, ...]],
    heard: Container[str],
    subject: Subject = "usernames",
    with_plant: bool = False,
) -> dict[str, Any]:
    """Make Zenoh's `access_control` table for the hub of a run.

    Args:
        keys: the run's.
        agents: the programs that decide for agents, each with the names of those agents.
        heard: agents whose broadcasts have a receiver; the others may not send any.
        subject: how sessions are named.
        with_plant: whether the plant connects as a client, because the hub is a router.
    """
    # With passwords there is no operator: any viewer with the command secret may command.
    may_command = {VIEWER: subject == "usernames", OPERATOR: True}
    programs = {name: _viewer(keys, may) for name, may in may_command.items()}
    programs |= {name: _agent(keys, own, heard) for name, own in agents.items()}
    programs |= {PLANT: _plant(keys)} if with_plant else {}
    programs |= {ROUTER: _router(keys)}
    # The hub copies its rules for every connection, so equal rules of programs are one.
    ids = {rule: str(n) for n, rule in enumerate(dict.fromkeys(chain(*programs.values())))}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {
                "id": number,
                "permission": "allow",
                "flows": [flow],
                "messages": list(messages),
                "key_exprs": list(key_exprs),
            }
            for (flow, messages, key_exprs), number in ids.items()
        ],
        "subjects": [{"id": name, subject: [name]} for name in programs],
        "policies": [
            {"subjects": [name], "rules": [ids[rule] for rule in allowed]}
            for name, allowed in programs.items()
        ],
    }


_Rule = tuple[str, tuple[str, ...], tuple[str, ...]]
"""To the hub (ingress) or from it (egress), the messages of Zenoh's protocol, key expressions."""


def _agent(keys: Keys, names: tuple[str, ...], heard: Container[str]) -> list[_Rule]:
    to_hub = [key(name) for name in names for key in (keys.actuation, keys.telemetry)]
    to_hub += [keys.broadcast(name, "*") for name in names if name in heard]
    readable = tuple(key for n in names for key in (keys.sample(n), keys.broadcast("*", n)))
    return [
        ("ingress", ("put",), tuple(to_hub)),
        ("ingress", ("liveliness_token",), tuple(keys.alive(name) for name in names)),
        *_listening(keys, readable, keys.alive(PLANT), keys.alive(ROUTER)),
    ]


def _plant(keys: Keys) -> list[_Rule]:
    return [
        ("ingress", ("put",), keys.from_plant),
        ("ingress", ("liveliness_token",), (keys.alive(PLANT),)),
        ("ingress", ("declare_queryable", "reply"), (keys.scenario,)),
        ("egress", ("query",), (keys.scenario,)),
        *_listening(keys, keys.to_plant, keys.alive("*")),
    ]


def _viewer(keys: Keys, may_command: bool) -> list[_Rule]:
    """Allow a viewer what the hub drops if it is slow; a command also needs its secret."""
    return [
        *([("ingress", ("put",), (keys.command,))] if may_command else []),
        ("ingress", ("query",), (keys.scenario,)),
        ("egress", ("reply", "declare_queryable"), (keys.scenario,)),
        *_listening(keys, keys.to_viewers, keys.alive("*")),
    ]


def _router(keys: Keys) -> list[_Rule]:
    """Allow another hub all messages of the run: it has applied the same rules to them."""
    messages = (
        "put", "query", "reply", "declare_subscriber", "declare_queryable",
        "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
    )  # fmt: skip
    both: tuple[Literal["ingress", "egress"], ...] = ("ingress", "egress")
    return [(flow, messages, (keys.everything,)) for flow in both]


def _listening(keys: Keys, readable: tuple[str, ...], *tokens: str) -> Iterator[_Rule]:
    yield "ingress", ("declare_subscriber",), readable
    yield "egress", ("put",), readable
    yield "ingress", ("declare_liveliness_subscriber", "liveliness_query"), tokens
    yield "egress", ("liveliness_token",), tokens
    # Without it a publisher has no subscribers, and silently sends nothing.
    yield "egress", ("declare_subscriber",), (keys.everything,)
