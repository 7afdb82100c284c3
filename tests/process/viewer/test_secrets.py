"""No file of a run holds a secret of it, and its logs are for its user alone."""

import contextlib
import stat
import urllib.request
from pathlib import Path

import pytest
from phalanx_viewer.pages import LivePage

from phalanx.launcher.live import LIVE
from phalanx.messages.keys import OPERATOR, PLANT, ROUTER, SHARED, VIEWER
from phalanx.messages.membership import Membership
from phalanx.scenario.load import load
from tests.process.leaks import files_of, leaks
from tests.process.runs import COMMAND_SECRET, HELD, SECRET, free_port, live_run, wait_for

pytestmark = pytest.mark.swarm

TOKEN = "the-token-of-the-page"


def secrets(run: str) -> dict[str, bytes]:
    """Every secret of a run of two agents, by its name."""
    member = Membership(run, "", SECRET)
    names = (PLANT, VIEWER, OPERATOR, ROUTER, SHARED, "1", "2")
    keys = {f"key of {name!r}": member.key_of(name) for name in names}
    passwords = {f"password of {name!r}": member.password_of(name).encode() for name in names}
    shared = {"token": TOKEN.encode(), "secret": SECRET, "command secret": COMMAND_SECRET}
    return {**shared, **keys, **passwords}


def test_no_file_of_a_run_holds_a_secret_and_its_logs_are_its_users_alone(tmp_path: Path) -> None:
    folder = tmp_path / "run"

    def served() -> bool:
        with contextlib.suppress(OSError), urllib.request.urlopen(page.url, timeout=60) as answer:
            return answer.status == 200
        return False

    with (
        LivePage(free_port(), COMMAND_SECRET, TOKEN) as page,
        live_run(load("one-on-one", ["duration=0.3"]), folder, HELD) as run,
    ):
        wait_for((folder / LIVE).exists)
        page.serve(folder)
        wait_for(served)
        during = files_of(folder / "logs")
        run.set_speed(0.0)
        run.summary()
        log = folder / "logs" / "viewer.log"
        wait_for(lambda: "evaluating h" in log.read_text())  # it goes on with the replay
        modes = {file.name: stat.S_IMODE(file.stat().st_mode) for file in log.parent.iterdir()}
    after = files_of(folder)
    assert TOKEN in page.url
    assert leaks(secrets("run"), during) == leaks(secrets("run"), after) == []
    assert modes == dict.fromkeys(modes, 0o600)
    assert {"viewer.log", "plant.log", "programs.log", "1.log"} <= set(modes)
