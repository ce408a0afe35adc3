from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor

class Action(_message.Message):
    __slots__ = ("v_mps", "w_radps")
    V_MPS_FIELD_NUMBER: _ClassVar[int]
    W_RADPS_FIELD_NUMBER: _ClassVar[int]
    v_mps: float
    w_radps: float
    def __init__(self, v_mps: _Optional[float] = ..., w_radps: _Optional[float] = ...) -> None: ...

class Goal(_message.Message):
    __slots__ = ("x_m", "y_m")
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    x_m: float
    y_m: float
    def __init__(self, x_m: _Optional[float] = ..., y_m: _Optional[float] = ...) -> None: ...

class StepTruth(_message.Message):
    __slots__ = ("human_distance_m", "time_to_collision_s", "human_visible", "expert_cost", "replanned")
    HUMAN_DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    TIME_TO_COLLISION_S_FIELD_NUMBER: _ClassVar[int]
    HUMAN_VISIBLE_FIELD_NUMBER: _ClassVar[int]
    EXPERT_COST_FIELD_NUMBER: _ClassVar[int]
    REPLANNED_FIELD_NUMBER: _ClassVar[int]
    human_distance_m: float
    time_to_collision_s: float
    human_visible: bool
    expert_cost: float
    replanned: bool
    def __init__(self, human_distance_m: _Optional[float] = ..., time_to_collision_s: _Optional[float] = ..., human_visible: bool = ..., expert_cost: _Optional[float] = ..., replanned: bool = ...) -> None: ...

class EpisodeStart(_message.Message):
    __slots__ = ("episode_id", "seed", "split", "index", "sample_count", "goal_x_m", "goal_y_m", "start_x_m", "start_y_m", "start_yaw_rad", "avatars", "encounters", "image_format")
    EPISODE_ID_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    SPLIT_FIELD_NUMBER: _ClassVar[int]
    INDEX_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_COUNT_FIELD_NUMBER: _ClassVar[int]
    GOAL_X_M_FIELD_NUMBER: _ClassVar[int]
    GOAL_Y_M_FIELD_NUMBER: _ClassVar[int]
    START_X_M_FIELD_NUMBER: _ClassVar[int]
    START_Y_M_FIELD_NUMBER: _ClassVar[int]
    START_YAW_RAD_FIELD_NUMBER: _ClassVar[int]
    AVATARS_FIELD_NUMBER: _ClassVar[int]
    ENCOUNTERS_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FORMAT_FIELD_NUMBER: _ClassVar[int]
    episode_id: str
    seed: int
    split: str
    index: int
    sample_count: int
    goal_x_m: float
    goal_y_m: float
    start_x_m: float
    start_y_m: float
    start_yaw_rad: float
    avatars: _containers.RepeatedScalarFieldContainer[str]
    encounters: _containers.RepeatedScalarFieldContainer[str]
    image_format: str
    def __init__(self, episode_id: _Optional[str] = ..., seed: _Optional[int] = ..., split: _Optional[str] = ..., index: _Optional[int] = ..., sample_count: _Optional[int] = ..., goal_x_m: _Optional[float] = ..., goal_y_m: _Optional[float] = ..., start_x_m: _Optional[float] = ..., start_y_m: _Optional[float] = ..., start_yaw_rad: _Optional[float] = ..., avatars: _Optional[_Iterable[str]] = ..., encounters: _Optional[_Iterable[str]] = ..., image_format: _Optional[str] = ...) -> None: ...

class EpisodeCommit(_message.Message):
    __slots__ = ("episode_id", "index", "attempt", "sample_count", "sha256")
    EPISODE_ID_FIELD_NUMBER: _ClassVar[int]
    INDEX_FIELD_NUMBER: _ClassVar[int]
    ATTEMPT_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_COUNT_FIELD_NUMBER: _ClassVar[int]
    SHA256_FIELD_NUMBER: _ClassVar[int]
    episode_id: str
    index: int
    attempt: int
    sample_count: int
    sha256: str
    def __init__(self, episode_id: _Optional[str] = ..., index: _Optional[int] = ..., attempt: _Optional[int] = ..., sample_count: _Optional[int] = ..., sha256: _Optional[str] = ...) -> None: ...
