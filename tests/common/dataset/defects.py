"""What validation says of damaged shards."""

from readygo.common.dataset import validate


def kinds(folder) -> set[str]:
    """Kinds of the defects of a dataset."""
    return {defect.kind for defect in validate(folder).defects}


def texts(folder) -> str:
    """Its defects, a line each."""
    return "\n".join(map(str, validate(folder).defects))


def at(records, channel, sequence):
    """The record of a channel and a sample."""
    return next(record for record in records if record.channel is channel and record.sequence == sequence)
