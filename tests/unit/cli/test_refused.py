"""Options that are refused: in one line that names them, before anything is made."""

import pytest

from phalanx.cli.app import USAGE_ERROR, status

REFUSED = [
    ("run unicycles --port 9000", "--port: expected --view"),
    ("run unicycles --view --port 0", "'--port'"),
    ("run unicycles --commands", "--commands"),
    ("run unicycles --seed x", "'--seed'"),
    ("run unicycles --seed=-1", "seed: expected greater than or equal to 0, got -1"),
    ("run unicycles --engine warp", "'--engine'"),
    ("run unicycles --engine in-process --view", "--engine in-process"),
    ("run unicycles --out file", "--out"),
    ("run unicycles --out file/runs", "--out"),
    ("run unicycles --real-time 0", "'--real-time'"),
    ("run unicycles --speed=-1", "'--speed'"),
    ("run unicycles --speed nan", "'--speed'"),
    ("run unicycles --listen tcp/0.0.0.0:7447", "--insecure"),
    ("run unicycles --listen tcp/127.0.0.1:99999", "'--listen'"),
    ("run unicycles --listen nonsense", "'--listen'"),
    ("run unicycles --set network.loss", "--set network.loss"),
    ("run unicycles --set network.loss=2", "network.loss: expected"),
    ("run nobody", "nobody: no such scenario"),
    ("check unicycles --plot missing/p.png", "'--plot'"),
    ("check unicycles --plot file/p.png", "'--plot'"),
    ("compare a b --html missing/x.html", "'--html'"),
    ("export a", "expected one of --html"),
    ("export a --html x.html --at 1", "--at: expected --png"),
    ("export a --html missing/x.html", "'--html'"),
    ("export a --png missing/x.png", "'--png'"),
    ("export a --mcap missing/x.mcap", "'--mcap'"),
    ("keys made --scenario nobody", "nobody: no such scenario"),
    ("keys made --scenario unicycles --days 0", "'--days'"),
    ("keys made --scenario unicycles --days nan", "'--days'"),
    ("keys file --scenario unicycles", "DIR"),
    ("tap nowhere", "nowhere: no run goes on there"),
    ("tap nowhere --count=-1", "'--count'"),
    ("view", "expected either RUN, or --connect and --run"),
    ("view a --port 0", "'--port'"),
    ("network fit nowhere", "nowhere"),
    ("plant --scenario unicycles --run a/b", "'--run'"),
    ("plant --scenario unicycles --run r --out file", "'--out'"),
    ("agent 1 --scenario unicycles --run a*b", "'--run'"),
    ("agent 1 --scenario unicycles --run r --timeout=-1", "'--timeout'"),
    ("view --connect tcp/127.0.0.1:7447 --run a/b", "'--run'"),
    ("ros2 a --timeout=-1", "'--timeout'"),
]


@pytest.mark.parametrize(("asked", "named"), REFUSED, ids=[asked for asked, _ in REFUSED])
def test_it_is_refused_in_a_line_and_nothing_is_made(tmp_path, monkeypatch, capsys, asked, named):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert status(asked.split()) == USAGE_ERROR
    said = [line for line in capsys.readouterr().err.splitlines() if "See phalanx" not in line]
    assert len(said) == 1
    assert named in said[0]
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
