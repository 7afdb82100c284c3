"""Libraries that are loaded ahead of a run."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from phalanx.launcher.libraries import _PROGRAMS
from phalanx.launcher.programs import PROGRAMS

ASKS = """
import os
from phalanx.launcher.libraries import start_loading

if __name__ == "__main__":
    child = start_loading().Process(target=print, args=("there",), kwargs={"flush": True})
    child.start()
    child.join()
    print(os.environ.get("PYTHONPATH"), os.environ.get("PYTHONSAFEPATH"))
"""
WRONG = 'print("the wrong phalanx", flush=True)\n'


def test_every_program_is_loaded_ahead():
    assert {place.partition(":")[0] for place in PROGRAMS} <= set(_PROGRAMS)
    for name in _PROGRAMS:
        import_module(name)  # multiprocessing ignores a module that cannot be imported


@pytest.mark.slow
def test_it_is_loaded_from_where_the_launcher_has_it_and_not_from_the_working_directory(
    tmp_path: Path,
) -> None:
    script, elsewhere = tmp_path / "script" / "asks.py", tmp_path / "elsewhere"
    (elsewhere / "phalanx").mkdir(parents=True)
    (elsewhere / "phalanx" / "__init__.py").write_text(WRONG)
    script.parent.mkdir()
    script.write_text(ASKS)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"}
    environment["PYTHONPATH"] = str(Path(__file__).parents[3])
    ended = subprocess.run(
        [sys.executable, script], cwd=elsewhere, env=environment, capture_output=True, text=True
    )
    assert ended.stdout == f"there\n{environment['PYTHONPATH']} None\n", ended.stderr
