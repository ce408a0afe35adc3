import math

from readygo.common.episode.metrics import EpisodeResult
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.services.evaluator import POLICY, EpisodeRecord, Task


def record(index, outcome, near_m=math.inf, task=Task.DYNAMIC, method=POLICY):
    result = EpisodeResult(outcome=outcome, duration_s=3.0, path_length_m=1.0, shortest_m=1.0)
    key = EpisodeKey(seed=0, split=Split.TEST, index=index)
    return EpisodeRecord(episode=key, task=task, method=method, result=result, human_distance_min_m=near_m)


RECORDS = [
    record(0, Outcome.SUCCESS, 2.0),
    record(1, Outcome.TIMEOUT, 1.0),
    record(3, Outcome.HUMAN_COLLISION, 0.5),
    record(4, Outcome.SUCCESS, 0.6),
    record(5, Outcome.STATIC_COLLISION),
    record(5, Outcome.SUCCESS, task=Task.STATIC),
]
