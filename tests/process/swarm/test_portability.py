"""One trajectory on every CPU: other kernels, no vector units, another libm, the same bits."""

import numpy as np
import pytest

from phalanx.recording.read import read

pytestmark = [pytest.mark.swarm, pytest.mark.nightly]

FEATURES = np._core._multiarray_umath.__cpu_features__
DISPATCHED = np._core._multiarray_umath.__cpu_dispatch__
OTHER_CPUS = {
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": " ".join(f for f in DISPATCHED if FEATURES.get(f)),
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4",
}


@pytest.mark.parametrize(
    "scenario",
    [("unicycles", "duration=1"), ("formation3d", "duration=2"), ("guaranteed", "duration=1")],
)
def test_a_run_has_the_same_bits_on_another_cpu(phalanx, monkeypatch, scenario):
    name, duration = scenario
    command = ("run", name, "--set", duration, "--engine", "in-process")
    here = trajectory(phalanx(*command))
    for setting, value in OTHER_CPUS.items():
        monkeypatch.setenv(setting, value)
    assert trajectory(phalanx(*command)) == here


def trajectory(run) -> str:
    status, output = run.finish()
    assert status == 0, output
    summary = read(run.folder).summary
    assert summary is not None
    return summary.trajectory
