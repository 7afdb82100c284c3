"""The Python API, as a researcher meets it."""

import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import polars as pl
import pytest

import phalanx
from tests.process.runs import free_port, wait_for

SHORT = {"duration": 1.0, "network.loss": 0.3, "network.delay": 0.004}


@pytest.fixture(scope="module")
def run() -> phalanx.Run:
    """A short run with a bad network."""
    return phalanx.run(phalanx.load("unicycles", SHORT, seed=3), engine="in-process")


def test_the_public_names_are_there_and_documented():
    for name in phalanx.__all__:
        assert getattr(phalanx, name).__doc__, name
    assert set(phalanx.__all__) <= set(dir(phalanx))
    with pytest.raises(AttributeError, match="no attribute 'walk'"):
        _ = phalanx.walk


def test_to_import_phalanx_is_not_to_import_it():
    check = "import phalanx, sys; sys.exit(any(m.startswith('phalanx.') for m in sys.modules))"
    subprocess.run([sys.executable, "-c", check], cwd=Path(__file__).parents[2], check=True)


def test_states_are_a_table_with_a_row_for_each_event(run: phalanx.Run):
    assert run.states.columns[:7] == [
        "run", "scenario", "seed", "t", "h_tot", "1.x", "1.y"
    ]  # fmt: skip
    assert run.states.width == 5 + 5 * 3
    assert run.states["t"].is_sorted()
    assert run.states["t"][-1] == 1.0


def test_h_of_every_pair_is_that_of_the_states(run: phalanx.Run):
    x, h = run.states, run.h
    assert h.height == x.height
    tip = {
        n: (x[f"{n}.x"] + 0.25 * x[f"{n}.theta"].cos(), x[f"{n}.y"] + 0.25 * x[f"{n}.theta"].sin())
        for n in "14"
    }
    by_hand = 1.0 - sum((a - b) ** 2 for a, b in zip(tip["1"], tip["4"], strict=True))
    assert (h["1-4"] - by_hand).abs().max() < 1e-12
    pairs = h.drop("run", "scenario", "seed", "t")
    assert (pairs.select(pl.max_horizontal(pl.all())).to_series() <= x["h_tot"] + 1e-9).all()


def test_inputs_have_a_row_for_each_step_with_named_components(run: phalanx.Run):
    inputs = run.inputs
    assert inputs.height == run.summary.steps
    assert {"agent", "k", "t", "t_apply", "origin", "u.nu", "u.omega", "nominal.nu"} <= set(
        inputs.columns
    )
    counts = dict(inputs["origin"].value_counts().iter_rows())
    assert {o: counts.get(o, 0) for o in run.summary.origins} == run.summary.origins
    assert inputs["u.nu"].abs().max() <= 4.0 + 1e-5


def test_links_tell_the_fate_of_every_broadcast(run: phalanx.Run):
    links = run.links
    assert 0.2 < links["lost"].mean() < 0.4
    assert set(links.filter(~pl.col("lost"))["delay"]) == {0.004}
    assert links.filter(pl.col("lost"))["delay"].null_count() == links["lost"].sum()


def test_a_run_is_opened_again_by_its_folder_given_as_a_text(tmp_path: Path):
    first = phalanx.run(phalanx.load("pinned"), engine="in-process", out=str(tmp_path))
    again = phalanx.open(str(first.folder))
    assert again.verdict == phalanx.Outcome.VIOLATED
    assert again.states.equals(first.states)
    assert again.scenario == first.scenario
    assert "violated" in again._repr_html_()
    assert again.report().is_file()


def test_a_run_without_a_folder_of_its_own_leaves_nothing_behind():
    run = phalanx.run(phalanx.load("pinned"), engine="in-process")
    folder = run.folder
    assert folder.is_dir()
    del run
    assert not folder.exists()


def test_progress_is_reported_while_the_run_goes_on():
    statuses: list[phalanx.Status] = []
    phalanx.run(phalanx.load("unicycles", {"duration": 3.0}), engine="in-process",
                progress=statuses.append)  # fmt: skip
    assert [status.t for status in statuses] == sorted(status.t for status in statuses)
    assert 0 < statuses[-1].t <= 3.0


@pytest.mark.swarm
def test_a_replay_is_served_until_it_is_closed(run: phalanx.Run):
    # A port of its own: another process may take the next free one meanwhile.
    with run.view(free_port()) as page:
        assert urllib.request.urlopen(page.url, timeout=60).status == 200
        assert page.url in page._repr_html_()
        assert f"phalanx view {run.folder}" in page._repr_html_()  # where a frame stays blank
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(page.url, timeout=5)


VIEWS = """
import os, signal, sys, phalanx
print(phalanx.open(sys.argv[1]).view(int(sys.argv[2])).url, flush=True)
"""


@pytest.mark.swarm
@pytest.mark.parametrize(
    "end",
    [pytest.param("", marks=pytest.mark.nightly), "os.kill(os.getpid(), signal.SIGKILL)"],
    ids=["returns", "is killed"],
)
def test_a_replay_ends_with_the_program_that_serves_it(run: phalanx.Run, end: str):
    def refused() -> bool:
        try:
            urllib.request.urlopen(url, timeout=5).close()
        except OSError:
            return True
        return False

    command = [sys.executable, "-c", VIEWS + end, str(run.folder), str(free_port())]
    url = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False).stdout.strip()
    assert url.startswith("http://")
    wait_for(refused, 30.0)


@pytest.mark.swarm
def test_a_page_that_cannot_be_served_says_why(run: phalanx.Run):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(RuntimeError, match=f"cannot listen on 127.0.0.1:{port}"):
            run.view(port)


LEAVES = """
import sys, phalanx
run = phalanx.start(phalanx.load("unicycles", {"duration": 0.2}), out=sys.argv[1])
run.until(0.1)
raise SystemExit("in the middle")
"""


def test_a_stepped_run_that_its_program_leaves_is_on_record(tmp_path: Path) -> None:
    process = subprocess.run(
        [sys.executable, "-c", LEAVES, str(tmp_path)], check=False, capture_output=True, text=True
    )
    assert process.stderr == "in the middle\n"
    run = phalanx.open(tmp_path / "unicycles-1")
    assert run.verdict is phalanx.Outcome.STOPPED
    assert run.states["t"].max() > 0.09
