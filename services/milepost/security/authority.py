"""A train's own certificate authority: its key, and certificates for processes, tools and routers."""

from __future__ import annotations

import datetime
import ipaddress
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from milepost.config.errors import ConfigError

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

DEFAULT_DAYS = 7.0
AUTHORITY_DAYS = 3650.0
# clocks of hosts differ
BACKDATED = datetime.timedelta(minutes=5)
ROOT, ROOT_KEY = "ca.pem", "ca.key"
# key and certificate of one process
IDENTITY = "identity.pem"
AUTHORITY_OF = "milepost authority of "


def need_cryptography() -> None:
    """Raises ConfigError where the library is not installed."""
    try:
        import cryptography  # noqa: F401
    except ImportError as error:
        text = "needs the library cryptography: pip install ./schemas '.[security]'"
        raise ConfigError("pki", "", text) from error


def write_private(path: Path, content: bytes) -> None:
    """Write a whole file or none, readable from its first byte on by its owner alone: that of its folder."""
    _write(path, content, 0o600)


def write_public(path: Path, content: bytes) -> None:
    """Write a whole file or none."""
    _write(path, content, 0o644)


def _write(path: Path, content: bytes, mode: int) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.unlink(missing_ok=True)
    try:
        with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            # the mode above passes the umask, which may take more away than it should
            os.fchmod(file.fileno(), mode)
            folder = path.parent.stat()
            if folder.st_uid != os.geteuid():
                os.fchown(file.fileno(), folder.st_uid, folder.st_gid)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


@dataclass(frozen=True)
class Authority:
    """Signs certificates. Its key stays in its folder, which no process of a train needs to read."""

    certificate: x509.Certificate
    key: EllipticCurvePrivateKey

    @classmethod
    def create(cls, folder: Path, train: str, days: float = AUTHORITY_DAYS) -> Authority:
        """A new authority in a folder. Raises ConfigError where there is one, OSError."""
        need_cryptography()
        from cryptography.hazmat.primitives.asymmetric import ec

        if (folder / ROOT_KEY).exists() or (folder / ROOT).exists():
            raise ConfigError(folder / ROOT, "", "there is an authority already; `milepost pki issue` goes on with it")
        key = ec.generate_private_key(ec.SECP256R1())
        certificate = _root(key, AUTHORITY_OF + train, days)
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_private(folder / ROOT_KEY, _key_pem(key))
        write_public(folder / ROOT, _pem(certificate))
        return cls(certificate, key)

    @classmethod
    def load(cls, folder: Path) -> Authority:
        """The authority of a folder. Raises ConfigError."""
        need_cryptography()
        from cryptography import x509
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ec

        try:
            certificate = x509.load_pem_x509_certificate((folder / ROOT).read_bytes())
            key = serialization.load_pem_private_key((folder / ROOT_KEY).read_bytes(), None)
        except FileNotFoundError as error:
            raise ConfigError(str(error.filename), "", "no such file; `milepost pki init` makes an authority") from error
        except (OSError, ValueError) as error:
            raise ConfigError(folder / ROOT_KEY, "", f"not a readable authority: {error}") from error
        if not isinstance(key, ec.EllipticCurvePrivateKey) or certificate.public_key() != key.public_key():
            raise ConfigError(folder / ROOT_KEY, "", f"is not the key of {ROOT}")
        return cls(certificate, key)

    @property
    def train(self) -> str:
        """The name of the train whose authority it is."""
        return self.certificate.subject.rfc4514_string().removeprefix(f"CN={AUTHORITY_OF}")

    @property
    def pem(self) -> bytes:
        """The certificate that everybody trusts."""
        return _pem(self.certificate)

    def issue(self, folder: Path, name: str, days: float, hosts: Sequence[str] = ()) -> None:
        """A new key and certificate for `name`; with `hosts`, also to listen under these names and addresses.

        Both in one file, so that a session that connects meanwhile finds no key beside another's certificate. Raises OSError.
        """
        from cryptography.hazmat.primitives.asymmetric import ec

        key = ec.generate_private_key(ec.SECP256R1())
        certificate = _leaf(self, key, name, days, hosts)
        folder.mkdir(parents=True, exist_ok=True, mode=0o755)
        write_public(folder / ROOT, self.pem)
        write_private(folder / IDENTITY, _key_pem(key) + _pem(certificate))


def expires_at(certificate: Path) -> datetime.datetime:
    """Until when a certificate is valid. Raises ConfigError."""
    from cryptography import x509

    try:
        out: datetime.datetime = x509.load_pem_x509_certificate(certificate.read_bytes()).not_valid_after_utc
    except (OSError, ValueError) as error:
        raise ConfigError(certificate, "", f"not a readable certificate: {error}") from error
    return out


def hosts_of(certificate: Path) -> list[str]:
    """The names and addresses under which a certificate may listen; none where there is no certificate yet."""
    from cryptography import x509

    try:
        loaded = x509.load_pem_x509_certificate(certificate.read_bytes())
        names = loaded.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except FileNotFoundError:
        return []
    except (OSError, ValueError, x509.ExtensionNotFound) as error:
        raise ConfigError(certificate, "", f"not a readable certificate: {error}") from error
    return [str(name.value) for name in names]


def _name(common_name: str) -> x509.Name:
    from cryptography import x509
    from cryptography.x509.oid import NameOID

    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _begun(subject: x509.Name, issuer: x509.Name, key: EllipticCurvePrivateKey, days: float) -> x509.CertificateBuilder:
    from cryptography import x509

    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - max(BACKDATED, datetime.timedelta(days=-2.0 * days)))
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _usage(sign_certificates: bool) -> x509.KeyUsage:
    from cryptography import x509

    return x509.KeyUsage(
        digital_signature=not sign_certificates,
        key_cert_sign=sign_certificates,
        crl_sign=sign_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _root(key: EllipticCurvePrivateKey, common_name: str, days: float) -> x509.Certificate:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes

    name = _name(common_name)
    return (
        _begun(name, name, key, days)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(sign_certificates=True), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )


def _leaf(
    authority: Authority, key: EllipticCurvePrivateKey, common_name: str, days: float, hosts: Sequence[str]
) -> x509.Certificate:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.x509.oid import ExtendedKeyUsageOID

    # without hosts it cannot stand for a router, whoever steals it
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH] + ([ExtendedKeyUsageOID.SERVER_AUTH] if hosts else [])
    names = [_host(host) for host in hosts] or [x509.DNSName(common_name)]
    return (
        _begun(_name(common_name), authority.certificate.subject, key, days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(sign_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key()), critical=False)
        .sign(authority.key, hashes.SHA256())
    )


def _host(host: str) -> x509.GeneralName:
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(certificate: x509.Certificate) -> bytes:
    from cryptography.hazmat.primitives import serialization

    out: bytes = certificate.public_bytes(serialization.Encoding.PEM)
    return out


def _key_pem(key: EllipticCurvePrivateKey) -> bytes:
    from cryptography.hazmat.primitives import serialization

    plain, pkcs8 = serialization.NoEncryption(), serialization.PrivateFormat.PKCS8
    out: bytes = key.private_bytes(serialization.Encoding.PEM, pkcs8, plain)
    return out
