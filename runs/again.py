"""Repetition of a recorded run: its episodes, each with the policy that drove it."""

from pathlib import Path

from readygo.common.errors import RunError
from readygo.common.messages import PolicyRef, RunSpec
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import BlobStore, Ledger


def prepare_again(data: Path, out: Path) -> tuple[RunSpec, int]:
    """Prepare a data folder to record the durable episodes of another folder's run again.

    Args:
        data: Data folder of a run that is finished or was stopped.
        out: Data folder of the repeated run; may already hold a part if `data` has grown since.

    Returns:
        The spec of the run, and its number of episodes.

    Raises:
        RunError: If there is no such run or it has no durable episode, or `out` holds something else.
    """
    source, target = RunFolder(data), RunFolder(out)
    spec, _ = source.load()
    target.check(spec)
    known = Ledger(source.ledger, spec.stages)
    driven_by, policies = known.census.driven_by(), known.policies.all()
    known.close()
    if not driven_by:
        raise RunError(f"{data} holds no durable episodes yet; there is nothing to make again.")
    blobs = BlobStore(source.blobs)
    with target.lock():
        made = Ledger(target.ledger, spec.stages)
        store = BlobStore(target.blobs)
        for policy in policies:
            if policy.sha256 not in driven_by.values():
                continue
            for file in policy.files:
                stored = blobs.get(file.sha256)
                if stored is None:
                    raise RunError(
                        f"{data} has lost file {file.path} of policy {policy.sha256}; it cannot be made again."
                    )
                store.put(stored)
            made.policies.offer(PolicyRef(path="", files=policy.files, mix=0.0), policy.wall_ns)
        made.assign(driven_by)
        made.close()
        target.save(spec, len(driven_by))
    return spec, len(driven_by)
