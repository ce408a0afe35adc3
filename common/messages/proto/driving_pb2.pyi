from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor

class ExpertCommands(_message.Message):
    __slots__ = ("v_mps", "w_radps", "outcome", "driver", "policy", "risks", "image_every")
    V_MPS_FIELD_NUMBER: _ClassVar[int]
    W_RADPS_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    DRIVER_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    RISKS_FIELD_NUMBER: _ClassVar[int]
    IMAGE_EVERY_FIELD_NUMBER: _ClassVar[int]
    v_mps: _containers.RepeatedScalarFieldContainer[float]
    w_radps: _containers.RepeatedScalarFieldContainer[float]
    outcome: str
    driver: str
    policy: str
    risks: bytes
    image_every: int
    def __init__(self, v_mps: _Optional[_Iterable[float]] = ..., w_radps: _Optional[_Iterable[float]] = ..., outcome: _Optional[str] = ..., driver: _Optional[str] = ..., policy: _Optional[str] = ..., risks: _Optional[bytes] = ..., image_every: _Optional[int] = ...) -> None: ...
