"""A user's modules in a recording: which are recorded, and which are refused."""

import hashlib
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import Writer

from phalanx.recording.modules import MEDIA_TYPE, MODULES
from phalanx.recording.read import UnreadableRecordingError, read
from phalanx.recording.records import RECORDING
from phalanx.recording.write import RecordingWriter
from phalanx.scenario.load import load
from phalanx.scenario.model import to_json
from phalanx.schema.user_code import imported_sources

LAW = """
from phalanx.extend import TrackVelocity

from .gains import GAIN

class Mine(TrackVelocity):
    gain = GAIN
    def later(self):
        from . import late
"""
HARMLESS = b"GAIN = 1\n"


@pytest.fixture
def package(tmp_path, monkeypatch, request):
    """A package of the user's in the working directory, under a name that no other test has."""
    name = f"user_{hashlib.sha256(request.node.name.encode()).hexdigest()[:12]}"
    folder = tmp_path / name
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "law.py").write_text(LAW)
    (folder / "gains.py").write_bytes(HARMLESS)
    (folder / "late.py").write_text("")
    (folder / "unused.py").write_text("")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    return folder


def scenario_of(package: Path):
    return load("one-on-one", {"agents.0.law.type": f"{package.name}.law:Mine"})


def test_a_named_module_is_recorded_with_what_it_imports_and_nothing_else(package, tmp_path):
    scenario = scenario_of(package)
    (package / "gains.py").write_text("GAIN = 2\n")  # what was imported is what counts
    with RecordingWriter(tmp_path / RECORDING, scenario, "run-1"):
        pass
    recorded = {p: s for p, s in imported_sources().items() if p.startswith(package.name)}
    assert recorded == {
        f"{package.name}/__init__.py": b"",
        f"{package.name}/law.py": LAW.encode(),
        f"{package.name}/gains.py": HARMLESS,
        f"{package.name}/late.py": b"",
    }
    content = (tmp_path / RECORDING).read_bytes()
    for path, source in recorded.items():
        assert path.encode() in content
        assert hashlib.sha256(source).hexdigest().encode() in content
    assert b"unused.py" not in content


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (b"#" * 2**20 + b"\n" + HARMLESS, "1048576"),
        (b"# coding: latin-1\n# \xe9\nGAIN = 1\n", "UTF-8"),
    ],
)
def test_modules_that_may_not_be_recorded_are_left_out_and_the_log_says_so(
    package, tmp_path, source, words
):
    (package / "gains.py").write_bytes(source)
    with RecordingWriter(tmp_path / RECORDING, scenario_of(package), "run-1") as writer:
        writer._writer.finish()
    recording = read(tmp_path / RECORDING)
    assert MEDIA_TYPE.encode() not in (tmp_path / RECORDING).read_bytes()
    assert words in recording.log[0].text


def test_one_whose_scenario_needs_code_says_what_it_brought(tmp_path):
    scenario = to_json(load("one-on-one")).replace('"pursue"', '"far:Mine"')
    path = recording_with(tmp_path, {"far.py": HARMLESS}, scenario=scenario)
    with pytest.raises(UnreadableRecordingError, match=r"\(recorded with it: far\.py\)$"):
        read(path)


def recording_with(
    folder: Path,
    modules: dict[str, bytes],
    hashes: dict[str, str] | None = None,
    scenario: str = "",
) -> Path:
    """Make a recording with these modules, as an attacker might."""
    path = folder / RECORDING
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        right = {name: hashlib.sha256(source).hexdigest() for name, source in modules.items()}
        writer.add_metadata(MODULES, right if hashes is None else hashes)
        for name, source in modules.items():
            writer.add_attachment(0, 0, name, MEDIA_TYPE, source)
        content = (scenario or to_json(load("one-on-one"))).encode()
        writer.add_attachment(0, 0, "scenario.json", "application/json", content)
        writer.finish()
    return path


@pytest.mark.parametrize("trust", [False, True])
@pytest.mark.parametrize(
    ("modules", "hashes"),
    [
        ({"../outside.py": HARMLESS}, None),
        ({"a/../../outside.py": HARMLESS}, None),
        ({"/tmp/outside.py": HARMLESS}, None),
        ({"C:\\outside.py": HARMLESS}, None),
        ({"a//outside.py": HARMLESS}, None),
        ({"outside.pth": HARMLESS}, None),
        ({"out\0side.py": HARMLESS}, None),
        ({".py": HARMLESS}, None),
        ({"phalanx/agent.py": HARMLESS}, None),
        ({"json.py": HARMLESS}, None),
        ({"long.py": b"#" * (2**20 + 1)}, None),
        ({"a.py": b"#" * 2**19, "b.py": b"#" * 2**19, "c.py": HARMLESS}, None),
        ({"latin.py": b"# \xe9\n"}, None),
        ({"altered.py": HARMLESS}, {"altered.py": "0" * 64}),
        ({"unlisted.py": HARMLESS}, {}),
        ({}, {"missing.py": "0" * 64}),
    ],
)
def test_malformed_modules_are_refused_in_one_line_and_nothing_is_written(
    tmp_path, monkeypatch, modules, hashes, trust
):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    path = recording_with(tmp_path, modules, hashes)
    before = set(tmp_path.rglob("*"))
    with pytest.raises(UnreadableRecordingError, match="module") as refused:
        read(path, trust)
    assert len(str(refused.value).splitlines()) == 1
    assert set(tmp_path.rglob("*")) == before


def test_a_module_that_differs_from_the_imported_one_is_refused_without_trust_too(
    package, tmp_path
):
    scenario_of(package)
    path = recording_with(tmp_path, {f"{package.name}/gains.py": b"GAIN = 2\n"})
    with pytest.raises(UnreadableRecordingError, match=r"another .*gains\.py was imported before"):
        read(path)


OPEN_BOTH = """
import sys
from pathlib import Path
from phalanx.recording.read import UnreadableRecordingError, read
for path in sys.argv[1:]:
    try:
        read(Path(path), trust=True)
        __import__("common")
        print("read")
    except UnreadableRecordingError as error:
        print(error)
"""


@pytest.mark.slow
def test_a_module_that_another_of_its_name_stands_for_is_refused(tmp_path):
    paths = []
    for name, gain in (("one", b"1"), ("same", b"1"), ("other", b"2")):
        (tmp_path / name).mkdir()
        paths.append(recording_with(tmp_path / name, {"common.py": b"GAIN = " + gain}))
    ended = subprocess.run(
        [sys.executable, "-c", OPEN_BOTH, *paths], capture_output=True, text=True, cwd=tmp_path
    )
    one, same, other = ended.stdout.splitlines()
    assert (one, same) == ("read", "read")
    assert (
        other
        == f"{paths[2]}: another common.py was imported before: open it in a program of its own"
    )


def test_modules_of_a_recording_that_is_not_trusted_are_put_nowhere(tmp_path, monkeypatch):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    before = list(sys.path)
    read(recording_with(tmp_path, {"elsewhere.py": HARMLESS}))
    assert sys.path == before
    assert not list(temporary.iterdir())
