"""Rooms of code on which a verdict rests, each with the tests that are nearest to it."""

from typing import NamedTuple

SEED = 3011
"""Of the places that are drawn in a room."""


class Room(NamedTuple):
    """Patterns of source files, and what pytest is called with."""

    sources: tuple[str, ...]
    tests: str


_PLANT, _CERTIFY = "plant/phalanx_plant", "packages/phalanx-certify"
_ATTACKS = "packages/phalanx-attacks"
_STUDIES = "packages/phalanx-studies"
ROOMS = {
    "rows": Room(
        ("phalanx/theory/rows/*.py", "phalanx/swarm/rows.py"),
        "tests/unit/theory/rows tests/unit/swarm tests/unit/agent",
    ),
    "margins": Room(
        ("phalanx/theory/margins/*.py",),
        "tests/unit/theory/margins tests/unit/swarm"
        " tests/process/verdicts/test_check.py::test_a_steeper_alpha_than_is_proven_is_a_gap",
    ),
    "certificate": Room(
        ("phalanx/guarantee/*.py",),
        "tests/unit/guarantee tests/unit/plant/test_claims.py tests/unit/plant/test_judge.py"
        " tests/unit/plant/test_real_time.py tests/process/verdicts/test_check.py"
        " tests/unit/scenario/test_user_classes.py tests/unit/promise/test_capture.py"
        " tests/unit/plant/test_promise_ledger.py",
    ),
    "proven-filter": Room(
        ("phalanx/guarantee/proven_filter.py",), "tests/unit/guarantee"
    ),
    "judge": Room(
        (f"{_PLANT}/judge/*.py",),
        "tests/unit/plant tests/unit/metrics/test_deadlock.py"
        " tests/unit/guarantee/test_reachable.py",
    ),
    "certify": Room((f"{_CERTIFY}/phalanx_certify/**/*.py",), f"{_CERTIFY}/tests"),
    "fault-rules": Room(
        ("phalanx/faults/*.py", "phalanx/network/rule.py", "phalanx/network/link.py"),
        "tests/unit/faults tests/unit/network tests/unit/scenario tests/unit/agent",
    ),
    "inbox": Room(
        ("phalanx/network/inbox.py",), "tests/unit/network tests/unit/agent tests/unit/messages"
    ),
    "clock": Room(
        ("agent/phalanx_agent/clock.py", f"{_PLANT}/clock/*.py", f"{_PLANT}/sampling/*.py"),
        "tests/unit/plant tests/unit/agent tests/unit/faults",
    ),
    "statistics": Room((f"{_STUDIES}/phalanx_studies/statistics.py",), f"{_STUDIES}/tests"),
    "coordinator": Room(
        tuple(f"{_STUDIES}/phalanx_studies/{name}.py" for name in ("coordinator", "[rsw]*")),
        f"{_STUDIES}/tests",
    ),
    "search": Room((f"{_ATTACKS}/phalanx_attacks/*.py",), f"{_ATTACKS}/tests"),
    "recording-reader": Room(
        ("phalanx/recording/*.py",),
        "tests/unit/recording tests/unit/hostile/test_files.py"
        " tests/unit/guarantee/test_disturbance_ledger.py",
    ),
    "identities": Room(
        ("phalanx/messages/*.py", "packages/phalanx-hosts/*/authority.py"),
        "tests/unit/identities tests/unit/messages packages/phalanx-hosts/tests"
        " tests/unit/hostile/test_messages.py tests/unit/network/test_rules.py"
        " tests/unit/plant/test_publisher.py",
    ),
    "cli-status": Room(
        ("phalanx/cli/*.py", "phalanx/launcher/verify.py", "phalanx/launcher/interrupt.py"),
        "tests/unit/cli tests/unit/launcher tests/process/verdicts/test_check_command.py",
    ),
}  # fmt: skip
