from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Optional as _Optional

DESCRIPTOR: _descriptor.FileDescriptor

class DrawnRobot(_message.Message):
    __slots__ = ("mount_height_m", "horizontal_fov_deg", "mount_pitch_deg", "radius_m", "v_max_mps", "w_max_radps")
    MOUNT_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    HORIZONTAL_FOV_DEG_FIELD_NUMBER: _ClassVar[int]
    MOUNT_PITCH_DEG_FIELD_NUMBER: _ClassVar[int]
    RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    V_MAX_MPS_FIELD_NUMBER: _ClassVar[int]
    W_MAX_RADPS_FIELD_NUMBER: _ClassVar[int]
    mount_height_m: float
    horizontal_fov_deg: float
    mount_pitch_deg: float
    radius_m: float
    v_max_mps: float
    w_max_radps: float
    def __init__(self, mount_height_m: _Optional[float] = ..., horizontal_fov_deg: _Optional[float] = ..., mount_pitch_deg: _Optional[float] = ..., radius_m: _Optional[float] = ..., v_max_mps: _Optional[float] = ..., w_max_radps: _Optional[float] = ...) -> None: ...
