from pathlib import Path

import pytest

from readygo.apps.commands.certs import CertsInitOptions, CertsIssueOptions

pytest.importorskip("cryptography", reason="needs the extra tls")

from readygo.apps.commands.certs import certs_init, certs_issue
from readygo.apps.fleet.certificates import load_identity
from readygo.common.errors import CertificateError


def test_certificates_of_a_host_are_issued_in_one_go(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    authority, host = tmp_path / "authority", tmp_path / "lab1"
    certs_init(CertsInitOptions(folder=authority))
    certs_issue(
        CertsIssueOptions(
            names=("coordinator", "recorder.rec0"), authority=authority, out=host, host=("lab1", "10.0.0.5"), days=7
        )
    )
    assert [load_identity(host, name).name for name in ("coordinator", "recorder.rec0")] == [
        "coordinator",
        "recorder.rec0",
    ]
    assert capsys.readouterr().err.splitlines()[-1] == f"coordinator, recorder.rec0: in {host}, valid for 7 days."
    with pytest.raises(CertificateError, match="Name the roles"):
        certs_issue(CertsIssueOptions(names=(), authority=authority))
