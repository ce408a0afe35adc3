"""`readygo certs init` and `readygo certs issue`: certificates for a fleet that spans networks."""

import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from tyro.conf import Positional

from readygo.common.errors import CertificateError
from readygo.common.extras import install_command


@dataclass(frozen=True, kw_only=True)
class CertsInitOptions:
    """Create a certificate authority, which signs the certificates of one fleet.

    Only the fleet's owner may read the folder, ca.key above all: the key can issue a certificate for any role.
    """

    folder: Positional[Path]
    """Folder for ca.key and ca.pem."""


def certs_init(options: CertsInitOptions) -> None:
    """Create a certificate authority, which signs the certificates of one fleet."""
    _certificates().make_authority(options.folder)
    sys.stderr.write(
        f"Authority in {options.folder}. "
        f"Next: readygo certs issue coordinator --authority {options.folder} --host HOST\n"
    )


@dataclass(frozen=True, kw_only=True)
class CertsIssueOptions:
    """Issue certificates; the role named in a certificate determines its rights.

    Each process presents the certificate of its role. Workers of one role may share one, also on several hosts.
    """

    names: Positional[tuple[str, ...]]
    """Roles: coordinator, recorder.NAME, those of the run's stages (human-planner, animator, robot-planner,
    renderer, driver, evaluator), all, trainer, operator (may pause and cancel), monitor (read-only)."""
    authority: Path
    """Folder of the authority."""
    out: Path | None = None
    """Folder for NAME.pem, NAME.key and ca.pem, to copy to a host; the authority's folder by default."""
    host: tuple[str, ...] = ()
    """Host names and addresses of the coordinator, in addition to localhost."""
    days: float = 90.0
    """Validity [days]."""


def certs_issue(options: CertsIssueOptions) -> None:
    """Issue certificates; the role named in a certificate determines its rights."""
    if not options.names:
        raise CertificateError("Name the roles: `readygo certs issue coordinator recorder.rec0 all operator ...`.")
    for name in options.names:
        hosts = ("localhost", "127.0.0.1", "::1", *options.host) if name == "coordinator" else options.host
        _certificates().issue(
            options.authority,
            options.out or options.authority,
            name,
            hosts=tuple(dict.fromkeys(hosts)),
            days=options.days,
        )
    sys.stderr.write(
        f"{', '.join(options.names)}: in {options.out or options.authority}, valid for {options.days:g} days.\n"
    )


def _certificates() -> ModuleType:
    try:
        from readygo.apps.fleet import certificates
    except ImportError as error:
        raise CertificateError(f"Certificates need cryptography; run: {install_command('tls')}") from error
    return certificates
