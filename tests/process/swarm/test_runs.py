"""A run from its file to its verdict: processes, determinism, network, and other CPUs."""

import contextlib
import multiprocessing
from collections.abc import Iterator

import numpy as np
import psutil
import pytest

from phalanx.recording.read import read
from phalanx.wire.session import free_endpoint

pytestmark = pytest.mark.swarm

SHORT = ("run", "unicycles", "--set", "duration=1.0")
RARELY = (
    *("run", "unicycles", "--set", "duration=0.5"),
    *("--set", "agents.0.clock.period=1.0", "--set", "agents.1.clock.period=1.0"),
)
"""Samples so far apart that nobody can prove anything for so long."""


def trajectory(run) -> str:
    status, output = run.finish()
    assert status == 0, output
    summary = read(run.folder).summary
    assert summary is not None
    return summary.trajectory


def test_a_run_ends_with_a_verdict_and_names_what_kept_it_from_a_guarantee(phalanx):
    status, output = phalanx(*RARELY).finish()
    assert status == 0
    assert "safe: no pair was outside the safe set at any integration step, but this" in output
    assert "certificates (" in output.splitlines()[-1]


def test_simulation_1_as_printed_ends_guaranteed_and_says_what_the_theorem_is_short_of(phalanx):
    status, output = phalanx(*SHORT, "--strict").finish()
    assert status == 0
    *_, theorem, verdict = output.splitlines()
    assert "guaranteed: every pair was proven safe at every instant" in verdict
    assert theorem.startswith("Proven by certificates. The paper's theorem alone would not have")
    assert "proven margin failed in 1 of 1 checks" in theorem


def test_strict_turns_safe_into_a_failure(phalanx):
    status, _ = phalanx(*RARELY, "--strict").finish()
    assert status == 1


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_trajectory_whatever_the_load(phalanx):
    quiet = {trajectory(phalanx(*SHORT)) for _ in range(3)}
    with busy_cores():
        loaded = {trajectory(phalanx(*SHORT)) for _ in range(2)}
    assert quiet == loaded
    assert len(quiet) == 1


def test_agents_that_reach_the_same_plant_from_elsewhere_make_the_same_run(
    phalanx, tmp_path, monkeypatch
):
    """Plant and agents started by hand, as on several hosts, give the launcher's trajectory."""
    endpoint, out = free_endpoint(), tmp_path / "plant"
    out.mkdir()
    monkeypatch.setenv("PHALANX_SECRET", "s")
    common = ("--scenario", "one-on-one", "--set", "duration=0.5", "--run", "r")
    plant = phalanx("plant", *common, "--listen", endpoint, "--folder", str(out))
    agents = [phalanx("agent", name, *common, "--connect", endpoint) for name in "12"]
    assert plant.finish()[0] == 0
    assert [agent.finish()[0] for agent in agents] == [0] * 2
    together = read(out).summary
    alone = trajectory(phalanx("run", "one-on-one", "--set", "duration=0.5"))
    assert together is not None
    assert together.trajectory == alone


def test_an_agent_with_another_scenario_is_refused_by_name(phalanx, tmp_path):
    endpoint = free_endpoint()
    common = ("--scenario", "unicycles", "--run", "r")
    plant = phalanx("plant", *common, "--listen", endpoint, "--folder", str(tmp_path))
    phalanx("agent", "3", *common, "--connect", endpoint, "--seed", "5")
    status, output = plant.finish()
    assert status == 3
    assert "agent 3 runs another scenario, seed or version" in output


@contextlib.contextmanager
def busy_cores() -> Iterator[None]:
    """Every core kept busy by other work."""
    context = multiprocessing.get_context("spawn")
    work = [context.Process(target=spin, daemon=True) for _ in range(psutil.cpu_count())]
    for process in work:
        process.start()
    yield
    for process in work:
        process.kill()
        process.join()


def spin() -> None:
    while True:
        pass


FEATURES = np._core._multiarray_umath.__cpu_features__
DISPATCHED = np._core._multiarray_umath.__cpu_dispatch__
OTHER_CPUS = {
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": " ".join(f for f in DISPATCHED if FEATURES.get(f)),
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4",
}


@pytest.mark.nightly
@pytest.mark.parametrize(
    "scenario",
    [("unicycles", "duration=1"), ("formation3d", "duration=2"), ("guaranteed", "duration=1")],
)
@pytest.mark.nightly
def test_a_run_has_the_same_bits_on_another_cpu(phalanx, monkeypatch, scenario):
    name, duration = scenario
    command = ("run", name, "--set", duration, "--engine", "in-process")
    here = trajectory(phalanx(*command))
    for setting, value in OTHER_CPUS.items():
        monkeypatch.setenv(setting, value)
    assert trajectory(phalanx(*command)) == here
