"""`phalanx study`: wrong words are refused before anything runs."""

import pytest

from phalanx.cli.app import USAGE_ERROR, status


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("unicycles", "--vary", "network.los=0"), "network.los: unknown field"),
        (("unicycles", "--vary", "network.loss"), "--vary network.loss: expected PATH=VALUES"),
        (("unicycles", "--draw", "network.loss=normal(0,1)"), "expected uniform(a,b)"),
        (("unicycles", "--seeds", "many"), "study: seeds: expected seeds as 0:200 or 1,2,5"),
        (("unicycle",), "did you mean 'unicycles'?"),
        (("open",), "expected the folder of a study"),
        (("study.toml", "--seeds", "0:1000"), "study.toml has the whole plan: expected no seeds"),
        (("unicycles", "--row", "3"), "expected after `phalanx study open`"),
        (("open", "nowhere"), "study.toml: cannot be read"),
    ],
)
def test_a_wrong_word_is_refused_in_one_line(words, message, tmp_path, capsys):
    out = () if words[0] == "open" else ("--out", str(tmp_path / "study"))
    assert status(["study", *words, *out]) == USAGE_ERROR
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "study").exists()
