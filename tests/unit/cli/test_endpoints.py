"""Nothing leaves its host unprotected, unless that is asked for."""

from pathlib import Path

import pytest

from phalanx.cli.app import USAGE_ERROR, status
from phalanx.cli.option_checks import endpoint_for, on_loopback, require_endpoint
from phalanx.launcher.live import announced
from phalanx.messages.membership import Membership

RUN = ("--scenario", "one-on-one", "--run", "r")


@pytest.mark.parametrize(
    ("endpoint", "here"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tls/127.3.2.1:7447", True),
        ("tcp/[::1]:7447", True),
        ("tcp/localhost:7447#iface=lo", True),
        ("unixsock-stream//run/phalanx.sock", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/10.0.0.1:7447", False),
        ("udp/127.0.0.1.example.org:7447", False),
        ("tcp/localhost.example.org:7447", False),
    ],
)
def test_whether_an_endpoint_is_for_its_own_host_alone(endpoint: str, here: bool) -> None:
    assert on_loopback(endpoint) is here


@pytest.mark.parametrize(
    "command",
    [
        ("plant", *RUN, "--listen", "tcp/0.0.0.0:7447"),
        ("plant", *RUN, "--connect", "tcp/10.0.0.1:7447"),
        ("router", *RUN, "--listen", "tcp/[::]:7447"),
        ("agent", "1", *RUN, "--connect", "tcp/10.0.0.1:7447"),
        ("viewer", "--run", "r", "--connect", "tcp/10.0.0.1:7447"),
        ("run", "one-on-one", "--listen", "tcp/0.0.0.0:7447"),
        ("router", *RUN, "--connect", "tcp/10.0.0.1:7447"),
        ("ros2", "a", "--router", "tcp/10.0.0.1:7447"),
    ],
)
def test_a_program_that_would_be_reached_unprotected_does_not_start(command, capsys) -> None:
    assert status(list(command)) == USAGE_ERROR
    said = " ".join(capsys.readouterr().err.split())
    assert "is not for this host alone: expected --" in said
    assert "--insecure" in said


@pytest.mark.parametrize("command", ["view", "ros2"])
def test_a_run_that_goes_on_elsewhere_by_its_folder_is_not_connected_to(
    command: str, tmp_path: Path, capsys
) -> None:
    """The folder may come from an attacker."""
    with announced(tmp_path, Membership("r", "tcp/10.0.0.1:7447", b"secret")):
        assert status([command, str(tmp_path)]) == USAGE_ERROR
    printed = " ".join(capsys.readouterr().err.split())
    assert "tcp/10.0.0.1:7447 is not for this host alone: expected --insecure" in printed


@pytest.mark.parametrize("who", [(), ("7",)])
def test_an_agent_is_one_of_the_scenarios(who, capsys) -> None:
    assert status(["agent", *who, *RUN]) == USAGE_ERROR
    assert "expected one of 1, 2, got" in " ".join(capsys.readouterr().err.split())


def test_the_folder_of_a_certificate_says_where_to_connect_unless_an_option_does(
    tmp_path: Path, capsys
) -> None:
    keys = tmp_path / "keys"
    assert status(["keys", str(keys), "--scenario", "one-on-one", "--host", "p.org"]) == 0
    assert "identities of plant, router, viewer, operator, 1, 2" in capsys.readouterr().out
    assert endpoint_for("", keys / "1") == "tls/p.org:7447"
    assert endpoint_for("tls/q.org:1", keys / "1") == "tls/q.org:1"
    assert endpoint_for("", None) == "tcp/127.0.0.1:7447"


@pytest.mark.parametrize("host", ["p.org", "my_plant", "10.0.0.1", "2001:db8::1"])
def test_a_certificate_for_a_host_says_an_endpoint_that_can_be_connected_to(
    tmp_path: Path, host: str
) -> None:
    keys = tmp_path / "keys"
    assert status(["keys", str(keys), "--scenario", "one-on-one", "--host", host]) == 0
    endpoint = endpoint_for("", keys / "1")
    assert require_endpoint(endpoint) == endpoint
    assert host in endpoint
