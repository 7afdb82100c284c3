"""Who may say and see what: the rules by which the hub passes a message on, or does not.

What no rule allows is denied. The rules hold for sessions, each of which has shown at the hub's
door who it is: so nobody can put, declare or withdraw anything in another's name, whatever he
knows. Zenoh tells a denied sender nothing.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from phalanx.wire.keys import PLANT, VIEWER, Keys

Subject = Literal["usernames", "cert_common_names"]
"""By what Zenoh knows a session: the name with its password, or that in its certificate."""


def access_control(
    keys: Keys, agents: Mapping[str, tuple[str, ...]], subject: Subject = "usernames"
) -> dict[str, Any]:
    """Zenoh's `access_control` of one run's hub.

    Args:
        keys: the run's.
        agents: the programs that decide for agents, each with the names of those.
        subject: by what sessions are known.
    """
    programs = {VIEWER: _viewer(keys)}
    programs |= {program: _agent(keys, names) for program, names in agents.items()}
    rules = [
        {
            "id": f"{program} {flow} {' '.join(messages)}",
            "permission": "allow",
            "flows": [flow],
            "messages": list(messages),
            "key_exprs": list(key_exprs),
        }
        for program, allowed in programs.items()
        for flow, messages, key_exprs in allowed
    ]
    policies = [
        {"subjects": [name], "rules": [r["id"] for r in rules if str(r["id"]).split()[0] == name]}
        for name in programs
    ]
    subjects = [{"id": name, subject: [name]} for name in programs]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


_Rule = tuple[str, tuple[str, ...], tuple[str, ...]]
"""To the hub (ingress) or from it (egress), the messages of Zenoh's protocol, key expressions."""


def _agent(keys: Keys, names: tuple[str, ...]) -> list[_Rule]:
    own = [key(name) for name in names for key in (keys.actuation, keys.telemetry)]
    own += [keys.broadcast(name, "*") for name in names]
    seen = tuple(key for n in names for key in (keys.sample(n), keys.broadcast("*", n)))
    return [
        ("ingress", ("put",), tuple(own)),
        ("ingress", ("liveliness_token",), tuple(keys.alive(name) for name in names)),
        *_listening(keys, seen, keys.alive(PLANT)),
    ]


def _viewer(keys: Keys) -> list[_Rule]:
    """A viewer may see everything; its commands need the command secret besides."""
    return [
        ("ingress", ("put",), (keys.command,)),
        ("ingress", ("query",), (keys.scenario,)),
        ("egress", ("reply", "declare_queryable"), (keys.scenario,)),
        *_listening(keys, (keys.everything,), keys.alive("*")),
    ]


def _listening(keys: Keys, seen: tuple[str, ...], tokens: str) -> Iterator[_Rule]:
    yield "ingress", ("declare_subscriber",), seen
    yield "egress", ("put",), seen
    yield "ingress", ("declare_liveliness_subscriber", "liveliness_query"), (tokens,)
    yield "egress", ("liveliness_token",), (tokens,)
    # Without it a publisher believes that nobody listens, and sends nothing, silently.
    yield "egress", ("declare_subscriber",), (keys.everything,)
