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
    __slots__ = ("count", "index", "deadline_ns", "lateness_ns", "work_ns", "feedback_age_ns", "state", "fault", "motion", "flags", "overruns", "missed", "path_index", "path_fraction", "speed", "sent_q", "sent_omega_body", "sent_alpha_body", "sent_position", "measured_q", "measured_omega_body", "measured_position", "measured_joints")
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
    def __init__(self, count: _Optional[int] = ..., index: _Optional[_Union[Column, _Mapping]] = ..., deadline_ns: _Optional[_Union[Column, _Mapping]] = ..., lateness_ns: _Optional[_Union[Column, _Mapping]] = ..., work_ns: _Optional[_Union[Column, _Mapping]] = ..., feedback_age_ns: _Optional[_Union[Column, _Mapping]] = ..., state: _Optional[_Union[Column, _Mapping]] = ..., fault: _Optional[_Union[Column, _Mapping]] = ..., motion: _Optional[_Union[Column, _Mapping]] = ..., flags: _Optional[_Union[Column, _Mapping]] = ..., overruns: _Optional[_Union[Column, _Mapping]] = ..., missed: _Optional[_Union[Column, _Mapping]] = ..., path_index: _Optional[_Union[Column, _Mapping]] = ..., path_fraction: _Optional[_Union[Column, _Mapping]] = ..., speed: _Optional[_Union[Column, _Mapping]] = ..., sent_q: _Optional[_Union[Column, _Mapping]] = ..., sent_omega_body: _Optional[_Union[Column, _Mapping]] = ..., sent_alpha_body: _Optional[_Union[Column, _Mapping]] = ..., sent_position: _Optional[_Union[Column, _Mapping]] = ..., measured_q: _Optional[_Union[Column, _Mapping]] = ..., measured_omega_body: _Optional[_Union[Column, _Mapping]] = ..., measured_position: _Optional[_Union[Column, _Mapping]] = ..., measured_joints: _Optional[_Union[Column, _Mapping]] = ...) -> None: ...
