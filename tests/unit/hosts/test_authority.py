"""The folders that `phalanx keys` makes."""

import datetime
import os
import stat
from pathlib import Path

from phalanx.hosts.authority import make_identities
from phalanx.messages.keys import PLANT


def test_only_their_owner_can_read_keys_or_look_into_their_folders(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        make_identities(tmp_path / "keys", [PLANT, "1"], [], datetime.timedelta(days=1))
    finally:
        os.umask(before)
    modes = {path: stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "keys").rglob("*")}
    assert stat.S_IMODE((tmp_path / "keys").stat().st_mode) == 0o700
    assert modes == {path: 0o700 if path.is_dir() else 0o600 for path in modes}
    assert len(modes) == 2 + 3 + 3, "two folders; the authority's key is in none"
