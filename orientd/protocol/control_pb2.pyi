import datetime

from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Frame(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FRAME_UNSPECIFIED: _ClassVar[Frame]
    FRAME_BODY: _ClassVar[Frame]
    FRAME_WORLD: _ClassVar[Frame]

class State(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    STATE_UNSPECIFIED: _ClassVar[State]
    STATE_IDLE: _ClassVar[State]
    STATE_HOLDING: _ClassVar[State]
    STATE_STREAMING: _ClassVar[State]
    STATE_STOPPING: _ClassVar[State]
    STATE_FAULT: _ClassVar[State]
    STATE_TRACKING: _ClassVar[State]

class Fault(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FAULT_NONE: _ClassVar[Fault]
    FAULT_LINK_LOST: _ClassVar[Fault]
    FAULT_FEEDBACK_STALE: _ClassVar[Fault]
    FAULT_DEVICE_FAULT: _ClassVar[Fault]
    FAULT_LIMIT_GUARD: _ClassVar[Fault]
    FAULT_PATH_STARVED: _ClassVar[Fault]
    FAULT_HEARTBEAT_LOST: _ClassVar[Fault]
    FAULT_SERVO_DIED: _ClassVar[Fault]
    FAULT_INTERNAL: _ClassVar[Fault]
    FAULT_SERVO_STALLED: _ClassVar[Fault]

class EventKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    EVENT_KIND_UNSPECIFIED: _ClassVar[EventKind]
    EVENT_KIND_READY: _ClassVar[EventKind]
    EVENT_KIND_MOTION_STARTED: _ClassVar[EventKind]
    EVENT_KIND_MOTION_DONE: _ClassVar[EventKind]
    EVENT_KIND_MOTION_STOPPED: _ClassVar[EventKind]
    EVENT_KIND_MOTION_REPLACED: _ClassVar[EventKind]
    EVENT_KIND_MOTION_UNSETTLED: _ClassVar[EventKind]
    EVENT_KIND_ON_TARGET: _ClassVar[EventKind]
    EVENT_KIND_FAULT: _ClassVar[EventKind]
    EVENT_KIND_SERVO_DIED: _ClassVar[EventKind]
    EVENT_KIND_RECORDED: _ClassVar[EventKind]
    EVENT_KIND_RECORDING_FAILED: _ClassVar[EventKind]
    EVENT_KIND_MOTION_PASSED: _ClassVar[EventKind]
    EVENT_KIND_WARNING: _ClassVar[EventKind]

class Outcome(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    OUTCOME_UNSPECIFIED: _ClassVar[Outcome]
    OUTCOME_DONE: _ClassVar[Outcome]
    OUTCOME_STOPPED: _ClassVar[Outcome]
    OUTCOME_FAULT: _ClassVar[Outcome]
    OUTCOME_REPLACED: _ClassVar[Outcome]
    OUTCOME_UNSETTLED: _ClassVar[Outcome]
    OUTCOME_PASSED: _ClassVar[Outcome]
FRAME_UNSPECIFIED: Frame
FRAME_BODY: Frame
FRAME_WORLD: Frame
STATE_UNSPECIFIED: State
STATE_IDLE: State
STATE_HOLDING: State
STATE_STREAMING: State
STATE_STOPPING: State
STATE_FAULT: State
STATE_TRACKING: State
FAULT_NONE: Fault
FAULT_LINK_LOST: Fault
FAULT_FEEDBACK_STALE: Fault
FAULT_DEVICE_FAULT: Fault
FAULT_LIMIT_GUARD: Fault
FAULT_PATH_STARVED: Fault
FAULT_HEARTBEAT_LOST: Fault
FAULT_SERVO_DIED: Fault
FAULT_INTERNAL: Fault
FAULT_SERVO_STALLED: Fault
EVENT_KIND_UNSPECIFIED: EventKind
EVENT_KIND_READY: EventKind
EVENT_KIND_MOTION_STARTED: EventKind
EVENT_KIND_MOTION_DONE: EventKind
EVENT_KIND_MOTION_STOPPED: EventKind
EVENT_KIND_MOTION_REPLACED: EventKind
EVENT_KIND_MOTION_UNSETTLED: EventKind
EVENT_KIND_ON_TARGET: EventKind
EVENT_KIND_FAULT: EventKind
EVENT_KIND_SERVO_DIED: EventKind
EVENT_KIND_RECORDED: EventKind
EVENT_KIND_RECORDING_FAILED: EventKind
EVENT_KIND_MOTION_PASSED: EventKind
EVENT_KIND_WARNING: EventKind
OUTCOME_UNSPECIFIED: Outcome
OUTCOME_DONE: Outcome
OUTCOME_STOPPED: Outcome
OUTCOME_FAULT: Outcome
OUTCOME_REPLACED: Outcome
OUTCOME_UNSETTLED: Outcome
OUTCOME_PASSED: Outcome

class Vector3(_message.Message):
    __slots__ = ("x", "y", "z")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class Quaternion(_message.Message):
    __slots__ = ("w", "x", "y", "z")
    W_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    w: float
    x: float
    y: float
    z: float
    def __init__(self, w: _Optional[float] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class Limits(_message.Message):
    __slots__ = ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration", "axis_velocity", "axis_acceleration", "axis_jerk")
    VELOCITY_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_FIELD_NUMBER: _ClassVar[int]
    JERK_FIELD_NUMBER: _ClassVar[int]
    LINEAR_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    LINEAR_ACCELERATION_FIELD_NUMBER: _ClassVar[int]
    AXIS_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    AXIS_ACCELERATION_FIELD_NUMBER: _ClassVar[int]
    AXIS_JERK_FIELD_NUMBER: _ClassVar[int]
    velocity: float
    acceleration: float
    jerk: float
    linear_velocity: float
    linear_acceleration: float
    axis_velocity: Vector3
    axis_acceleration: Vector3
    axis_jerk: Vector3
    def __init__(self, velocity: _Optional[float] = ..., acceleration: _Optional[float] = ..., jerk: _Optional[float] = ..., linear_velocity: _Optional[float] = ..., linear_acceleration: _Optional[float] = ..., axis_velocity: _Optional[_Union[Vector3, _Mapping]] = ..., axis_acceleration: _Optional[_Union[Vector3, _Mapping]] = ..., axis_jerk: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class KeyframeColumns(_message.Message):
    __slots__ = ("quaternions", "times", "positions", "turns", "free_roll", "relative", "frames", "names", "rotation_vectors")
    QUATERNIONS_FIELD_NUMBER: _ClassVar[int]
    TIMES_FIELD_NUMBER: _ClassVar[int]
    POSITIONS_FIELD_NUMBER: _ClassVar[int]
    TURNS_FIELD_NUMBER: _ClassVar[int]
    FREE_ROLL_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_FIELD_NUMBER: _ClassVar[int]
    FRAMES_FIELD_NUMBER: _ClassVar[int]
    NAMES_FIELD_NUMBER: _ClassVar[int]
    ROTATION_VECTORS_FIELD_NUMBER: _ClassVar[int]
    quaternions: _containers.RepeatedScalarFieldContainer[float]
    times: _containers.RepeatedScalarFieldContainer[float]
    positions: _containers.RepeatedScalarFieldContainer[float]
    turns: _containers.RepeatedScalarFieldContainer[int]
    free_roll: _containers.RepeatedScalarFieldContainer[bool]
    relative: _containers.RepeatedScalarFieldContainer[bool]
    frames: _containers.RepeatedScalarFieldContainer[str]
    names: _containers.RepeatedScalarFieldContainer[str]
    rotation_vectors: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, quaternions: _Optional[_Iterable[float]] = ..., times: _Optional[_Iterable[float]] = ..., positions: _Optional[_Iterable[float]] = ..., turns: _Optional[_Iterable[int]] = ..., free_roll: _Optional[_Iterable[bool]] = ..., relative: _Optional[_Iterable[bool]] = ..., frames: _Optional[_Iterable[str]] = ..., names: _Optional[_Iterable[str]] = ..., rotation_vectors: _Optional[_Iterable[float]] = ...) -> None: ...

class AzimuthElevation(_message.Message):
    __slots__ = ("azimuth", "elevation")
    AZIMUTH_FIELD_NUMBER: _ClassVar[int]
    ELEVATION_FIELD_NUMBER: _ClassVar[int]
    azimuth: float
    elevation: float
    def __init__(self, azimuth: _Optional[float] = ..., elevation: _Optional[float] = ...) -> None: ...

class Sun(_message.Message):
    __slots__ = ("latitude", "longitude", "north")
    LATITUDE_FIELD_NUMBER: _ClassVar[int]
    LONGITUDE_FIELD_NUMBER: _ClassVar[int]
    NORTH_FIELD_NUMBER: _ClassVar[int]
    latitude: float
    longitude: float
    north: float
    def __init__(self, latitude: _Optional[float] = ..., longitude: _Optional[float] = ..., north: _Optional[float] = ...) -> None: ...

class KeepOut(_message.Message):
    __slots__ = ("name", "direction", "azimuth_elevation", "sun", "half_angle_deg", "margin_deg", "axis")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DIRECTION_FIELD_NUMBER: _ClassVar[int]
    AZIMUTH_ELEVATION_FIELD_NUMBER: _ClassVar[int]
    SUN_FIELD_NUMBER: _ClassVar[int]
    HALF_ANGLE_DEG_FIELD_NUMBER: _ClassVar[int]
    MARGIN_DEG_FIELD_NUMBER: _ClassVar[int]
    AXIS_FIELD_NUMBER: _ClassVar[int]
    name: str
    direction: Vector3
    azimuth_elevation: AzimuthElevation
    sun: Sun
    half_angle_deg: float
    margin_deg: float
    axis: Vector3
    def __init__(self, name: _Optional[str] = ..., direction: _Optional[_Union[Vector3, _Mapping]] = ..., azimuth_elevation: _Optional[_Union[AzimuthElevation, _Mapping]] = ..., sun: _Optional[_Union[Sun, _Mapping]] = ..., half_angle_deg: _Optional[float] = ..., margin_deg: _Optional[float] = ..., axis: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class Peak(_message.Message):
    __slots__ = ("value", "time", "limit", "on_records")
    VALUE_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    ON_RECORDS_FIELD_NUMBER: _ClassVar[int]
    value: float
    time: float
    limit: float
    on_records: float
    def __init__(self, value: _Optional[float] = ..., time: _Optional[float] = ..., limit: _Optional[float] = ..., on_records: _Optional[float] = ...) -> None: ...

class Figure(_message.Message):
    __slots__ = ("name", "value", "unit", "limit", "time")
    NAME_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    name: str
    value: float
    unit: str
    limit: float
    time: float
    def __init__(self, name: _Optional[str] = ..., value: _Optional[float] = ..., unit: _Optional[str] = ..., limit: _Optional[float] = ..., time: _Optional[float] = ...) -> None: ...

class Certificate(_message.Message):
    __slots__ = ("rate_hz", "duration", "lead_in", "lead_out", "peak_velocity", "peak_acceleration", "peak_jerk", "peak_linear_velocity", "peak_linear_acceleration", "start_velocity_error", "end_velocity_error", "keyframe_error", "brake_rate", "stop_time", "figures", "notes", "usual_stop_time", "has_control_points", "losses")
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    LEAD_IN_FIELD_NUMBER: _ClassVar[int]
    LEAD_OUT_FIELD_NUMBER: _ClassVar[int]
    PEAK_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    PEAK_ACCELERATION_FIELD_NUMBER: _ClassVar[int]
    PEAK_JERK_FIELD_NUMBER: _ClassVar[int]
    PEAK_LINEAR_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    PEAK_LINEAR_ACCELERATION_FIELD_NUMBER: _ClassVar[int]
    START_VELOCITY_ERROR_FIELD_NUMBER: _ClassVar[int]
    END_VELOCITY_ERROR_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_ERROR_FIELD_NUMBER: _ClassVar[int]
    BRAKE_RATE_FIELD_NUMBER: _ClassVar[int]
    STOP_TIME_FIELD_NUMBER: _ClassVar[int]
    FIGURES_FIELD_NUMBER: _ClassVar[int]
    NOTES_FIELD_NUMBER: _ClassVar[int]
    USUAL_STOP_TIME_FIELD_NUMBER: _ClassVar[int]
    HAS_CONTROL_POINTS_FIELD_NUMBER: _ClassVar[int]
    LOSSES_FIELD_NUMBER: _ClassVar[int]
    rate_hz: float
    duration: float
    lead_in: float
    lead_out: float
    peak_velocity: Peak
    peak_acceleration: Peak
    peak_jerk: Peak
    peak_linear_velocity: Peak
    peak_linear_acceleration: Peak
    start_velocity_error: float
    end_velocity_error: float
    keyframe_error: float
    brake_rate: float
    stop_time: float
    figures: _containers.RepeatedCompositeFieldContainer[Figure]
    notes: _containers.RepeatedScalarFieldContainer[str]
    usual_stop_time: float
    has_control_points: bool
    losses: _containers.RepeatedCompositeFieldContainer[Loss]
    def __init__(self, rate_hz: _Optional[float] = ..., duration: _Optional[float] = ..., lead_in: _Optional[float] = ..., lead_out: _Optional[float] = ..., peak_velocity: _Optional[_Union[Peak, _Mapping]] = ..., peak_acceleration: _Optional[_Union[Peak, _Mapping]] = ..., peak_jerk: _Optional[_Union[Peak, _Mapping]] = ..., peak_linear_velocity: _Optional[_Union[Peak, _Mapping]] = ..., peak_linear_acceleration: _Optional[_Union[Peak, _Mapping]] = ..., start_velocity_error: _Optional[float] = ..., end_velocity_error: _Optional[float] = ..., keyframe_error: _Optional[float] = ..., brake_rate: _Optional[float] = ..., stop_time: _Optional[float] = ..., figures: _Optional[_Iterable[_Union[Figure, _Mapping]]] = ..., notes: _Optional[_Iterable[str]] = ..., usual_stop_time: _Optional[float] = ..., has_control_points: bool = ..., losses: _Optional[_Iterable[_Union[Loss, _Mapping]]] = ...) -> None: ...

class Loss(_message.Message):
    __slots__ = ("start", "end", "error")
    START_FIELD_NUMBER: _ClassVar[int]
    END_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    start: float
    end: float
    error: float
    def __init__(self, start: _Optional[float] = ..., end: _Optional[float] = ..., error: _Optional[float] = ...) -> None: ...

class Plan(_message.Message):
    __slots__ = ("motion_id", "duration", "start_time", "end_time", "keyframe_times", "certificate", "name", "planning", "samples", "keep_out")
    MOTION_ID_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    START_TIME_FIELD_NUMBER: _ClassVar[int]
    END_TIME_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_TIMES_FIELD_NUMBER: _ClassVar[int]
    CERTIFICATE_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    PLANNING_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    KEEP_OUT_FIELD_NUMBER: _ClassVar[int]
    motion_id: str
    duration: float
    start_time: float
    end_time: float
    keyframe_times: _containers.RepeatedScalarFieldContainer[float]
    certificate: Certificate
    name: str
    planning: float
    samples: MotionColumns
    keep_out: _containers.RepeatedCompositeFieldContainer[KeepOut]
    def __init__(self, motion_id: _Optional[str] = ..., duration: _Optional[float] = ..., start_time: _Optional[float] = ..., end_time: _Optional[float] = ..., keyframe_times: _Optional[_Iterable[float]] = ..., certificate: _Optional[_Union[Certificate, _Mapping]] = ..., name: _Optional[str] = ..., planning: _Optional[float] = ..., samples: _Optional[_Union[MotionColumns, _Mapping]] = ..., keep_out: _Optional[_Iterable[_Union[KeepOut, _Mapping]]] = ...) -> None: ...

class MotionColumns(_message.Message):
    __slots__ = ("path_times", "q", "omega_body", "alpha_body", "position", "velocity")
    PATH_TIMES_FIELD_NUMBER: _ClassVar[int]
    Q_FIELD_NUMBER: _ClassVar[int]
    OMEGA_BODY_FIELD_NUMBER: _ClassVar[int]
    ALPHA_BODY_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FIELD_NUMBER: _ClassVar[int]
    path_times: _containers.RepeatedScalarFieldContainer[float]
    q: _containers.RepeatedScalarFieldContainer[float]
    omega_body: _containers.RepeatedScalarFieldContainer[float]
    alpha_body: _containers.RepeatedScalarFieldContainer[float]
    position: _containers.RepeatedScalarFieldContainer[float]
    velocity: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, path_times: _Optional[_Iterable[float]] = ..., q: _Optional[_Iterable[float]] = ..., omega_body: _Optional[_Iterable[float]] = ..., alpha_body: _Optional[_Iterable[float]] = ..., position: _Optional[_Iterable[float]] = ..., velocity: _Optional[_Iterable[float]] = ...) -> None: ...

class MotionSample(_message.Message):
    __slots__ = ("path_time", "q", "omega_body", "alpha_body", "position", "velocity")
    PATH_TIME_FIELD_NUMBER: _ClassVar[int]
    Q_FIELD_NUMBER: _ClassVar[int]
    OMEGA_BODY_FIELD_NUMBER: _ClassVar[int]
    ALPHA_BODY_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FIELD_NUMBER: _ClassVar[int]
    path_time: float
    q: Quaternion
    omega_body: Vector3
    alpha_body: Vector3
    position: Vector3
    velocity: Vector3
    def __init__(self, path_time: _Optional[float] = ..., q: _Optional[_Union[Quaternion, _Mapping]] = ..., omega_body: _Optional[_Union[Vector3, _Mapping]] = ..., alpha_body: _Optional[_Union[Vector3, _Mapping]] = ..., position: _Optional[_Union[Vector3, _Mapping]] = ..., velocity: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class Cycle(_message.Message):
    __slots__ = ("index", "deadline_ns", "lateness_ns", "work_ns", "feedback_age_ns", "state", "fault", "motion_number", "is_written", "overruns", "missed", "path_index", "path_fraction", "speed", "q", "omega_body", "alpha_body", "position", "feedback_q", "feedback_omega_body", "feedback_position", "tracking_error")
    INDEX_FIELD_NUMBER: _ClassVar[int]
    DEADLINE_NS_FIELD_NUMBER: _ClassVar[int]
    LATENESS_NS_FIELD_NUMBER: _ClassVar[int]
    WORK_NS_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_AGE_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    MOTION_NUMBER_FIELD_NUMBER: _ClassVar[int]
    IS_WRITTEN_FIELD_NUMBER: _ClassVar[int]
    OVERRUNS_FIELD_NUMBER: _ClassVar[int]
    MISSED_FIELD_NUMBER: _ClassVar[int]
    PATH_INDEX_FIELD_NUMBER: _ClassVar[int]
    PATH_FRACTION_FIELD_NUMBER: _ClassVar[int]
    SPEED_FIELD_NUMBER: _ClassVar[int]
    Q_FIELD_NUMBER: _ClassVar[int]
    OMEGA_BODY_FIELD_NUMBER: _ClassVar[int]
    ALPHA_BODY_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_Q_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_OMEGA_BODY_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_POSITION_FIELD_NUMBER: _ClassVar[int]
    TRACKING_ERROR_FIELD_NUMBER: _ClassVar[int]
    index: int
    deadline_ns: int
    lateness_ns: int
    work_ns: int
    feedback_age_ns: int
    state: State
    fault: Fault
    motion_number: int
    is_written: bool
    overruns: int
    missed: int
    path_index: int
    path_fraction: float
    speed: float
    q: Quaternion
    omega_body: Vector3
    alpha_body: Vector3
    position: Vector3
    feedback_q: Quaternion
    feedback_omega_body: Vector3
    feedback_position: Vector3
    tracking_error: float
    def __init__(self, index: _Optional[int] = ..., deadline_ns: _Optional[int] = ..., lateness_ns: _Optional[int] = ..., work_ns: _Optional[int] = ..., feedback_age_ns: _Optional[int] = ..., state: _Optional[_Union[State, str]] = ..., fault: _Optional[_Union[Fault, str]] = ..., motion_number: _Optional[int] = ..., is_written: bool = ..., overruns: _Optional[int] = ..., missed: _Optional[int] = ..., path_index: _Optional[int] = ..., path_fraction: _Optional[float] = ..., speed: _Optional[float] = ..., q: _Optional[_Union[Quaternion, _Mapping]] = ..., omega_body: _Optional[_Union[Vector3, _Mapping]] = ..., alpha_body: _Optional[_Union[Vector3, _Mapping]] = ..., position: _Optional[_Union[Vector3, _Mapping]] = ..., feedback_q: _Optional[_Union[Quaternion, _Mapping]] = ..., feedback_omega_body: _Optional[_Union[Vector3, _Mapping]] = ..., feedback_position: _Optional[_Union[Vector3, _Mapping]] = ..., tracking_error: _Optional[float] = ...) -> None: ...

class Device(_message.Message):
    __slots__ = ("name", "driver", "rate_hz", "limits", "lead", "phase", "keep_out")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DRIVER_FIELD_NUMBER: _ClassVar[int]
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    LEAD_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    KEEP_OUT_FIELD_NUMBER: _ClassVar[int]
    name: str
    driver: str
    rate_hz: float
    limits: Limits
    lead: float
    phase: float
    keep_out: _containers.RepeatedCompositeFieldContainer[KeepOut]
    def __init__(self, name: _Optional[str] = ..., driver: _Optional[str] = ..., rate_hz: _Optional[float] = ..., limits: _Optional[_Union[Limits, _Mapping]] = ..., lead: _Optional[float] = ..., phase: _Optional[float] = ..., keep_out: _Optional[_Iterable[_Union[KeepOut, _Mapping]]] = ...) -> None: ...

class DeviceReport(_message.Message):
    __slots__ = ("name", "driver", "rate_hz", "limits", "lead", "phase", "state", "fault", "fault_text", "is_paused", "speed", "motion_number", "motion_id", "path_time", "duration", "servo_pid", "scheduling", "is_memory_locked", "cycle", "motion_name", "is_free", "health", "cycle_age", "feedback_age", "is_stale", "keep_out", "held_at", "ended")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DRIVER_FIELD_NUMBER: _ClassVar[int]
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    LEAD_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    FAULT_TEXT_FIELD_NUMBER: _ClassVar[int]
    IS_PAUSED_FIELD_NUMBER: _ClassVar[int]
    SPEED_FIELD_NUMBER: _ClassVar[int]
    MOTION_NUMBER_FIELD_NUMBER: _ClassVar[int]
    MOTION_ID_FIELD_NUMBER: _ClassVar[int]
    PATH_TIME_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    SERVO_PID_FIELD_NUMBER: _ClassVar[int]
    SCHEDULING_FIELD_NUMBER: _ClassVar[int]
    IS_MEMORY_LOCKED_FIELD_NUMBER: _ClassVar[int]
    CYCLE_FIELD_NUMBER: _ClassVar[int]
    MOTION_NAME_FIELD_NUMBER: _ClassVar[int]
    IS_FREE_FIELD_NUMBER: _ClassVar[int]
    HEALTH_FIELD_NUMBER: _ClassVar[int]
    CYCLE_AGE_FIELD_NUMBER: _ClassVar[int]
    FEEDBACK_AGE_FIELD_NUMBER: _ClassVar[int]
    IS_STALE_FIELD_NUMBER: _ClassVar[int]
    KEEP_OUT_FIELD_NUMBER: _ClassVar[int]
    HELD_AT_FIELD_NUMBER: _ClassVar[int]
    ENDED_FIELD_NUMBER: _ClassVar[int]
    name: str
    driver: str
    rate_hz: float
    limits: Limits
    lead: float
    phase: float
    state: State
    fault: Fault
    fault_text: str
    is_paused: bool
    speed: float
    motion_number: int
    motion_id: str
    path_time: float
    duration: float
    servo_pid: int
    scheduling: str
    is_memory_locked: bool
    cycle: Cycle
    motion_name: str
    is_free: bool
    health: _containers.RepeatedCompositeFieldContainer[PartHealth]
    cycle_age: float
    feedback_age: float
    is_stale: bool
    keep_out: _containers.RepeatedCompositeFieldContainer[KeepOut]
    held_at: str
    ended: EndedMotion
    def __init__(self, name: _Optional[str] = ..., driver: _Optional[str] = ..., rate_hz: _Optional[float] = ..., limits: _Optional[_Union[Limits, _Mapping]] = ..., lead: _Optional[float] = ..., phase: _Optional[float] = ..., state: _Optional[_Union[State, str]] = ..., fault: _Optional[_Union[Fault, str]] = ..., fault_text: _Optional[str] = ..., is_paused: bool = ..., speed: _Optional[float] = ..., motion_number: _Optional[int] = ..., motion_id: _Optional[str] = ..., path_time: _Optional[float] = ..., duration: _Optional[float] = ..., servo_pid: _Optional[int] = ..., scheduling: _Optional[str] = ..., is_memory_locked: bool = ..., cycle: _Optional[_Union[Cycle, _Mapping]] = ..., motion_name: _Optional[str] = ..., is_free: bool = ..., health: _Optional[_Iterable[_Union[PartHealth, _Mapping]]] = ..., cycle_age: _Optional[float] = ..., feedback_age: _Optional[float] = ..., is_stale: bool = ..., keep_out: _Optional[_Iterable[_Union[KeepOut, _Mapping]]] = ..., held_at: _Optional[str] = ..., ended: _Optional[_Union[EndedMotion, _Mapping]] = ...) -> None: ...

class EndedMotion(_message.Message):
    __slots__ = ("motion_number", "name", "outcome", "text", "path_time", "duration")
    MOTION_NUMBER_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    PATH_TIME_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    motion_number: int
    name: str
    outcome: Outcome
    text: str
    path_time: float
    duration: float
    def __init__(self, motion_number: _Optional[int] = ..., name: _Optional[str] = ..., outcome: _Optional[_Union[Outcome, str]] = ..., text: _Optional[str] = ..., path_time: _Optional[float] = ..., duration: _Optional[float] = ...) -> None: ...

class PartHealth(_message.Message):
    __slots__ = ("name", "age", "is_stale", "voltage", "temperature", "current", "warning")
    NAME_FIELD_NUMBER: _ClassVar[int]
    AGE_FIELD_NUMBER: _ClassVar[int]
    IS_STALE_FIELD_NUMBER: _ClassVar[int]
    VOLTAGE_FIELD_NUMBER: _ClassVar[int]
    TEMPERATURE_FIELD_NUMBER: _ClassVar[int]
    CURRENT_FIELD_NUMBER: _ClassVar[int]
    WARNING_FIELD_NUMBER: _ClassVar[int]
    name: str
    age: float
    is_stale: bool
    voltage: float
    temperature: float
    current: float
    warning: str
    def __init__(self, name: _Optional[str] = ..., age: _Optional[float] = ..., is_stale: bool = ..., voltage: _Optional[float] = ..., temperature: _Optional[float] = ..., current: _Optional[float] = ..., warning: _Optional[str] = ...) -> None: ...

class LeaseReport(_message.Message):
    __slots__ = ("holder", "remaining", "identity", "devices")
    HOLDER_FIELD_NUMBER: _ClassVar[int]
    REMAINING_FIELD_NUMBER: _ClassVar[int]
    IDENTITY_FIELD_NUMBER: _ClassVar[int]
    DEVICES_FIELD_NUMBER: _ClassVar[int]
    holder: str
    remaining: float
    identity: str
    devices: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, holder: _Optional[str] = ..., remaining: _Optional[float] = ..., identity: _Optional[str] = ..., devices: _Optional[_Iterable[str]] = ...) -> None: ...

class DaemonReport(_message.Message):
    __slots__ = ("version", "pid", "uptime", "socket", "configuration", "leases")
    VERSION_FIELD_NUMBER: _ClassVar[int]
    PID_FIELD_NUMBER: _ClassVar[int]
    UPTIME_FIELD_NUMBER: _ClassVar[int]
    SOCKET_FIELD_NUMBER: _ClassVar[int]
    CONFIGURATION_FIELD_NUMBER: _ClassVar[int]
    LEASES_FIELD_NUMBER: _ClassVar[int]
    version: str
    pid: int
    uptime: float
    socket: str
    configuration: str
    leases: _containers.RepeatedCompositeFieldContainer[LeaseReport]
    def __init__(self, version: _Optional[str] = ..., pid: _Optional[int] = ..., uptime: _Optional[float] = ..., socket: _Optional[str] = ..., configuration: _Optional[str] = ..., leases: _Optional[_Iterable[_Union[LeaseReport, _Mapping]]] = ...) -> None: ...

class GetStateRequest(_message.Message):
    __slots__ = ("device",)
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    device: str
    def __init__(self, device: _Optional[str] = ...) -> None: ...

class GetStateResponse(_message.Message):
    __slots__ = ("daemon", "devices", "monotonic_ns", "clock")
    DAEMON_FIELD_NUMBER: _ClassVar[int]
    DEVICES_FIELD_NUMBER: _ClassVar[int]
    MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    CLOCK_FIELD_NUMBER: _ClassVar[int]
    daemon: DaemonReport
    devices: _containers.RepeatedCompositeFieldContainer[DeviceReport]
    monotonic_ns: int
    clock: str
    def __init__(self, daemon: _Optional[_Union[DaemonReport, _Mapping]] = ..., devices: _Optional[_Iterable[_Union[DeviceReport, _Mapping]]] = ..., monotonic_ns: _Optional[int] = ..., clock: _Optional[str] = ...) -> None: ...

class WatchStateRequest(_message.Message):
    __slots__ = ("device", "rate_hz", "decimation", "as_records", "with_outline")
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    DECIMATION_FIELD_NUMBER: _ClassVar[int]
    AS_RECORDS_FIELD_NUMBER: _ClassVar[int]
    WITH_OUTLINE_FIELD_NUMBER: _ClassVar[int]
    device: str
    rate_hz: float
    decimation: int
    as_records: bool
    with_outline: bool
    def __init__(self, device: _Optional[str] = ..., rate_hz: _Optional[float] = ..., decimation: _Optional[int] = ..., as_records: bool = ..., with_outline: bool = ...) -> None: ...

class Polyline(_message.Message):
    __slots__ = ("coordinates",)
    COORDINATES_FIELD_NUMBER: _ClassVar[int]
    coordinates: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, coordinates: _Optional[_Iterable[float]] = ...) -> None: ...

class WatchStateResponse(_message.Message):
    __slots__ = ("cycles", "lost", "records", "layout", "outline")
    CYCLES_FIELD_NUMBER: _ClassVar[int]
    LOST_FIELD_NUMBER: _ClassVar[int]
    RECORDS_FIELD_NUMBER: _ClassVar[int]
    LAYOUT_FIELD_NUMBER: _ClassVar[int]
    OUTLINE_FIELD_NUMBER: _ClassVar[int]
    cycles: _containers.RepeatedCompositeFieldContainer[Cycle]
    lost: int
    records: bytes
    layout: str
    outline: _containers.RepeatedCompositeFieldContainer[Polyline]
    def __init__(self, cycles: _Optional[_Iterable[_Union[Cycle, _Mapping]]] = ..., lost: _Optional[int] = ..., records: _Optional[bytes] = ..., layout: _Optional[str] = ..., outline: _Optional[_Iterable[_Union[Polyline, _Mapping]]] = ...) -> None: ...

class WatchEventsRequest(_message.Message):
    __slots__ = ("device",)
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    device: str
    def __init__(self, device: _Optional[str] = ...) -> None: ...

class WatchEventsResponse(_message.Message):
    __slots__ = ("events", "lost")
    EVENTS_FIELD_NUMBER: _ClassVar[int]
    LOST_FIELD_NUMBER: _ClassVar[int]
    events: _containers.RepeatedCompositeFieldContainer[Event]
    lost: int
    def __init__(self, events: _Optional[_Iterable[_Union[Event, _Mapping]]] = ..., lost: _Optional[int] = ...) -> None: ...

class Event(_message.Message):
    __slots__ = ("device", "kind", "motion_number", "text", "time_ns", "plan", "samples", "path_index", "motion", "source", "columns")
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    MOTION_NUMBER_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    PLAN_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    PATH_INDEX_FIELD_NUMBER: _ClassVar[int]
    MOTION_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    device: str
    kind: EventKind
    motion_number: int
    text: str
    time_ns: int
    plan: Plan
    samples: _containers.RepeatedCompositeFieldContainer[MotionSample]
    path_index: int
    motion: bytes
    source: str
    columns: bytes
    def __init__(self, device: _Optional[str] = ..., kind: _Optional[_Union[EventKind, str]] = ..., motion_number: _Optional[int] = ..., text: _Optional[str] = ..., time_ns: _Optional[int] = ..., plan: _Optional[_Union[Plan, _Mapping]] = ..., samples: _Optional[_Iterable[_Union[MotionSample, _Mapping]]] = ..., path_index: _Optional[int] = ..., motion: _Optional[bytes] = ..., source: _Optional[str] = ..., columns: _Optional[bytes] = ...) -> None: ...

class GetConfigurationRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class GetConfigurationResponse(_message.Message):
    __slots__ = ("json", "monotonic_ns", "time")
    JSON_FIELD_NUMBER: _ClassVar[int]
    MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    json: str
    monotonic_ns: int
    time: _timestamp_pb2.Timestamp
    def __init__(self, json: _Optional[str] = ..., monotonic_ns: _Optional[int] = ..., time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class ListMethodsRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class Method(_message.Message):
    __slots__ = ("name", "summary", "source", "interpolates", "is_local", "meets_end_velocities")
    NAME_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    INTERPOLATES_FIELD_NUMBER: _ClassVar[int]
    IS_LOCAL_FIELD_NUMBER: _ClassVar[int]
    MEETS_END_VELOCITIES_FIELD_NUMBER: _ClassVar[int]
    name: str
    summary: str
    source: str
    interpolates: bool
    is_local: bool
    meets_end_velocities: bool
    def __init__(self, name: _Optional[str] = ..., summary: _Optional[str] = ..., source: _Optional[str] = ..., interpolates: bool = ..., is_local: bool = ..., meets_end_velocities: bool = ...) -> None: ...

class ListMethodsResponse(_message.Message):
    __slots__ = ("methods",)
    METHODS_FIELD_NUMBER: _ClassVar[int]
    methods: _containers.RepeatedCompositeFieldContainer[Method]
    def __init__(self, methods: _Optional[_Iterable[_Union[Method, _Mapping]]] = ...) -> None: ...

class ListDevicesRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class ListDevicesResponse(_message.Message):
    __slots__ = ("devices",)
    DEVICES_FIELD_NUMBER: _ClassVar[int]
    devices: _containers.RepeatedCompositeFieldContainer[Device]
    def __init__(self, devices: _Optional[_Iterable[_Union[Device, _Mapping]]] = ...) -> None: ...

class PlanRequest(_message.Message):
    __slots__ = ("device", "earlier_motion", "sample_rate_hz", "plan_timeout", "motion", "source", "columns")
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    EARLIER_MOTION_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    PLAN_TIMEOUT_FIELD_NUMBER: _ClassVar[int]
    MOTION_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    device: str
    earlier_motion: bytes
    sample_rate_hz: float
    plan_timeout: float
    motion: bytes
    source: str
    columns: bytes
    def __init__(self, device: _Optional[str] = ..., earlier_motion: _Optional[bytes] = ..., sample_rate_hz: _Optional[float] = ..., plan_timeout: _Optional[float] = ..., motion: _Optional[bytes] = ..., source: _Optional[str] = ..., columns: _Optional[bytes] = ...) -> None: ...

class PlanResponse(_message.Message):
    __slots__ = ("plan",)
    PLAN_FIELD_NUMBER: _ClassVar[int]
    plan: Plan
    def __init__(self, plan: _Optional[_Union[Plan, _Mapping]] = ...) -> None: ...

class GetPlanRequest(_message.Message):
    __slots__ = ("device", "motion_id", "sample_rate_hz")
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    MOTION_ID_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    device: str
    motion_id: str
    sample_rate_hz: float
    def __init__(self, device: _Optional[str] = ..., motion_id: _Optional[str] = ..., sample_rate_hz: _Optional[float] = ...) -> None: ...

class GetPlanResponse(_message.Message):
    __slots__ = ("plan",)
    PLAN_FIELD_NUMBER: _ClassVar[int]
    plan: Plan
    def __init__(self, plan: _Optional[_Union[Plan, _Mapping]] = ...) -> None: ...

class MoveRequest(_message.Message):
    __slots__ = ("lease_token", "device", "motion", "motion_id", "earlier_motion", "progress_rate_hz", "queue", "blend_tolerance", "start_time", "on_target", "plan_timeout", "start_ns", "holder", "beside", "source", "columns")
    LEASE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    MOTION_FIELD_NUMBER: _ClassVar[int]
    MOTION_ID_FIELD_NUMBER: _ClassVar[int]
    EARLIER_MOTION_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    QUEUE_FIELD_NUMBER: _ClassVar[int]
    BLEND_TOLERANCE_FIELD_NUMBER: _ClassVar[int]
    START_TIME_FIELD_NUMBER: _ClassVar[int]
    ON_TARGET_FIELD_NUMBER: _ClassVar[int]
    PLAN_TIMEOUT_FIELD_NUMBER: _ClassVar[int]
    START_NS_FIELD_NUMBER: _ClassVar[int]
    HOLDER_FIELD_NUMBER: _ClassVar[int]
    BESIDE_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    lease_token: str
    device: str
    motion: bytes
    motion_id: str
    earlier_motion: bytes
    progress_rate_hz: float
    queue: bool
    blend_tolerance: float
    start_time: _timestamp_pb2.Timestamp
    on_target: OnTarget
    plan_timeout: float
    start_ns: int
    holder: str
    beside: bool
    source: str
    columns: bytes
    def __init__(self, lease_token: _Optional[str] = ..., device: _Optional[str] = ..., motion: _Optional[bytes] = ..., motion_id: _Optional[str] = ..., earlier_motion: _Optional[bytes] = ..., progress_rate_hz: _Optional[float] = ..., queue: bool = ..., blend_tolerance: _Optional[float] = ..., start_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., on_target: _Optional[_Union[OnTarget, _Mapping]] = ..., plan_timeout: _Optional[float] = ..., start_ns: _Optional[int] = ..., holder: _Optional[str] = ..., beside: bool = ..., source: _Optional[str] = ..., columns: _Optional[bytes] = ...) -> None: ...

class OnTarget(_message.Message):
    __slots__ = ("tolerance", "rate", "settle_time", "timeout")
    TOLERANCE_FIELD_NUMBER: _ClassVar[int]
    RATE_FIELD_NUMBER: _ClassVar[int]
    SETTLE_TIME_FIELD_NUMBER: _ClassVar[int]
    TIMEOUT_FIELD_NUMBER: _ClassVar[int]
    tolerance: float
    rate: float
    settle_time: float
    timeout: float
    def __init__(self, tolerance: _Optional[float] = ..., rate: _Optional[float] = ..., settle_time: _Optional[float] = ..., timeout: _Optional[float] = ...) -> None: ...

class MoveTiming(_message.Message):
    __slots__ = ("planning", "splicing", "received_ns", "attempts", "waiting")
    PLANNING_FIELD_NUMBER: _ClassVar[int]
    SPLICING_FIELD_NUMBER: _ClassVar[int]
    RECEIVED_NS_FIELD_NUMBER: _ClassVar[int]
    ATTEMPTS_FIELD_NUMBER: _ClassVar[int]
    WAITING_FIELD_NUMBER: _ClassVar[int]
    planning: float
    splicing: float
    received_ns: int
    attempts: int
    waiting: float
    def __init__(self, planning: _Optional[float] = ..., splicing: _Optional[float] = ..., received_ns: _Optional[int] = ..., attempts: _Optional[int] = ..., waiting: _Optional[float] = ...) -> None: ...

class MoveStarted(_message.Message):
    __slots__ = ("motion_number", "plan", "timing", "speed", "lease")
    MOTION_NUMBER_FIELD_NUMBER: _ClassVar[int]
    PLAN_FIELD_NUMBER: _ClassVar[int]
    TIMING_FIELD_NUMBER: _ClassVar[int]
    SPEED_FIELD_NUMBER: _ClassVar[int]
    LEASE_FIELD_NUMBER: _ClassVar[int]
    motion_number: int
    plan: Plan
    timing: MoveTiming
    speed: float
    lease: Lease
    def __init__(self, motion_number: _Optional[int] = ..., plan: _Optional[_Union[Plan, _Mapping]] = ..., timing: _Optional[_Union[MoveTiming, _Mapping]] = ..., speed: _Optional[float] = ..., lease: _Optional[_Union[Lease, _Mapping]] = ...) -> None: ...

class MoveProgress(_message.Message):
    __slots__ = ("path_time", "duration", "state", "is_paused", "speed", "q", "omega_body", "position", "lateness", "tracking_error", "overruns")
    PATH_TIME_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    IS_PAUSED_FIELD_NUMBER: _ClassVar[int]
    SPEED_FIELD_NUMBER: _ClassVar[int]
    Q_FIELD_NUMBER: _ClassVar[int]
    OMEGA_BODY_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    LATENESS_FIELD_NUMBER: _ClassVar[int]
    TRACKING_ERROR_FIELD_NUMBER: _ClassVar[int]
    OVERRUNS_FIELD_NUMBER: _ClassVar[int]
    path_time: float
    duration: float
    state: State
    is_paused: bool
    speed: float
    q: Quaternion
    omega_body: Vector3
    position: Vector3
    lateness: float
    tracking_error: float
    overruns: int
    def __init__(self, path_time: _Optional[float] = ..., duration: _Optional[float] = ..., state: _Optional[_Union[State, str]] = ..., is_paused: bool = ..., speed: _Optional[float] = ..., q: _Optional[_Union[Quaternion, _Mapping]] = ..., omega_body: _Optional[_Union[Vector3, _Mapping]] = ..., position: _Optional[_Union[Vector3, _Mapping]] = ..., lateness: _Optional[float] = ..., tracking_error: _Optional[float] = ..., overruns: _Optional[int] = ...) -> None: ...

class Durations(_message.Message):
    __slots__ = ("p50", "p99", "p99_9", "largest")
    P50_FIELD_NUMBER: _ClassVar[int]
    P99_FIELD_NUMBER: _ClassVar[int]
    P99_9_FIELD_NUMBER: _ClassVar[int]
    LARGEST_FIELD_NUMBER: _ClassVar[int]
    p50: float
    p99: float
    p99_9: float
    largest: float
    def __init__(self, p50: _Optional[float] = ..., p99: _Optional[float] = ..., p99_9: _Optional[float] = ..., largest: _Optional[float] = ...) -> None: ...

class MotionStatistics(_message.Message):
    __slots__ = ("cycles", "overruns", "missed", "lateness", "work", "velocity", "acceleration", "jerk", "path_error", "tracking_error", "start_velocity_error", "end_velocity_error", "stalls")
    CYCLES_FIELD_NUMBER: _ClassVar[int]
    OVERRUNS_FIELD_NUMBER: _ClassVar[int]
    MISSED_FIELD_NUMBER: _ClassVar[int]
    LATENESS_FIELD_NUMBER: _ClassVar[int]
    WORK_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_FIELD_NUMBER: _ClassVar[int]
    JERK_FIELD_NUMBER: _ClassVar[int]
    PATH_ERROR_FIELD_NUMBER: _ClassVar[int]
    TRACKING_ERROR_FIELD_NUMBER: _ClassVar[int]
    START_VELOCITY_ERROR_FIELD_NUMBER: _ClassVar[int]
    END_VELOCITY_ERROR_FIELD_NUMBER: _ClassVar[int]
    STALLS_FIELD_NUMBER: _ClassVar[int]
    cycles: int
    overruns: int
    missed: int
    lateness: Durations
    work: Durations
    velocity: float
    acceleration: float
    jerk: float
    path_error: float
    tracking_error: float
    start_velocity_error: float
    end_velocity_error: float
    stalls: int
    def __init__(self, cycles: _Optional[int] = ..., overruns: _Optional[int] = ..., missed: _Optional[int] = ..., lateness: _Optional[_Union[Durations, _Mapping]] = ..., work: _Optional[_Union[Durations, _Mapping]] = ..., velocity: _Optional[float] = ..., acceleration: _Optional[float] = ..., jerk: _Optional[float] = ..., path_error: _Optional[float] = ..., tracking_error: _Optional[float] = ..., start_velocity_error: _Optional[float] = ..., end_velocity_error: _Optional[float] = ..., stalls: _Optional[int] = ...) -> None: ...

class MoveSummary(_message.Message):
    __slots__ = ("motion_number", "outcome", "text", "statistics", "settled_after", "start_lateness", "start_skew")
    MOTION_NUMBER_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    STATISTICS_FIELD_NUMBER: _ClassVar[int]
    SETTLED_AFTER_FIELD_NUMBER: _ClassVar[int]
    START_LATENESS_FIELD_NUMBER: _ClassVar[int]
    START_SKEW_FIELD_NUMBER: _ClassVar[int]
    motion_number: int
    outcome: Outcome
    text: str
    statistics: MotionStatistics
    settled_after: float
    start_lateness: float
    start_skew: float
    def __init__(self, motion_number: _Optional[int] = ..., outcome: _Optional[_Union[Outcome, str]] = ..., text: _Optional[str] = ..., statistics: _Optional[_Union[MotionStatistics, _Mapping]] = ..., settled_after: _Optional[float] = ..., start_lateness: _Optional[float] = ..., start_skew: _Optional[float] = ...) -> None: ...

class MoveResponse(_message.Message):
    __slots__ = ("started", "progress", "summary")
    STARTED_FIELD_NUMBER: _ClassVar[int]
    PROGRESS_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    started: MoveStarted
    progress: MoveProgress
    summary: MoveSummary
    def __init__(self, started: _Optional[_Union[MoveStarted, _Mapping]] = ..., progress: _Optional[_Union[MoveProgress, _Mapping]] = ..., summary: _Optional[_Union[MoveSummary, _Mapping]] = ...) -> None: ...

class StopRequest(_message.Message):
    __slots__ = ("device", "caller", "motion_number")
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    CALLER_FIELD_NUMBER: _ClassVar[int]
    MOTION_NUMBER_FIELD_NUMBER: _ClassVar[int]
    device: str
    caller: str
    motion_number: int
    def __init__(self, device: _Optional[str] = ..., caller: _Optional[str] = ..., motion_number: _Optional[int] = ...) -> None: ...

class StopResponse(_message.Message):
    __slots__ = ("devices",)
    DEVICES_FIELD_NUMBER: _ClassVar[int]
    devices: _containers.RepeatedCompositeFieldContainer[DeviceReport]
    def __init__(self, devices: _Optional[_Iterable[_Union[DeviceReport, _Mapping]]] = ...) -> None: ...

class TrackStart(_message.Message):
    __slots__ = ("lease_token", "device", "limits", "report_rate_hz", "path_tolerance")
    LEASE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    REPORT_RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    PATH_TOLERANCE_FIELD_NUMBER: _ClassVar[int]
    lease_token: str
    device: str
    limits: Limits
    report_rate_hz: float
    path_tolerance: float
    def __init__(self, lease_token: _Optional[str] = ..., device: _Optional[str] = ..., limits: _Optional[_Union[Limits, _Mapping]] = ..., report_rate_hz: _Optional[float] = ..., path_tolerance: _Optional[float] = ...) -> None: ...

class TrackTarget(_message.Message):
    __slots__ = ("orientation", "angular_velocity", "velocity_frame", "time_ns", "time_to_live", "position")
    ORIENTATION_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_VELOCITY_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FRAME_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    TIME_TO_LIVE_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    orientation: Quaternion
    angular_velocity: Vector3
    velocity_frame: Frame
    time_ns: int
    time_to_live: float
    position: Vector3
    def __init__(self, orientation: _Optional[_Union[Quaternion, _Mapping]] = ..., angular_velocity: _Optional[_Union[Vector3, _Mapping]] = ..., velocity_frame: _Optional[_Union[Frame, str]] = ..., time_ns: _Optional[int] = ..., time_to_live: _Optional[float] = ..., position: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...

class TrackChunk(_message.Message):
    __slots__ = ("times_ns", "orientations", "positions", "angular_velocities", "velocity_frame", "observed_ns")
    TIMES_NS_FIELD_NUMBER: _ClassVar[int]
    ORIENTATIONS_FIELD_NUMBER: _ClassVar[int]
    POSITIONS_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_VELOCITIES_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FRAME_FIELD_NUMBER: _ClassVar[int]
    OBSERVED_NS_FIELD_NUMBER: _ClassVar[int]
    times_ns: _containers.RepeatedScalarFieldContainer[int]
    orientations: _containers.RepeatedScalarFieldContainer[float]
    positions: _containers.RepeatedScalarFieldContainer[float]
    angular_velocities: _containers.RepeatedScalarFieldContainer[float]
    velocity_frame: Frame
    observed_ns: int
    def __init__(self, times_ns: _Optional[_Iterable[int]] = ..., orientations: _Optional[_Iterable[float]] = ..., positions: _Optional[_Iterable[float]] = ..., angular_velocities: _Optional[_Iterable[float]] = ..., velocity_frame: _Optional[_Union[Frame, str]] = ..., observed_ns: _Optional[int] = ...) -> None: ...

class TrackRequest(_message.Message):
    __slots__ = ("start", "target", "chunk")
    START_FIELD_NUMBER: _ClassVar[int]
    TARGET_FIELD_NUMBER: _ClassVar[int]
    CHUNK_FIELD_NUMBER: _ClassVar[int]
    start: TrackStart
    target: TrackTarget
    chunk: TrackChunk
    def __init__(self, start: _Optional[_Union[TrackStart, _Mapping]] = ..., target: _Optional[_Union[TrackTarget, _Mapping]] = ..., chunk: _Optional[_Union[TrackChunk, _Mapping]] = ...) -> None: ...

class ChunkReport(_message.Message):
    __slots__ = ("chunks", "live", "stale", "skipped", "starved", "largest_seam", "behind", "largest_behind", "longest_inference", "lag", "position_behind", "largest_position_behind", "position_lag", "largest_position_seam", "latency_p50", "latency_p95", "smoothed", "largest_smoothing", "largest_position_smoothing")
    CHUNKS_FIELD_NUMBER: _ClassVar[int]
    LIVE_FIELD_NUMBER: _ClassVar[int]
    STALE_FIELD_NUMBER: _ClassVar[int]
    SKIPPED_FIELD_NUMBER: _ClassVar[int]
    STARVED_FIELD_NUMBER: _ClassVar[int]
    LARGEST_SEAM_FIELD_NUMBER: _ClassVar[int]
    BEHIND_FIELD_NUMBER: _ClassVar[int]
    LARGEST_BEHIND_FIELD_NUMBER: _ClassVar[int]
    LONGEST_INFERENCE_FIELD_NUMBER: _ClassVar[int]
    LAG_FIELD_NUMBER: _ClassVar[int]
    POSITION_BEHIND_FIELD_NUMBER: _ClassVar[int]
    LARGEST_POSITION_BEHIND_FIELD_NUMBER: _ClassVar[int]
    POSITION_LAG_FIELD_NUMBER: _ClassVar[int]
    LARGEST_POSITION_SEAM_FIELD_NUMBER: _ClassVar[int]
    LATENCY_P50_FIELD_NUMBER: _ClassVar[int]
    LATENCY_P95_FIELD_NUMBER: _ClassVar[int]
    SMOOTHED_FIELD_NUMBER: _ClassVar[int]
    LARGEST_SMOOTHING_FIELD_NUMBER: _ClassVar[int]
    LARGEST_POSITION_SMOOTHING_FIELD_NUMBER: _ClassVar[int]
    chunks: int
    live: int
    stale: int
    skipped: int
    starved: int
    largest_seam: float
    behind: float
    largest_behind: float
    longest_inference: float
    lag: float
    position_behind: float
    largest_position_behind: float
    position_lag: float
    largest_position_seam: float
    latency_p50: float
    latency_p95: float
    smoothed: int
    largest_smoothing: float
    largest_position_smoothing: float
    def __init__(self, chunks: _Optional[int] = ..., live: _Optional[int] = ..., stale: _Optional[int] = ..., skipped: _Optional[int] = ..., starved: _Optional[int] = ..., largest_seam: _Optional[float] = ..., behind: _Optional[float] = ..., largest_behind: _Optional[float] = ..., longest_inference: _Optional[float] = ..., lag: _Optional[float] = ..., position_behind: _Optional[float] = ..., largest_position_behind: _Optional[float] = ..., position_lag: _Optional[float] = ..., largest_position_seam: _Optional[float] = ..., latency_p50: _Optional[float] = ..., latency_p95: _Optional[float] = ..., smoothed: _Optional[int] = ..., largest_smoothing: _Optional[float] = ..., largest_position_smoothing: _Optional[float] = ...) -> None: ...

class TrackResponse(_message.Message):
    __slots__ = ("state", "q", "omega_body", "time_ns", "targets", "left_out", "refused", "refusal", "error", "chunks", "position", "held_at", "ended", "position_error", "path_deviation", "largest_path_deviation")
    STATE_FIELD_NUMBER: _ClassVar[int]
    Q_FIELD_NUMBER: _ClassVar[int]
    OMEGA_BODY_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    TARGETS_FIELD_NUMBER: _ClassVar[int]
    LEFT_OUT_FIELD_NUMBER: _ClassVar[int]
    REFUSED_FIELD_NUMBER: _ClassVar[int]
    REFUSAL_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    CHUNKS_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    HELD_AT_FIELD_NUMBER: _ClassVar[int]
    ENDED_FIELD_NUMBER: _ClassVar[int]
    POSITION_ERROR_FIELD_NUMBER: _ClassVar[int]
    PATH_DEVIATION_FIELD_NUMBER: _ClassVar[int]
    LARGEST_PATH_DEVIATION_FIELD_NUMBER: _ClassVar[int]
    state: State
    q: Quaternion
    omega_body: Vector3
    time_ns: int
    targets: int
    left_out: int
    refused: int
    refusal: str
    error: float
    chunks: ChunkReport
    position: Vector3
    held_at: str
    ended: str
    position_error: float
    path_deviation: float
    largest_path_deviation: float
    def __init__(self, state: _Optional[_Union[State, str]] = ..., q: _Optional[_Union[Quaternion, _Mapping]] = ..., omega_body: _Optional[_Union[Vector3, _Mapping]] = ..., time_ns: _Optional[int] = ..., targets: _Optional[int] = ..., left_out: _Optional[int] = ..., refused: _Optional[int] = ..., refusal: _Optional[str] = ..., error: _Optional[float] = ..., chunks: _Optional[_Union[ChunkReport, _Mapping]] = ..., position: _Optional[_Union[Vector3, _Mapping]] = ..., held_at: _Optional[str] = ..., ended: _Optional[str] = ..., position_error: _Optional[float] = ..., path_deviation: _Optional[float] = ..., largest_path_deviation: _Optional[float] = ...) -> None: ...

class CommandRequest(_message.Message):
    __slots__ = ("lease_token", "device")
    LEASE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    lease_token: str
    device: str
    def __init__(self, lease_token: _Optional[str] = ..., device: _Optional[str] = ...) -> None: ...

class CommandResponse(_message.Message):
    __slots__ = ("device",)
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    device: DeviceReport
    def __init__(self, device: _Optional[_Union[DeviceReport, _Mapping]] = ...) -> None: ...

class SetSpeedRequest(_message.Message):
    __slots__ = ("lease_token", "device", "speed")
    LEASE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    SPEED_FIELD_NUMBER: _ClassVar[int]
    lease_token: str
    device: str
    speed: float
    def __init__(self, lease_token: _Optional[str] = ..., device: _Optional[str] = ..., speed: _Optional[float] = ...) -> None: ...

class DisableRequest(_message.Message):
    __slots__ = ("lease_token", "device", "by_hand")
    LEASE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    BY_HAND_FIELD_NUMBER: _ClassVar[int]
    lease_token: str
    device: str
    by_hand: bool
    def __init__(self, lease_token: _Optional[str] = ..., device: _Optional[str] = ..., by_hand: bool = ...) -> None: ...

class Lease(_message.Message):
    __slots__ = ("token", "holder", "seconds", "devices")
    TOKEN_FIELD_NUMBER: _ClassVar[int]
    HOLDER_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    DEVICES_FIELD_NUMBER: _ClassVar[int]
    token: str
    holder: str
    seconds: float
    devices: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, token: _Optional[str] = ..., holder: _Optional[str] = ..., seconds: _Optional[float] = ..., devices: _Optional[_Iterable[str]] = ...) -> None: ...

class AcquireLeaseRequest(_message.Message):
    __slots__ = ("holder", "devices", "beside")
    HOLDER_FIELD_NUMBER: _ClassVar[int]
    DEVICES_FIELD_NUMBER: _ClassVar[int]
    BESIDE_FIELD_NUMBER: _ClassVar[int]
    holder: str
    devices: _containers.RepeatedScalarFieldContainer[str]
    beside: bool
    def __init__(self, holder: _Optional[str] = ..., devices: _Optional[_Iterable[str]] = ..., beside: bool = ...) -> None: ...

class RenewLeaseRequest(_message.Message):
    __slots__ = ("token",)
    TOKEN_FIELD_NUMBER: _ClassVar[int]
    token: str
    def __init__(self, token: _Optional[str] = ...) -> None: ...

class ReleaseLeaseRequest(_message.Message):
    __slots__ = ("token",)
    TOKEN_FIELD_NUMBER: _ClassVar[int]
    token: str
    def __init__(self, token: _Optional[str] = ...) -> None: ...

class ReleaseLeaseResponse(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class SeizeLeaseRequest(_message.Message):
    __slots__ = ("holder", "reason", "devices")
    HOLDER_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    DEVICES_FIELD_NUMBER: _ClassVar[int]
    holder: str
    reason: str
    devices: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, holder: _Optional[str] = ..., reason: _Optional[str] = ..., devices: _Optional[_Iterable[str]] = ...) -> None: ...

class LeaseResponse(_message.Message):
    __slots__ = ("lease",)
    LEASE_FIELD_NUMBER: _ClassVar[int]
    lease: Lease
    def __init__(self, lease: _Optional[_Union[Lease, _Mapping]] = ...) -> None: ...
