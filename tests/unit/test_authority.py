"""Certificates: who may do what with them, for how long, and who can read their keys."""

from __future__ import annotations

import datetime
import os
from pathlib import Path

import pytest

from milepost.config.errors import ConfigError
from milepost.security.authority import IDENTITY, ROOT, ROOT_KEY, Authority, expires_at, hosts_of

x509 = pytest.importorskip("cryptography.x509")


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    return Authority.create(tmp_path / "pki", "metro-1")


def issued(authority: Authority, folder: Path, **options):
    authority.issue(folder, "sensor-radar", **{"days": 7.0, **options})
    return x509.load_pem_x509_certificate((folder / IDENTITY).read_bytes())


def test_keys_are_readable_by_their_owner_alone_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        Authority.create(tmp_path / "pki", "metro-1").issue(tmp_path / "pki" / "fuser", "fuser", 7.0)
    finally:
        os.umask(before)
    for name in (ROOT_KEY, f"fuser/{IDENTITY}"):
        assert (tmp_path / "pki" / name).stat().st_mode & 0o777 == 0o600
    assert (tmp_path / "pki" / "fuser" / ROOT).stat().st_mode & 0o777 == 0o644
    assert b"PRIVATE KEY" not in (tmp_path / "pki" / "fuser" / ROOT).read_bytes()


def test_a_process_certificate_names_it_and_cannot_stand_for_a_router(authority: Authority, tmp_path: Path) -> None:
    certificate = issued(authority, tmp_path / "radar")
    assert certificate.subject.rfc4514_string() == "CN=sensor-radar"
    uses = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert [use.dotted_string for use in uses] == [x509.oid.ExtendedKeyUsageOID.CLIENT_AUTH.dotted_string]
    assert not certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    certificate.verify_directly_issued_by(authority.certificate)


def test_a_router_certificate_may_listen_under_its_names_and_addresses(authority: Authority, tmp_path: Path) -> None:
    certificate = issued(authority, tmp_path / "router", hosts=("router", "127.0.0.1", "::1"))
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["router"]
    assert [str(a) for a in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1", "::1"]
    assert hosts_of(tmp_path / "router" / IDENTITY) == ["router", "127.0.0.1", "::1"]
    assert hosts_of(tmp_path / "nobody") == []


def test_a_certificate_ends_after_its_days_and_began_a_little_before_now(authority: Authority, tmp_path: Path) -> None:
    now = datetime.datetime.now(datetime.UTC)
    certificate = issued(authority, tmp_path / "radar", days=2.0)
    assert abs(expires_at(tmp_path / "radar" / IDENTITY) - now - datetime.timedelta(days=2)) < datetime.timedelta(seconds=10)
    assert datetime.timedelta(0) < now - certificate.not_valid_before_utc < datetime.timedelta(minutes=6)


def test_an_authority_is_never_overwritten(authority: Authority, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is an authority already"):
        Authority.create(tmp_path / "pki", "metro-1")
    assert Authority.load(tmp_path / "pki").pem == authority.pem


def test_a_key_of_another_authority_is_refused_in_one_line(authority: Authority, tmp_path: Path) -> None:
    Authority.create(tmp_path / "other", "metro-1")
    (tmp_path / "other" / ROOT_KEY).replace(tmp_path / "pki" / ROOT_KEY)
    with pytest.raises(ConfigError, match=r"ca\.key: is not the key of ca\.pem"):
        Authority.load(tmp_path / "pki")


@pytest.mark.parametrize("content", [b"", b"no key", None])
def test_an_unusable_authority_is_refused_in_one_line(authority: Authority, tmp_path: Path, content: bytes | None) -> None:
    key = tmp_path / "pki" / ROOT_KEY
    key.unlink() if content is None else key.write_bytes(content)
    with pytest.raises(ConfigError, match=r"ca\.key: (no such file|not a readable authority)"):
        Authority.load(tmp_path / "pki")
