import shutil
import stat
from pathlib import Path

import pytest

pytest.importorskip("cryptography", reason="needs the extra tls")

from readygo.common.certificates import issue, load_identity, make_authority
from readygo.common.errors import CertificateError


@pytest.fixture
def authority(tmp_path: Path) -> Path:
    make_authority(tmp_path / "authority")
    return tmp_path / "authority"


def test_issued_certificate_is_what_its_role_shows(authority: Path, tmp_path: Path) -> None:
    host = tmp_path / "host"
    issue(authority, host, "recorder.rec0", hosts=("lab1", "10.0.0.5"))
    identity = load_identity(host, "recorder.rec0")
    assert (identity.name, identity.role) == ("recorder.rec0", "recorder")
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


def test_what_is_no_role_or_has_no_authority_is_not_issued(authority: Path, tmp_path: Path) -> None:
    for name in ("recorder", "Renderer", "../x", "recorders.rec0", ""):
        with pytest.raises(CertificateError, match="A certificate is of a role"):
            issue(authority, tmp_path, name)
    with pytest.raises(CertificateError, match="--days"):
        issue(authority, tmp_path, "monitor", days=0.0)
    with pytest.raises(CertificateError, match=r"ca\.pem cannot be read: No such file"):
        issue(tmp_path / "nowhere", tmp_path, "monitor")
    with pytest.raises(CertificateError, match="has an authority already"):
        make_authority(authority)
