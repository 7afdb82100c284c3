"""Scenario files that cannot be read at all, and names that are no scenario's."""

from pathlib import Path

import pytest

from phalanx.scenario.load import ScenarioError, load


def test_a_file_that_is_not_toml_says_where(tmp_path):
    path = str(tmp_path / "broken.toml")
    Path(path).write_text("name = \n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"not valid TOML.*line 1") as error:
        load(path)
    assert str(error.value).startswith(path)


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "noise.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match=r"noise\.toml: cannot be read"):
        load(str(path))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ScenarioError, match=r"nowhere\.toml: cannot be read: .*No such file"):
        load(str(tmp_path / "nowhere.toml"))


def test_a_folder_is_not_a_scenario(tmp_path):
    with pytest.raises(ScenarioError, match=r"cannot be read: .*directory"):
        load(f"{tmp_path}/")


def test_a_misspelt_shipped_name_gets_a_suggestion_and_no_list():
    with pytest.raises(ScenarioError) as error:
        load("unicylces")
    assert str(error.value) == "unicylces: no such scenario; did you mean 'unicycles'?"


def test_a_name_like_no_other_gets_the_command_that_lists_them():
    with pytest.raises(ScenarioError) as error:
        load("qqqq")
    assert str(error.value) == "qqqq: no such scenario; `phalanx scenarios` lists those that ship"
