"""Several processes that train one policy together, as `torchrun` starts them."""

import torch
from torch import distributed, nn


class Ranks:
    """This process's place among those that train together; alone, it is the first of one."""

    def __init__(self) -> None:
        """Join the others if `torch.distributed` was set up."""
        together = distributed.is_available() and distributed.is_initialized()
        self.rank = distributed.get_rank() if together else 0
        """Number of this process; the first one, 0, validates and writes."""
        self.count = distributed.get_world_size() if together else 1
        """Number of processes."""

    @property
    def is_first(self) -> bool:
        """True for the process that validates and writes."""
        return self.rank == 0

    def wrap(self, network: nn.Module) -> nn.Module:
        """The network with gradients that are averaged over all processes."""
        return network if self.count == 1 else nn.parallel.DistributedDataParallel(network)

    def broadcast(self, number: float) -> float:
        """The first process's number."""
        if self.count == 1:
            return number
        tensor = torch.tensor([number], dtype=torch.float64)
        distributed.broadcast(tensor, 0)
        return float(tensor.item())


def join_ranks(device: str) -> None:
    """Set `torch.distributed` up from the variables that `torchrun` gives.

    Args:
        device: "cuda" talks over NCCL, others over Gloo.
    """
    distributed.init_process_group("cuda:nccl,cpu:gloo" if device == "cuda" else "gloo")


def leave_ranks() -> None:
    """Wait until all have come so far, and take leave of them: one whose peer is gone already aborts when it ends."""
    distributed.barrier()
    distributed.destroy_process_group()
