"""What is loaded ahead of a run."""

from importlib import import_module

from phalanx.launcher.libraries import _PROGRAMS
from phalanx.launcher.programs import PROGRAMS


def test_every_program_is_loaded_ahead():
    assert {place.partition(":")[0] for place in PROGRAMS.values()} <= set(_PROGRAMS)
    for name in _PROGRAMS:
        import_module(name)  # what cannot be imported would be passed over in silence
