"""Which files of published networks a benchmark needs, and whether those of a folder are them."""

from dataclasses import dataclass
from pathlib import Path

from readygo.common.errors import PolicyError
from readygo.common.extras import install_command
from readygo.runs.method_files import method_hashes
from readygo.runs.methods import NETWORKS

PARAMETERS = {"gnm": 8_663_797, "vint": 29_662_397, "nomad": 19_049_675}
"""Numbers of the published weights. Source: the networks' own classes, built and counted."""


@dataclass(frozen=True, kw_only=True)
class WeightsFile:
    """The file of one network."""

    driver: str
    path: Path
    sha256: str
    """SHA-256 of the file; empty where there is none."""
    defect: str
    """What is wrong with it; empty if it is the network."""


def check_weights(checkpoints: Path) -> list[WeightsFile]:
    """Load the weights of every published network from a folder.

    Args:
        checkpoints: Folder of weights.

    Raises:
        PolicyError: If torch is missing.
    """
    try:
        from readygo.common.networks.checkpoint import load_network
    except ImportError as error:
        raise PolicyError(f"The weights of networks need torch; run: {install_command('train')}") from error
    hashes, found = method_hashes(tuple(NETWORKS), checkpoints), []
    for driver, name in NETWORKS.items():
        defect = ""
        try:
            load_network(driver, checkpoints / name)
        except PolicyError as error:
            defect = str(error)
        found.append(WeightsFile(driver=driver, path=checkpoints / name, sha256=hashes.get(driver, ""), defect=defect))
    return found
