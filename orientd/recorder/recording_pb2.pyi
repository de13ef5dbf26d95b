from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Column(_message.Message):
    __slots__ = ("width", "quantum", "order", "steps", "raw")
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    QUANTUM_FIELD_NUMBER: _ClassVar[int]
    ORDER_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    RAW_FIELD_NUMBER: _ClassVar[int]
    width: int
    quantum: float
    order: int
    steps: _containers.RepeatedScalarFieldContainer[int]
    raw: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, width: _Optional[int] = ..., quantum: _Optional[float] = ..., order: _Optional[int] = ..., steps: _Optional[_Iterable[int]] = ..., raw: _Optional[_Iterable[float]] = ...) -> None: ...

class CycleBlock(_message.Message):
    __slots__ = ("count", "index", "deadline_ns", "lateness_ns", "work_ns", "feedback_age_ns", "state", "fault", "motion", "flags", "overruns", "missed", "path_index", "path_fraction", "speed", "sent_q", "sent_omega_body", "sent_alpha_body", "sent_position", "measured_q", "measured_omega_body", "measured_position", "measured_joints", "sent_joints")
    COUNT_FIELD_NUMBER: _ClassVar[int]
    INDEX_FIELD_NUMBER: _ClassVar[int]
    DEADLINE_NS_FIELD_NUMBER: _ClassVar[int]
    LATENESS_NS_FIELD_NUMBER: _ClassVar[int]
    WORK_NS_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_AGE_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    MOTION_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    OVERRUNS_FIELD_NUMBER: _ClassVar[int]
    MISSED_FIELD_NUMBER: _ClassVar[int]
    PATH_INDEX_FIELD_NUMBER: _ClassVar[int]
    PATH_FRACTION_FIELD_NUMBER: _ClassVar[int]
    SPEED_FIELD_NUMBER: _ClassVar[int]
    SENT_Q_FIELD_NUMBER: _ClassVar[int]
    SENT_OMEGA_BODY_FIELD_NUMBER: _ClassVar[int]
    SENT_ALPHA_BODY_FIELD_NUMBER: _ClassVar[int]
    SENT_POSITION_FIELD_NUMBER: _ClassVar[int]
    MEASURED_Q_FIELD_NUMBER: _ClassVar[int]
    MEASURED_OMEGA_BODY_FIELD_NUMBER: _ClassVar[int]
    MEASURED_POSITION_FIELD_NUMBER: _ClassVar[int]
    MEASURED_JOINTS_FIELD_NUMBER: _ClassVar[int]
    SENT_JOINTS_FIELD_NUMBER: _ClassVar[int]
    count: int
    index: Column
    deadline_ns: Column
    lateness_ns: Column
    work_ns: Column
    feedback_age_ns: Column
    state: Column
    fault: Column
    motion: Column
    flags: Column
    overruns: Column
    missed: Column
    path_index: Column
    path_fraction: Column
    speed: Column
    sent_q: Column
    sent_omega_body: Column
    sent_alpha_body: Column
    sent_position: Column
    measured_q: Column
    measured_omega_body: Column
    measured_position: Column
    measured_joints: Column
    sent_joints: Column
    def __init__(self, count: _Optional[int] = ..., index: _Optional[_Union[Column, _Mapping]] = ..., deadline_ns: _Optional[_Union[Column, _Mapping]] = ..., lateness_ns: _Optional[_Union[Column, _Mapping]] = ..., work_ns: _Optional[_Union[Column, _Mapping]] = ..., feedback_age_ns: _Optional[_Union[Column, _Mapping]] = ..., state: _Optional[_Union[Column, _Mapping]] = ..., fault: _Optional[_Union[Column, _Mapping]] = ..., motion: _Optional[_Union[Column, _Mapping]] = ..., flags: _Optional[_Union[Column, _Mapping]] = ..., overruns: _Optional[_Union[Column, _Mapping]] = ..., missed: _Optional[_Union[Column, _Mapping]] = ..., path_index: _Optional[_Union[Column, _Mapping]] = ..., path_fraction: _Optional[_Union[Column, _Mapping]] = ..., speed: _Optional[_Union[Column, _Mapping]] = ..., sent_q: _Optional[_Union[Column, _Mapping]] = ..., sent_omega_body: _Optional[_Union[Column, _Mapping]] = ..., sent_alpha_body: _Optional[_Union[Column, _Mapping]] = ..., sent_position: _Optional[_Union[Column, _Mapping]] = ..., measured_q: _Optional[_Union[Column, _Mapping]] = ..., measured_omega_body: _Optional[_Union[Column, _Mapping]] = ..., measured_position: _Optional[_Union[Column, _Mapping]] = ..., measured_joints: _Optional[_Union[Column, _Mapping]] = ..., sent_joints: _Optional[_Union[Column, _Mapping]] = ...) -> None: ...

class Scalars(_message.Message):
    __slots__ = ("sent", "measured", "tracking_error", "lateness", "work", "path_speed", "state", "motion")
    class Sent(_message.Message):
        __slots__ = ("qw", "qx", "qy", "qz", "omega_x", "omega_y", "omega_z", "speed", "alpha_x", "alpha_y", "alpha_z", "acceleration", "x", "y", "z")
        QW_FIELD_NUMBER: _ClassVar[int]
        QX_FIELD_NUMBER: _ClassVar[int]
        QY_FIELD_NUMBER: _ClassVar[int]
        QZ_FIELD_NUMBER: _ClassVar[int]
        OMEGA_X_FIELD_NUMBER: _ClassVar[int]
        OMEGA_Y_FIELD_NUMBER: _ClassVar[int]
        OMEGA_Z_FIELD_NUMBER: _ClassVar[int]
        SPEED_FIELD_NUMBER: _ClassVar[int]
        ALPHA_X_FIELD_NUMBER: _ClassVar[int]
        ALPHA_Y_FIELD_NUMBER: _ClassVar[int]
        ALPHA_Z_FIELD_NUMBER: _ClassVar[int]
        ACCELERATION_FIELD_NUMBER: _ClassVar[int]
        X_FIELD_NUMBER: _ClassVar[int]
        Y_FIELD_NUMBER: _ClassVar[int]
        Z_FIELD_NUMBER: _ClassVar[int]
        qw: float
        qx: float
        qy: float
        qz: float
        omega_x: float
        omega_y: float
        omega_z: float
        speed: float
        alpha_x: float
        alpha_y: float
        alpha_z: float
        acceleration: float
        x: float
        y: float
        z: float
        def __init__(self, qw: _Optional[float] = ..., qx: _Optional[float] = ..., qy: _Optional[float] = ..., qz: _Optional[float] = ..., omega_x: _Optional[float] = ..., omega_y: _Optional[float] = ..., omega_z: _Optional[float] = ..., speed: _Optional[float] = ..., alpha_x: _Optional[float] = ..., alpha_y: _Optional[float] = ..., alpha_z: _Optional[float] = ..., acceleration: _Optional[float] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...
    class Measured(_message.Message):
        __slots__ = ("qw", "qx", "qy", "qz", "omega_x", "omega_y", "omega_z", "x", "y", "z", "age")
        QW_FIELD_NUMBER: _ClassVar[int]
        QX_FIELD_NUMBER: _ClassVar[int]
        QY_FIELD_NUMBER: _ClassVar[int]
        QZ_FIELD_NUMBER: _ClassVar[int]
        OMEGA_X_FIELD_NUMBER: _ClassVar[int]
        OMEGA_Y_FIELD_NUMBER: _ClassVar[int]
        OMEGA_Z_FIELD_NUMBER: _ClassVar[int]
        X_FIELD_NUMBER: _ClassVar[int]
        Y_FIELD_NUMBER: _ClassVar[int]
        Z_FIELD_NUMBER: _ClassVar[int]
        AGE_FIELD_NUMBER: _ClassVar[int]
        qw: float
        qx: float
        qy: float
        qz: float
        omega_x: float
        omega_y: float
        omega_z: float
        x: float
        y: float
        z: float
        age: float
        def __init__(self, qw: _Optional[float] = ..., qx: _Optional[float] = ..., qy: _Optional[float] = ..., qz: _Optional[float] = ..., omega_x: _Optional[float] = ..., omega_y: _Optional[float] = ..., omega_z: _Optional[float] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ..., age: _Optional[float] = ...) -> None: ...
    SENT_FIELD_NUMBER: _ClassVar[int]
    MEASURED_FIELD_NUMBER: _ClassVar[int]
    TRACKING_ERROR_FIELD_NUMBER: _ClassVar[int]
    LATENESS_FIELD_NUMBER: _ClassVar[int]
    WORK_FIELD_NUMBER: _ClassVar[int]
    PATH_SPEED_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    MOTION_FIELD_NUMBER: _ClassVar[int]
    sent: Scalars.Sent
    measured: Scalars.Measured
    tracking_error: float
    lateness: float
    work: float
    path_speed: float
    state: int
    motion: int
    def __init__(self, sent: _Optional[_Union[Scalars.Sent, _Mapping]] = ..., measured: _Optional[_Union[Scalars.Measured, _Mapping]] = ..., tracking_error: _Optional[float] = ..., lateness: _Optional[float] = ..., work: _Optional[float] = ..., path_speed: _Optional[float] = ..., state: _Optional[int] = ..., motion: _Optional[int] = ...) -> None: ...
