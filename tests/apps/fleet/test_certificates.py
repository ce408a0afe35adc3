import datetime
import ipaddress
import shutil
import stat
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("cryptography", reason="needs the extra tls")

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID

from readygo.apps.fleet import certificates
from readygo.apps.fleet.certificates import issue, load_identity, make_authority
from readygo.common.errors import CertificateError


@pytest.fixture
def authority(tmp_path: Path) -> Path:
    make_authority(tmp_path / "authority")
    return tmp_path / "authority"


def test_issued_certificate_is_what_its_role_shows(authority: Path, tmp_path: Path) -> None:
    host = tmp_path / "host"
    issue(authority, host, "recorder.rec0", hosts=("lab1", "10.0.0.5"))
    identity = load_identity(host, "recorder.rec0")
    assert identity.name == "recorder.rec0"
    # The authority's key does not travel, and nobody else reads the other one.
    assert sorted(path.name for path in host.iterdir()) == ["ca.pem", "recorder.rec0.key", "recorder.rec0.pem"]
    assert stat.S_IMODE(identity.key.stat().st_mode) == stat.S_IMODE((authority / "ca.key").stat().st_mode) == 0o600


def test_missing_certificate_is_named_with_those_that_are_there(authority: Path, tmp_path: Path) -> None:
    with pytest.raises(CertificateError, match=r"has no certificate of renderer \(it has none\); `readygo certs issue"):
        load_identity(tmp_path / "host", "renderer")
    issue(authority, tmp_path / "host", "monitor")
    with pytest.raises(CertificateError, match=r"has no certificate of renderer \(it has monitor\)"):
        load_identity(tmp_path / "host", "renderer")


def test_certificate_that_nobody_would_take_is_refused_before_it_is_shown(authority: Path, tmp_path: Path) -> None:
    host = tmp_path / "host"
    issue(authority, host, "monitor")
    for suffix in ("pem", "key"):
        shutil.copy(host / f"monitor.{suffix}", host / f"operator.{suffix}")
    with pytest.raises(CertificateError, match=r"operator\.pem is a certificate of monitor, not of operator"):
        load_identity(host, "operator")
    issue(authority, host, "renderer", days=1e-9)
    with pytest.raises(CertificateError, match=r"renderer\.pem expired at .* UTC; `readygo certs issue` renews it"):
        load_identity(host, "renderer")
    make_authority(tmp_path / "other")
    shutil.copy(tmp_path / "other" / "ca.pem", host / "ca.pem")
    with pytest.raises(CertificateError, match=r"monitor\.pem is not signed by the authority of .*ca\.pem"):
        load_identity(host, "monitor")
    (host / "monitor.pem").write_text("none")
    with pytest.raises(CertificateError, match=r"monitor\.pem is no certificate"):
        load_identity(host, "monitor")


def test_key_of_another_certificate_is_refused(authority: Path, tmp_path: Path) -> None:
    for name in ("monitor", "operator"):
        issue(authority, tmp_path, name)
    shutil.copy(tmp_path / "operator.key", tmp_path / "monitor.key")
    with pytest.raises(CertificateError, match=r"monitor\.key is not the key of .*monitor\.pem"):
        load_identity(tmp_path, "monitor")


def test_certificate_of_the_authoritys_name_is_refused_and_the_authority_stays(authority: Path) -> None:
    before = {path.name: path.read_bytes() for path in authority.iterdir()}
    with pytest.raises(CertificateError, match=r"A certificate is of a role, .*, got 'ca'"):
        issue(authority, authority, "ca")
    assert {path.name: path.read_bytes() for path in authority.iterdir()} == before


def test_what_is_no_role_or_has_no_authority_is_not_issued(authority: Path, tmp_path: Path) -> None:
    for name in ("recorder", "Renderer", "../x", "recorders.rec0", "renderer.lab1", ""):
        with pytest.raises(CertificateError, match="A certificate is of a role"):
            issue(authority, tmp_path, name)
    with pytest.raises(CertificateError, match=r"renderer, .* or of recorder\.NAME, got 'rendrer'"):
        issue(authority, tmp_path, "rendrer")
    with pytest.raises(CertificateError, match="--days"):
        issue(authority, tmp_path, "monitor", days=0.0)
    with pytest.raises(CertificateError, match=r"ca\.pem cannot be read: No such file"):
        issue(tmp_path / "nowhere", tmp_path, "monitor")
    with pytest.raises(CertificateError, match="has an authority already"):
        make_authority(authority)


def read(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_certificates_say_whose_they_are_for_how_long_and_for_which_hosts(authority: Path, tmp_path: Path) -> None:
    before = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    issue(authority, tmp_path, "recorder.rec0", hosts=("lab1", "10.0.0.5", "::1"), days=2.5)
    ca, mine = read(authority / "ca.pem"), read(tmp_path / "recorder.rec0.pem")
    assert mine.subject.rfc4514_string() == "CN=recorder.rec0"
    assert mine.issuer == ca.subject == ca.issuer
    assert ca.subject.rfc4514_string() == "CN=readygo fleet"
    for one, days in ((ca, 3650.0), (mine, 2.5)):
        begin, end = one.not_valid_before_utc, one.not_valid_after_utc
        assert end - begin == datetime.timedelta(days=days, hours=1)
        assert abs(begin + datetime.timedelta(hours=1) - before) < datetime.timedelta(seconds=60)
    limits = [one.extensions.get_extension_for_class(x509.BasicConstraints) for one in (ca, mine)]
    assert [(limit.critical, limit.value.ca, limit.value.path_length) for limit in limits] == [
        (True, True, 0), (True, False, None)
    ]  # fmt: skip
    names = mine.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["lab1"]
    assert names.get_values_for_type(x509.IPAddress) == [ipaddress.ip_address(ip) for ip in ("10.0.0.5", "::1")]
    usage = mine.extensions.get_extension_for_class(x509.ExtendedKeyUsage)
    assert (usage.critical, set(usage.value)) == (
        False, {ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH}
    )  # fmt: skip
    mine.verify_directly_issued_by(ca)
    issue(authority, tmp_path, "monitor")
    with pytest.raises(x509.ExtensionNotFound):
        read(tmp_path / "monitor.pem").extensions.get_extension_for_class(x509.SubjectAlternativeName)
    assert read(tmp_path / "ca.pem") == ca
    issue(authority, authority, "operator", days=3650.0)
    assert read(authority / "ca.pem") == ca
    with pytest.raises(CertificateError, match=r"at most 3650, got 3650\.1"):
        issue(authority, tmp_path, "operator", days=3650.1)


@pytest.mark.parametrize(
    ("shift", "words"),
    [
        (datetime.timedelta(days=-1), r"renderer\.pem is valid from .* on; is the clock right"),
        (datetime.timedelta(minutes=-59), ""),
        (datetime.timedelta(days=9.9), ""),
        (datetime.timedelta(days=10.1), r"renderer\.pem expired at"),
        (datetime.timedelta(days=3651), r"expired at"),
    ],
)
def test_certificate_is_good_from_an_hour_before_it_was_made_until_its_days_are_over(
    authority: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shift: datetime.timedelta, words: str
) -> None:
    issue(authority, tmp_path, "renderer", days=10.0)

    real_now = datetime.datetime.now
    later = SimpleNamespace(now=lambda zone: real_now(zone) + shift)
    monkeypatch.setattr(certificates, "datetime", SimpleNamespace(datetime=later, UTC=datetime.UTC))
    if not words:
        assert load_identity(tmp_path, "renderer").name == "renderer"
        return
    with pytest.raises(CertificateError, match=words):
        load_identity(tmp_path, "renderer")


def test_keys_that_cannot_be_used_are_told(authority: Path, tmp_path: Path) -> None:
    issue(authority, tmp_path, "monitor")
    key = tmp_path / "monitor.key"
    good = key.read_bytes()
    other = rsa.generate_private_key(public_exponent=65537, key_size=1024)
    pem = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    for data, words in (
        (other.private_bytes(*pem, serialization.NoEncryption()), "is no key of an elliptic curve"),
        (other.private_bytes(*pem, serialization.BestAvailableEncryption(b"x")), "is no private key"),
        (b"none", "is no private key"),
    ):
        key.write_bytes(data)
        with pytest.raises(CertificateError, match=words):
            load_identity(tmp_path, "monitor")
    key.unlink()
    with pytest.raises(CertificateError, match=r"monitor\.key cannot be read: No such file"):
        load_identity(tmp_path, "monitor")
    key.write_bytes(good)
    assert load_identity(tmp_path, "monitor").key == key
