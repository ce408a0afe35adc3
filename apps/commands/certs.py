"""`readygo certs init` and `readygo certs issue`: certificates for a fleet that spans networks."""

import sys
from pathlib import Path
from types import ModuleType

from readygo.common.errors import CertificateError
from readygo.common.extras import install_command


def certs_init(folder: Path, /) -> None:
    """Create a certificate authority, which signs the certificates of one fleet.

    Only the fleet's owner may read the folder, ca.key above all: the key can issue a certificate for any role.

    Args:
        folder: Folder for ca.key and ca.pem.
    """
    _certificates().make_authority(folder)
    sys.stderr.write(f"Authority in {folder}. Next: readygo certs issue coordinator --authority {folder} --host HOST\n")


def certs_issue(
    names: tuple[str, ...],
    /,
    *,
    authority: Path,
    out: Path | None = None,
    host: tuple[str, ...] = (),
    days: float = 90.0,
) -> None:
    """Issue certificates; the role named in a certificate determines its rights.

    Each process presents the certificate of its role. Workers of one role may share one, also on several hosts.

    Args:
        names: Roles: coordinator, recorder.NAME, those of the run's stages (human-planner, animator, robot-planner,
            renderer, driver, evaluator), all, trainer, operator (may pause and cancel), monitor (read-only).
        authority: Folder of the authority.
        out: Folder for NAME.pem, NAME.key and ca.pem, to copy to a host; the authority's folder by default.
        host: Host names and addresses of the coordinator, in addition to localhost.
        days: Validity [days].
    """
    if not names:
        raise CertificateError("Name the roles: `readygo certs issue coordinator recorder.rec0 all operator ...`.")
    for name in names:
        hosts = ("localhost", "127.0.0.1", "::1", *host) if name == "coordinator" else host
        _certificates().issue(authority, out or authority, name, hosts=tuple(dict.fromkeys(hosts)), days=days)
    sys.stderr.write(f"{', '.join(names)}: in {out or authority}, valid for {days:g} days.\n")


def _certificates() -> ModuleType:
    try:
        from readygo.common import certificates
    except ImportError as error:
        raise CertificateError(f"Certificates need cryptography; run: {install_command('tls')}") from error
    return certificates
