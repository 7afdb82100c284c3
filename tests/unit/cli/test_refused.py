"""Options that are refused: in one line that names them, before anything is made."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from phalanx.cli.app import USAGE_ERROR, status
from phalanx.cli.option_checks import require_timeout
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space

REFUSED = [
    ("run unicycles --port 9000", "--port: expected --view"),
    ("run unicycles --view --port 0", "'--port'"),
    ("run unicycles --commands", "--commands"),
    ("run unicycles --seed x", "'--seed'"),
    ("run unicycles --seed=-1", "seed: expected greater than or equal to 0, got -1"),
    ("run unicycles --engine warp", "'--engine'"),
    ("run unicycles --engine in-process --view", "--engine in-process"),
    ("run unicycles --out file", "--out"),
    ("run unicycles --out file/runs", "--out"),
    ("run unicycles --real-time 0", "'--real-time'"),
    ("run unicycles --speed=-1", "'--speed'"),
    ("run unicycles --speed nan", "'--speed'"),
    ("run unicycles --listen tcp/0.0.0.0:7447", "--insecure"),
    ("run worlds/ros2-robots --set world.router=tcp/192.0.2.1:7447", "--insecure"),
    ("run worlds/ros2-robots --set world.router=tls/robot:7447", "--insecure"),
    ("run worlds/ros2-robots --dry-run --set world.router=nonsense", "--insecure"),
    ("plant --scenario worlds/ros2-robots --run r --set world.router=tcp/a:7447", "--insecure"),
    ("run unicycles --listen tcp/127.0.0.1:99999", "'--listen'"),
    ("run unicycles --listen nonsense", "'--listen'"),
    ("run unicycles --dry-run", "--dry-run: expected a world of robots"),
    ("run unicycles --set network.loss", "--set network.loss"),
    ("run unicycles --set network.loss=2", "network.loss: expected"),
    ("run nobody", "nobody: no such scenario"),
    ("export a", "expected one of --html"),
    ("export a --html missing/x.html", "'--html'"),
    ("export a --mcap missing/x.mcap", "'--mcap'"),
    ("keys made --scenario nobody", "nobody: no such scenario"),
    ("keys made --scenario unicycles --days 0", "'--days'"),
    ("keys made --scenario unicycles --days nan", "'--days'"),
    ("keys file --scenario unicycles", "DIR"),
    ("view", "expected either RUN or --run"),
    ("view a --port 0", "'--port'"),
    ("plant --scenario unicycles --run a/b", "'--run'"),
    ("plant --scenario unicycles --run r --folder file", "'--folder'"),
    ("agent 1 --scenario unicycles --run a*b", "'--run'"),
    ("run unicycles --set safety.audit=true", "safety.audit: unknown field (misspelt, or ret"),
    ("agent 1 --scenario unicycles --run r --timeout=-1", "'--timeout'"),
    ("view --connect tcp/127.0.0.1:7447 --run a/b", "'--run'"),
    ("ros2 a --timeout=-1", "'--timeout'"),
    ("run unicycles --out=", "--out: expected a value"),
    ("run unicycles --speed inf", "'--speed'"),
    ("run unicycles --listen foo/127.0.0.1:7447", "'--listen'"),
    ("run unicycles --listen tcp/127.0.0.1:0", "'--listen'"),
    ("run unicycles --listen tcp/:7447", "'--listen'"),
    ("run unicycles --set agents=[]", "agents: expected at least 1 item"),
    ('run unicycles --set faults=[{kind="none"}]', "faults.0: expected one of 'partition'"),
    ("run .", ".: cannot be read: Is a directory"),
    ("export a --html .", "'--html'"),
    ("export a --csv file", "'--csv'"),
    ("export a --parquet file/tables", "'--parquet'"),
    ("keys made --scenario unicycles --host=", "--host: expected a value"),
    ("keys made --scenario unicycles --host a/b", "'--host'"),
    ("keys made --scenario unicycles --host übel.org", "'--host'"),
    ("plant --scenario unicycles --run=", "--run: expected a value"),
    ("plant --scenario unicycles --run r --speed inf", "'--speed'"),
    ("plant --scenario unicycles --run r --listen nonsense", "'--listen'"),
    ("agent 1 --scenario unicycles --run r --timeout inf", "'--timeout'"),
    ("agent --scenario unicycles --run r", "got no name"),
    ("router --scenario unicycles --run r --connect nonsense", "'--connect'"),
    ("viewer --run r --timeout inf", "'--timeout'"),
    ("ros2 a --router nonsense", "'--router'"),
    ("run unicycles --secret s", "--secret: every user of this host can read"),
    ("agent 1 --scenario unicycles --run r --secret=s", "in the environment, PHALANX_SECRET,"),
    (
        "viewer --run r --command-secret s",
        "PHALANX_COMMAND_SECRET, or in a file, --command-secret-",
    ),
    ("plant --scenario unicycles --run r --command-secret=s", "make a new secret"),
    ("view a --command-secret-file file", "expected a secret in file, got nothing"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("asked", "named"), REFUSED, ids=[asked for asked, _ in REFUSED])
def test_it_is_refused_in_a_line_and_nothing_is_made(tmp_path, monkeypatch, capsys, asked, named):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert status(asked.split()) == USAGE_ERROR
    lines = [line for line in capsys.readouterr().err.splitlines() if "See phalanx" not in line]
    assert len(lines) == 1
    assert named in lines[0]
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_wait_may_be_none_and_as_long_as_a_million_seconds():
    assert [require_timeout(wait) for wait in (None, 0.0, 0.5, 1e6)] == [None, 0.0, 0.5, 1e6]
    for wait in (-0.5, 1e6 + 1.0, float("nan")):
        with pytest.raises(typer.BadParameter, match=r"expected 0 to 1000000 s, got "):
            require_timeout(wait)


def test_an_empty_argument_is_refused_with_its_place(capsys):
    for asked in (["run", ""], ["export", "a", "--csv", ""]):
        assert status(asked) == USAGE_ERROR
        named = asked[-2] if asked[-2].startswith("--") else "an argument"
        assert f"{named}: expected a value, got an empty text" in capsys.readouterr().err


def test_a_plant_does_not_write_over_a_recording(tmp_path, capsys):
    (tmp_path / "recording.mcap").write_bytes(b"kept")
    command = ["plant", "--scenario", "unicycles", "--run", "r", "--folder", str(tmp_path)]
    assert status(command) == USAGE_ERROR
    assert "--folder: expected one without a recording" in capsys.readouterr().err
    assert (tmp_path / "recording.mcap").read_bytes() == b"kept"


def test_a_plant_that_cannot_listen_leaves_no_recording_in_the_way_of_the_next(tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        endpoint = f"tcp/127.0.0.1:{listener.getsockname()[1]}"
        command = ["plant", "--scenario", "one-on-one", "--run", "r", "--listen", endpoint]
        assert status([*command, "--folder", str(tmp_path)]) == 3
    assert f"cannot listen on {endpoint}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a run of a second without steps, in a file of another name."""
    scenario, run = swarm_in_space(2, 1, {}), tmp_path_factory.mktemp("run")
    folder = record(run, scenario, drift(scenario, steps=0), summary_of(scenario))
    return (folder / "recording.mcap").rename(folder / "mine.mcap")


@pytest.mark.slow
def test_a_recording_is_reported_whatever_its_file_is_called(recording, capsys):
    assert status(["report", str(recording)]) == 0
    assert str(recording.parent / "report.html") in capsys.readouterr().out


@pytest.mark.parametrize("command", ["verify", "certify"])
def test_a_recording_without_a_state_is_neither_verified_nor_certified(tmp_path, capsys, command):
    folder = record(tmp_path, swarm_in_space(2, 1, {}), [], None)
    assert status([command, str(folder)]) == 3
    assert "the recording holds no state" in capsys.readouterr().err


@pytest.mark.parametrize("linked", [False, True], ids=["by its name", "by a link"])
def test_a_recording_is_not_written_over_by_what_is_made_of_it(recording, tmp_path, capsys, linked):
    before, link = recording.read_bytes(), tmp_path / "link"
    link.symlink_to(recording)
    made = link if linked else recording
    assert status(["export", str(recording), "--mcap", str(made)]) == USAGE_ERROR
    assert "expected another file than the recording" in capsys.readouterr().err
    assert recording.read_bytes() == before


@pytest.mark.slow
def test_a_full_disk_under_the_output_is_reported_in_a_line():
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "phalanx", "scenarios"]
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 3
    assert ended.stderr == "[Errno 28] No space left on device\n"
