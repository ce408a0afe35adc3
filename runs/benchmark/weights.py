"""Which files of published networks a benchmark needs, and whether those of a folder are them."""

from dataclasses import dataclass
from pathlib import Path

from readygo.common.errors import PolicyError
from readygo.common.extras import install_command
from readygo.runs.method_files import method_hashes
from readygo.runs.methods import NETWORKS, network_file, network_of

PARAMETERS = {"gnm": 8_663_797, "vint": 29_662_397, "nomad": 19_049_675}
"""Numbers of the published weights. Source: the networks' own classes, built and counted."""


DOWNLOAD = "https://drive.google.com/drive/folders/1a9yWR2iooXFAqjQHetz263--4_2FFggg"
"""The authors' folder of weights. Source: README.md of github.com/robodhruv/visualnav-transformer, commit 76d3a15."""


@dataclass(frozen=True, kw_only=True)
class WeightsFile:
    """The file of one driver that is a published network."""

    driver: str
    """Name of the driver: that of the network, or with a folder, as `gnm/zero-shot`."""
    path: Path
    sha256: str
    """SHA-256 of the file; empty where there is none."""
    defect: str
    """What is wrong with it; empty if it is the network."""


def check_weights(checkpoints: Path) -> list[WeightsFile]:
    """Load the weights of every published network from a folder, and from the folders below that have its name.

    Args:
        checkpoints: Folder of weights.

    Raises:
        PolicyError: If torch is missing.
    """
    try:
        from readygo.common.networks.checkpoint import load_network
    except ImportError as error:
        raise PolicyError(f"The weights of networks need torch; run: {install_command('train')}") from error
    drivers = [driver for network in NETWORKS for driver in _drivers(network, checkpoints)]
    hashes, found = method_hashes(drivers, checkpoints), []
    for driver in drivers:
        path, defect = network_file(driver, checkpoints), ""
        try:
            load_network(network_of(driver), path)
        except PolicyError as error:
            defect = str(error)
        found.append(WeightsFile(driver=driver, path=path, sha256=hashes.get(driver, ""), defect=defect))
    return found


def _drivers(network: str, checkpoints: Path) -> list[str]:
    """Drivers of a network by the files that are there, such as `gnm/zero-shot`; the network itself without any."""
    paths = sorted((checkpoints / network).rglob(NETWORKS[network]))
    below = [path.parent.relative_to(checkpoints).as_posix() for path in paths]
    return [network, *below] if network_file(network, checkpoints).exists() else below or [network]
