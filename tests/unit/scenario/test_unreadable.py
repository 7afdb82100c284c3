"""Scenario files that cannot be read at all, and names that are no scenario's."""

import time
from pathlib import Path

import pytest

from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError


def test_a_file_that_is_not_toml_says_where(tmp_path):
    path = str(tmp_path / "broken.toml")
    Path(path).write_text("name = \n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"not valid TOML.*line 1") as error:
        load(path)
    assert str(error.value).startswith(path)


TOO_MUCH = {
    "lists": "x = " + "[" * 5000 + "]" * 5000,
    "fewer lists": "x = " + "[" * 100 + "]" * 100,
    "tables": "x = " + "{a=" * 3000 + "1" + "}" * 3000,
    "fewer tables": "x = " + "{a=" * 300 + "1" + "}" * 300,
    "parts of a key": ".".join(["a"] * 20_000) + " = 1",
    "parts of a table's key": "[" + " . ".join(["'a'"] * 2_000) + "]\nb = 1",
    "digits": "seed = " + "1" * 5000,
    "hexadecimal digits": "name = 0x" + "f" * 5000,
}

VALUES = [what for what in TOO_MUCH if "key" not in what]


@pytest.mark.parametrize("what", TOO_MUCH)
def test_too_much_of_something_is_refused_in_words(what, tmp_path):
    path = tmp_path / "much.toml"
    path.write_text(TOO_MUCH[what], encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"much\.toml: not valid TOML: ") as error:
        load(path)
    assert len(str(error.value)) < 300
    assert ("a key of more than 64 parts" in str(error.value)) == ("key" in what), "by tomllib"


def test_ten_thousand_mistakes_are_listed_as_soon_as_found(tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text("\n".join(f"a{i}.b = 1" for i in range(10_000)), encoding="utf-8")
    start = time.process_time()
    with pytest.raises(ScenarioError) as error:
        load(path)
    assert len(str(error.value).splitlines()) > 10_000
    assert time.process_time() - start < 3.0  # to compare each with each takes 8 s


@pytest.mark.parametrize(
    "override",
    [
        *(f"network.loss={TOO_MUCH[what].partition(' = ')[2]}" for what in VALUES),
        ".".join(["a"] * 20_000) + "=1",
        f"agents.{'1' * 5000}.role=normal",
    ],
    ids=[*VALUES, "parts of a path", "digits of an index"],
)
def test_too_much_in_an_override_is_refused_in_words(override):
    with pytest.raises(ScenarioError) as error:
        load("one-on-one", [override])
    assert len(str(error.value)) < 300


@pytest.mark.parametrize("group", [0, 1])
def test_an_empty_start_is_refused(group):
    with pytest.raises(ScenarioError, match=rf"agents\.{group}\.start: expected 2 components"):
        load("one-on-one", {f"agents.{group}.start": [[]]})


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("noise.toml", r"noise\.toml: cannot be read"),
        ("nowhere.toml", r"nowhere\.toml: cannot be read: .*No such file"),
        ("", "cannot be read: .*directory"),
    ],
    ids=["no text", "no file", "a folder"],
)
def test_a_path_that_cannot_be_read_is_named(tmp_path, name, message):
    (tmp_path / "noise.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match=message):
        load(f"{tmp_path}/{name}")


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("unicylces", "did you mean 'unicycles'?"),
        ("qqqq", "`phalanx scenarios` lists those that ship"),
    ],
)
def test_a_misspelt_name_gets_a_suggestion_and_another_the_command_that_lists_them(name, advice):
    with pytest.raises(ScenarioError) as error:
        load(name)
    assert str(error.value) == f"{name}: no such scenario; {advice}"
