"""The folders that `phalanx keys` makes."""

import datetime
import os
import stat
from pathlib import Path

from cryptography import x509
from phalanx_hosts.authority import make_identities

from phalanx.messages.credentials import AUTHORITY, CERTIFICATE
from phalanx.messages.keys import PLANT, ROUTER


def test_only_their_owner_can_read_keys_or_look_into_their_folders(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        make_identities(tmp_path / "of/keys", [PLANT, "1"], [], datetime.timedelta(days=1))
    finally:
        os.umask(before)
    modes = {path: stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "of/keys").rglob("*")}
    assert stat.S_IMODE((tmp_path / "of/keys").stat().st_mode) == 0o700
    assert modes == {path: 0o700 if path.is_dir() else 0o600 for path in modes}
    assert len(modes) == 2 + 3 + 3, "two folders; the authority's key is in none"


def test_an_identity_signs_no_other_and_has_hosts_if_it_is_a_hubs(tmp_path: Path) -> None:
    make_identities(tmp_path, [PLANT, ROUTER, "1"], ["here"], datetime.timedelta(hours=1))
    for file in (f"1/{AUTHORITY}", *(f"{name}/{CERTIFICATE}" for name in (PLANT, ROUTER, "1"))):
        certificate = x509.load_pem_x509_certificate((tmp_path / file).read_bytes())
        of = {type(each.value): (each.critical, each.value) for each in certificate.extensions}
        signs, hosts = file.endswith(AUTHORITY), x509.SubjectAlternativeName([x509.DNSName("here")])
        usage = x509.KeyUsage(not signs, *(False,) * 4, signs, *(False,) * 3)
        constraints = x509.BasicConstraints(signs, 0 if signs else None)
        assert of[x509.KeyUsage] == (True, usage)
        assert of[x509.BasicConstraints] == (True, constraints)
        assert of.get(x509.SubjectAlternativeName) == (None if "1/" in file else (False, hosts))
        now = datetime.datetime.now(datetime.UTC)
        assert certificate.not_valid_before_utc < now < certificate.not_valid_after_utc
