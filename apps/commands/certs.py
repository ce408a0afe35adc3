"""`readygo certs issue`: the certificates of a fleet that spans networks."""

import sys
from pathlib import Path
from types import ModuleType

from readygo.common.errors import CertificateError
from readygo.common.extras import install_command


def certs_init(folder: Path, /) -> None:
    """Make an authority, which signs the certificates of one fleet.

    Keep the folder, ca.key above all, where only the fleet's owner reads it: whoever has the key can be anybody.

    Args:
        folder: Gets ca.key and ca.pem.
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
    """Issue certificates; what each allows is its role's.

    A process shows the one of its role: workers of one role, on however many hosts, may share one.

    Args:
        names: Roles: coordinator, recorder.NAME, those of the run's stages (human-planner, animator, robot-planner,
            renderer, driver, evaluator), all, trainer, operator (may pause and cancel), monitor (only looks).
        authority: Folder of the authority.
        out: Folder that gets NAME.pem, NAME.key and ca.pem, for a host to have; the authority's own by default.
        host: Names and addresses under which a coordinator is reached, besides localhost.
        days: How long they are valid.
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
