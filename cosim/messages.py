"""Messages of MAVLink's ardupilotmega dialect as kernels over payloads. Generated: do not edit.

`python -m cosim.build.messages` writes this file from pymavlink's definitions, by message id. For a message X:

- `X` is its id, `X_LENGTH` its full length in bytes, `X_<FIELD>` the offset of a field in the payload;
- `encode_x(payload, ...)` fills the payload from all scalar fields in declared order, extensions last, sets
  its arrays to zero and returns X_LENGTH; then `cosim.packets.pack` makes a packet of it;
- `decode_x(payload)`, after `cosim.packets.unpack`, returns all scalar fields in that order (a lone one as is);
- `put_x_<field>(payload, i, value)` and `get_x_<field>(payload, i)` access element i, from 0, of an array
  field; for text see also `cosim.packets.put_text` and `equal_text`.

A payload is a uint8[255] array. Units are MAVLink's, in brackets after the type of each field, not SI. Integers
are cut to the field's width; uint64 is carried in an int64. The entries of enumerations follow at the end.
Offsets are added to a `zero` that is not a literal, because numba recompiles a kernel for every literal.
Packets, CRC and the rest of the dialect: `cosim.packets`.
"""

from __future__ import annotations

import numpy as np

from cosim.kernel import kernel
from cosim.packets import (
    Bytes,
    clear,
    get_f32,
    get_i8,
    get_i16,
    get_i32,
    get_i64,
    get_u8,
    get_u16,
    get_u32,
    get_u64,
    put_f32,
    put_i8,
    put_i16,
    put_i32,
    put_i64,
    put_u8,
    put_u16,
    put_u32,
    put_u64,
)

# -- HEARTBEAT --------------------------------------------------------------------------------------------------------

HEARTBEAT = 0
HEARTBEAT_LENGTH = 9
HEARTBEAT_TYPE = 4  # uint8_t
HEARTBEAT_AUTOPILOT = 5  # uint8_t
HEARTBEAT_BASE_MODE = 6  # uint8_t
HEARTBEAT_CUSTOM_MODE = 0  # uint32_t
HEARTBEAT_SYSTEM_STATUS = 7  # uint8_t
HEARTBEAT_MAVLINK_VERSION = 8  # uint8_t


@kernel
def encode_heartbeat(
    payload: Bytes,
    type_: int,
    autopilot: int,
    base_mode: int,
    custom_mode: int,
    system_status: int,
    mavlink_version: int,
) -> int:
    """Fills `payload` with a HEARTBEAT; returns HEARTBEAT_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + HEARTBEAT_TYPE, type_)
    put_u8(payload, zero + HEARTBEAT_AUTOPILOT, autopilot)
    put_u8(payload, zero + HEARTBEAT_BASE_MODE, base_mode)
    put_u32(payload, zero + HEARTBEAT_CUSTOM_MODE, custom_mode)
    put_u8(payload, zero + HEARTBEAT_SYSTEM_STATUS, system_status)
    put_u8(payload, zero + HEARTBEAT_MAVLINK_VERSION, mavlink_version)
    return HEARTBEAT_LENGTH


@kernel
def decode_heartbeat(payload: Bytes) -> tuple[int, int, int, int, int, int]:
    """Returns the scalar fields of a HEARTBEAT.

    type, autopilot, base_mode, custom_mode, system_status, mavlink_version.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + HEARTBEAT_TYPE),
        get_u8(payload, zero + HEARTBEAT_AUTOPILOT),
        get_u8(payload, zero + HEARTBEAT_BASE_MODE),
        get_u32(payload, zero + HEARTBEAT_CUSTOM_MODE),
        get_u8(payload, zero + HEARTBEAT_SYSTEM_STATUS),
        get_u8(payload, zero + HEARTBEAT_MAVLINK_VERSION),
    )


# -- SYS_STATUS -------------------------------------------------------------------------------------------------------

SYS_STATUS = 1
SYS_STATUS_LENGTH = 43
SYS_STATUS_ONBOARD_CONTROL_SENSORS_PRESENT = 0  # uint32_t
SYS_STATUS_ONBOARD_CONTROL_SENSORS_ENABLED = 4  # uint32_t
SYS_STATUS_ONBOARD_CONTROL_SENSORS_HEALTH = 8  # uint32_t
SYS_STATUS_LOAD = 12  # uint16_t [d%]
SYS_STATUS_VOLTAGE_BATTERY = 14  # uint16_t [mV]
SYS_STATUS_CURRENT_BATTERY = 16  # int16_t [cA]
SYS_STATUS_BATTERY_REMAINING = 30  # int8_t [%]
SYS_STATUS_DROP_RATE_COMM = 18  # uint16_t [c%]
SYS_STATUS_ERRORS_COMM = 20  # uint16_t
SYS_STATUS_ERRORS_COUNT1 = 22  # uint16_t
SYS_STATUS_ERRORS_COUNT2 = 24  # uint16_t
SYS_STATUS_ERRORS_COUNT3 = 26  # uint16_t
SYS_STATUS_ERRORS_COUNT4 = 28  # uint16_t
SYS_STATUS_ONBOARD_CONTROL_SENSORS_PRESENT_EXTENDED = 31  # uint32_t, extension
SYS_STATUS_ONBOARD_CONTROL_SENSORS_ENABLED_EXTENDED = 35  # uint32_t, extension
SYS_STATUS_ONBOARD_CONTROL_SENSORS_HEALTH_EXTENDED = 39  # uint32_t, extension


@kernel
def encode_sys_status(
    payload: Bytes,
    onboard_control_sensors_present: int,
    onboard_control_sensors_enabled: int,
    onboard_control_sensors_health: int,
    load: int,
    voltage_battery: int,
    current_battery: int,
    battery_remaining: int,
    drop_rate_comm: int,
    errors_comm: int,
    errors_count1: int,
    errors_count2: int,
    errors_count3: int,
    errors_count4: int,
    onboard_control_sensors_present_extended: int,
    onboard_control_sensors_enabled_extended: int,
    onboard_control_sensors_health_extended: int,
) -> int:
    """Fills `payload` with a SYS_STATUS; returns SYS_STATUS_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_PRESENT, onboard_control_sensors_present)
    put_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_ENABLED, onboard_control_sensors_enabled)
    put_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_HEALTH, onboard_control_sensors_health)
    put_u16(payload, zero + SYS_STATUS_LOAD, load)
    put_u16(payload, zero + SYS_STATUS_VOLTAGE_BATTERY, voltage_battery)
    put_i16(payload, zero + SYS_STATUS_CURRENT_BATTERY, current_battery)
    put_i8(payload, zero + SYS_STATUS_BATTERY_REMAINING, battery_remaining)
    put_u16(payload, zero + SYS_STATUS_DROP_RATE_COMM, drop_rate_comm)
    put_u16(payload, zero + SYS_STATUS_ERRORS_COMM, errors_comm)
    put_u16(payload, zero + SYS_STATUS_ERRORS_COUNT1, errors_count1)
    put_u16(payload, zero + SYS_STATUS_ERRORS_COUNT2, errors_count2)
    put_u16(payload, zero + SYS_STATUS_ERRORS_COUNT3, errors_count3)
    put_u16(payload, zero + SYS_STATUS_ERRORS_COUNT4, errors_count4)
    put_u32(
        payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_PRESENT_EXTENDED, onboard_control_sensors_present_extended
    )
    put_u32(
        payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_ENABLED_EXTENDED, onboard_control_sensors_enabled_extended
    )
    put_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_HEALTH_EXTENDED, onboard_control_sensors_health_extended)
    return SYS_STATUS_LENGTH


@kernel
def decode_sys_status(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a SYS_STATUS.

    onboard_control_sensors_present, onboard_control_sensors_enabled, onboard_control_sensors_health, load,
    voltage_battery, current_battery, battery_remaining, drop_rate_comm, errors_comm, errors_count1, errors_count2,
    errors_count3, errors_count4, onboard_control_sensors_present_extended, onboard_control_sensors_enabled_extended,
    onboard_control_sensors_health_extended.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_PRESENT),
        get_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_ENABLED),
        get_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_HEALTH),
        get_u16(payload, zero + SYS_STATUS_LOAD),
        get_u16(payload, zero + SYS_STATUS_VOLTAGE_BATTERY),
        get_i16(payload, zero + SYS_STATUS_CURRENT_BATTERY),
        get_i8(payload, zero + SYS_STATUS_BATTERY_REMAINING),
        get_u16(payload, zero + SYS_STATUS_DROP_RATE_COMM),
        get_u16(payload, zero + SYS_STATUS_ERRORS_COMM),
        get_u16(payload, zero + SYS_STATUS_ERRORS_COUNT1),
        get_u16(payload, zero + SYS_STATUS_ERRORS_COUNT2),
        get_u16(payload, zero + SYS_STATUS_ERRORS_COUNT3),
        get_u16(payload, zero + SYS_STATUS_ERRORS_COUNT4),
        get_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_PRESENT_EXTENDED),
        get_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_ENABLED_EXTENDED),
        get_u32(payload, zero + SYS_STATUS_ONBOARD_CONTROL_SENSORS_HEALTH_EXTENDED),
    )


# -- SYSTEM_TIME ------------------------------------------------------------------------------------------------------

SYSTEM_TIME = 2
SYSTEM_TIME_LENGTH = 12
SYSTEM_TIME_TIME_UNIX_USEC = 0  # uint64_t [us]
SYSTEM_TIME_TIME_BOOT_MS = 8  # uint32_t [ms]


@kernel
def encode_system_time(payload: Bytes, time_unix_usec: int, time_boot_ms: int) -> int:
    """Fills `payload` with a SYSTEM_TIME; returns SYSTEM_TIME_LENGTH."""
    zero = int(np.int64(0))
    put_u64(payload, zero + SYSTEM_TIME_TIME_UNIX_USEC, time_unix_usec)
    put_u32(payload, zero + SYSTEM_TIME_TIME_BOOT_MS, time_boot_ms)
    return SYSTEM_TIME_LENGTH


@kernel
def decode_system_time(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of a SYSTEM_TIME: time_unix_usec, time_boot_ms."""
    zero = int(np.int64(0))
    return (
        get_u64(payload, zero + SYSTEM_TIME_TIME_UNIX_USEC),
        get_u32(payload, zero + SYSTEM_TIME_TIME_BOOT_MS),
    )


# -- PING -------------------------------------------------------------------------------------------------------------

PING = 4
PING_LENGTH = 14
PING_TIME_USEC = 0  # uint64_t [us]
PING_SEQ = 8  # uint32_t
PING_TARGET_SYSTEM = 12  # uint8_t
PING_TARGET_COMPONENT = 13  # uint8_t


@kernel
def encode_ping(payload: Bytes, time_usec: int, seq: int, target_system: int, target_component: int) -> int:
    """Fills `payload` with a PING; returns PING_LENGTH."""
    zero = int(np.int64(0))
    put_u64(payload, zero + PING_TIME_USEC, time_usec)
    put_u32(payload, zero + PING_SEQ, seq)
    put_u8(payload, zero + PING_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + PING_TARGET_COMPONENT, target_component)
    return PING_LENGTH


@kernel
def decode_ping(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a PING: time_usec, seq, target_system, target_component."""
    zero = int(np.int64(0))
    return (
        get_u64(payload, zero + PING_TIME_USEC),
        get_u32(payload, zero + PING_SEQ),
        get_u8(payload, zero + PING_TARGET_SYSTEM),
        get_u8(payload, zero + PING_TARGET_COMPONENT),
    )


# -- SET_MODE ---------------------------------------------------------------------------------------------------------

SET_MODE = 11
SET_MODE_LENGTH = 6
SET_MODE_TARGET_SYSTEM = 4  # uint8_t
SET_MODE_BASE_MODE = 5  # uint8_t
SET_MODE_CUSTOM_MODE = 0  # uint32_t


@kernel
def encode_set_mode(payload: Bytes, target_system: int, base_mode: int, custom_mode: int) -> int:
    """Fills `payload` with a SET_MODE; returns SET_MODE_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + SET_MODE_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + SET_MODE_BASE_MODE, base_mode)
    put_u32(payload, zero + SET_MODE_CUSTOM_MODE, custom_mode)
    return SET_MODE_LENGTH


@kernel
def decode_set_mode(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a SET_MODE: target_system, base_mode, custom_mode."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + SET_MODE_TARGET_SYSTEM),
        get_u8(payload, zero + SET_MODE_BASE_MODE),
        get_u32(payload, zero + SET_MODE_CUSTOM_MODE),
    )


# -- PARAM_REQUEST_READ -----------------------------------------------------------------------------------------------

PARAM_REQUEST_READ = 20
PARAM_REQUEST_READ_LENGTH = 20
PARAM_REQUEST_READ_TARGET_SYSTEM = 2  # uint8_t
PARAM_REQUEST_READ_TARGET_COMPONENT = 3  # uint8_t
PARAM_REQUEST_READ_PARAM_ID = 4  # char[16]
PARAM_REQUEST_READ_PARAM_INDEX = 0  # int16_t


@kernel
def encode_param_request_read(payload: Bytes, target_system: int, target_component: int, param_index: int) -> int:
    """Fills `payload` with a PARAM_REQUEST_READ; returns PARAM_REQUEST_READ_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + PARAM_REQUEST_READ_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + PARAM_REQUEST_READ_TARGET_COMPONENT, target_component)
    clear(payload, zero + PARAM_REQUEST_READ_PARAM_ID, zero + PARAM_REQUEST_READ_PARAM_ID + 16)
    put_i16(payload, zero + PARAM_REQUEST_READ_PARAM_INDEX, param_index)
    return PARAM_REQUEST_READ_LENGTH


@kernel
def decode_param_request_read(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a PARAM_REQUEST_READ: target_system, target_component, param_index."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + PARAM_REQUEST_READ_TARGET_SYSTEM),
        get_u8(payload, zero + PARAM_REQUEST_READ_TARGET_COMPONENT),
        get_i16(payload, zero + PARAM_REQUEST_READ_PARAM_INDEX),
    )


@kernel
def put_param_request_read_param_id(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 15) of `param_id`."""
    put_u8(payload, PARAM_REQUEST_READ_PARAM_ID + i, value)


@kernel
def get_param_request_read_param_id(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 15) of `param_id`."""
    return get_u8(payload, PARAM_REQUEST_READ_PARAM_ID + i)


# -- PARAM_REQUEST_LIST -----------------------------------------------------------------------------------------------

PARAM_REQUEST_LIST = 21
PARAM_REQUEST_LIST_LENGTH = 2
PARAM_REQUEST_LIST_TARGET_SYSTEM = 0  # uint8_t
PARAM_REQUEST_LIST_TARGET_COMPONENT = 1  # uint8_t


@kernel
def encode_param_request_list(payload: Bytes, target_system: int, target_component: int) -> int:
    """Fills `payload` with a PARAM_REQUEST_LIST; returns PARAM_REQUEST_LIST_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + PARAM_REQUEST_LIST_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + PARAM_REQUEST_LIST_TARGET_COMPONENT, target_component)
    return PARAM_REQUEST_LIST_LENGTH


@kernel
def decode_param_request_list(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of a PARAM_REQUEST_LIST: target_system, target_component."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + PARAM_REQUEST_LIST_TARGET_SYSTEM),
        get_u8(payload, zero + PARAM_REQUEST_LIST_TARGET_COMPONENT),
    )


# -- PARAM_VALUE ------------------------------------------------------------------------------------------------------

PARAM_VALUE = 22
PARAM_VALUE_LENGTH = 25
PARAM_VALUE_PARAM_ID = 8  # char[16]
PARAM_VALUE_PARAM_VALUE = 0  # float
PARAM_VALUE_PARAM_TYPE = 24  # uint8_t
PARAM_VALUE_PARAM_COUNT = 4  # uint16_t
PARAM_VALUE_PARAM_INDEX = 6  # uint16_t


@kernel
def encode_param_value(payload: Bytes, param_value: float, param_type: int, param_count: int, param_index: int) -> int:
    """Fills `payload` with a PARAM_VALUE; returns PARAM_VALUE_LENGTH."""
    zero = int(np.int64(0))
    clear(payload, zero + PARAM_VALUE_PARAM_ID, zero + PARAM_VALUE_PARAM_ID + 16)
    put_f32(payload, zero + PARAM_VALUE_PARAM_VALUE, param_value)
    put_u8(payload, zero + PARAM_VALUE_PARAM_TYPE, param_type)
    put_u16(payload, zero + PARAM_VALUE_PARAM_COUNT, param_count)
    put_u16(payload, zero + PARAM_VALUE_PARAM_INDEX, param_index)
    return PARAM_VALUE_LENGTH


@kernel
def decode_param_value(payload: Bytes) -> tuple[float, int, int, int]:
    """Returns the scalar fields of a PARAM_VALUE: param_value, param_type, param_count, param_index."""
    zero = int(np.int64(0))
    return (
        get_f32(payload, zero + PARAM_VALUE_PARAM_VALUE),
        get_u8(payload, zero + PARAM_VALUE_PARAM_TYPE),
        get_u16(payload, zero + PARAM_VALUE_PARAM_COUNT),
        get_u16(payload, zero + PARAM_VALUE_PARAM_INDEX),
    )


@kernel
def put_param_value_param_id(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 15) of `param_id`."""
    put_u8(payload, PARAM_VALUE_PARAM_ID + i, value)


@kernel
def get_param_value_param_id(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 15) of `param_id`."""
    return get_u8(payload, PARAM_VALUE_PARAM_ID + i)


# -- PARAM_SET --------------------------------------------------------------------------------------------------------

PARAM_SET = 23
PARAM_SET_LENGTH = 23
PARAM_SET_TARGET_SYSTEM = 4  # uint8_t
PARAM_SET_TARGET_COMPONENT = 5  # uint8_t
PARAM_SET_PARAM_ID = 6  # char[16]
PARAM_SET_PARAM_VALUE = 0  # float
PARAM_SET_PARAM_TYPE = 22  # uint8_t


@kernel
def encode_param_set(
    payload: Bytes, target_system: int, target_component: int, param_value: float, param_type: int
) -> int:
    """Fills `payload` with a PARAM_SET; returns PARAM_SET_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + PARAM_SET_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + PARAM_SET_TARGET_COMPONENT, target_component)
    clear(payload, zero + PARAM_SET_PARAM_ID, zero + PARAM_SET_PARAM_ID + 16)
    put_f32(payload, zero + PARAM_SET_PARAM_VALUE, param_value)
    put_u8(payload, zero + PARAM_SET_PARAM_TYPE, param_type)
    return PARAM_SET_LENGTH


@kernel
def decode_param_set(payload: Bytes) -> tuple[int, int, float, int]:
    """Returns the scalar fields of a PARAM_SET: target_system, target_component, param_value, param_type."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + PARAM_SET_TARGET_SYSTEM),
        get_u8(payload, zero + PARAM_SET_TARGET_COMPONENT),
        get_f32(payload, zero + PARAM_SET_PARAM_VALUE),
        get_u8(payload, zero + PARAM_SET_PARAM_TYPE),
    )


@kernel
def put_param_set_param_id(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 15) of `param_id`."""
    put_u8(payload, PARAM_SET_PARAM_ID + i, value)


@kernel
def get_param_set_param_id(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 15) of `param_id`."""
    return get_u8(payload, PARAM_SET_PARAM_ID + i)


# -- GPS_RAW_INT ------------------------------------------------------------------------------------------------------

GPS_RAW_INT = 24
GPS_RAW_INT_LENGTH = 52
GPS_RAW_INT_TIME_USEC = 0  # uint64_t [us]
GPS_RAW_INT_FIX_TYPE = 28  # uint8_t
GPS_RAW_INT_LAT = 8  # int32_t [degE7]
GPS_RAW_INT_LON = 12  # int32_t [degE7]
GPS_RAW_INT_ALT = 16  # int32_t [mm]
GPS_RAW_INT_EPH = 20  # uint16_t
GPS_RAW_INT_EPV = 22  # uint16_t
GPS_RAW_INT_VEL = 24  # uint16_t [cm/s]
GPS_RAW_INT_COG = 26  # uint16_t [cdeg]
GPS_RAW_INT_SATELLITES_VISIBLE = 29  # uint8_t
GPS_RAW_INT_ALT_ELLIPSOID = 30  # int32_t [mm], extension
GPS_RAW_INT_H_ACC = 34  # uint32_t [mm], extension
GPS_RAW_INT_V_ACC = 38  # uint32_t [mm], extension
GPS_RAW_INT_VEL_ACC = 42  # uint32_t [mm/s], extension
GPS_RAW_INT_HDG_ACC = 46  # uint32_t [degE5], extension
GPS_RAW_INT_YAW = 50  # uint16_t [cdeg], extension


@kernel
def encode_gps_raw_int(
    payload: Bytes,
    time_usec: int,
    fix_type: int,
    lat: int,
    lon: int,
    alt: int,
    eph: int,
    epv: int,
    vel: int,
    cog: int,
    satellites_visible: int,
    alt_ellipsoid: int,
    h_acc: int,
    v_acc: int,
    vel_acc: int,
    hdg_acc: int,
    yaw: int,
) -> int:
    """Fills `payload` with a GPS_RAW_INT; returns GPS_RAW_INT_LENGTH."""
    zero = int(np.int64(0))
    put_u64(payload, zero + GPS_RAW_INT_TIME_USEC, time_usec)
    put_u8(payload, zero + GPS_RAW_INT_FIX_TYPE, fix_type)
    put_i32(payload, zero + GPS_RAW_INT_LAT, lat)
    put_i32(payload, zero + GPS_RAW_INT_LON, lon)
    put_i32(payload, zero + GPS_RAW_INT_ALT, alt)
    put_u16(payload, zero + GPS_RAW_INT_EPH, eph)
    put_u16(payload, zero + GPS_RAW_INT_EPV, epv)
    put_u16(payload, zero + GPS_RAW_INT_VEL, vel)
    put_u16(payload, zero + GPS_RAW_INT_COG, cog)
    put_u8(payload, zero + GPS_RAW_INT_SATELLITES_VISIBLE, satellites_visible)
    put_i32(payload, zero + GPS_RAW_INT_ALT_ELLIPSOID, alt_ellipsoid)
    put_u32(payload, zero + GPS_RAW_INT_H_ACC, h_acc)
    put_u32(payload, zero + GPS_RAW_INT_V_ACC, v_acc)
    put_u32(payload, zero + GPS_RAW_INT_VEL_ACC, vel_acc)
    put_u32(payload, zero + GPS_RAW_INT_HDG_ACC, hdg_acc)
    put_u16(payload, zero + GPS_RAW_INT_YAW, yaw)
    return GPS_RAW_INT_LENGTH


@kernel
def decode_gps_raw_int(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a GPS_RAW_INT.

    time_usec, fix_type, lat, lon, alt, eph, epv, vel, cog, satellites_visible, alt_ellipsoid, h_acc, v_acc, vel_acc,
    hdg_acc, yaw.
    """
    zero = int(np.int64(0))
    return (
        get_u64(payload, zero + GPS_RAW_INT_TIME_USEC),
        get_u8(payload, zero + GPS_RAW_INT_FIX_TYPE),
        get_i32(payload, zero + GPS_RAW_INT_LAT),
        get_i32(payload, zero + GPS_RAW_INT_LON),
        get_i32(payload, zero + GPS_RAW_INT_ALT),
        get_u16(payload, zero + GPS_RAW_INT_EPH),
        get_u16(payload, zero + GPS_RAW_INT_EPV),
        get_u16(payload, zero + GPS_RAW_INT_VEL),
        get_u16(payload, zero + GPS_RAW_INT_COG),
        get_u8(payload, zero + GPS_RAW_INT_SATELLITES_VISIBLE),
        get_i32(payload, zero + GPS_RAW_INT_ALT_ELLIPSOID),
        get_u32(payload, zero + GPS_RAW_INT_H_ACC),
        get_u32(payload, zero + GPS_RAW_INT_V_ACC),
        get_u32(payload, zero + GPS_RAW_INT_VEL_ACC),
        get_u32(payload, zero + GPS_RAW_INT_HDG_ACC),
        get_u16(payload, zero + GPS_RAW_INT_YAW),
    )


# -- SCALED_IMU -------------------------------------------------------------------------------------------------------

SCALED_IMU = 26
SCALED_IMU_LENGTH = 24
SCALED_IMU_TIME_BOOT_MS = 0  # uint32_t [ms]
SCALED_IMU_XACC = 4  # int16_t [mG]
SCALED_IMU_YACC = 6  # int16_t [mG]
SCALED_IMU_ZACC = 8  # int16_t [mG]
SCALED_IMU_XGYRO = 10  # int16_t [mrad/s]
SCALED_IMU_YGYRO = 12  # int16_t [mrad/s]
SCALED_IMU_ZGYRO = 14  # int16_t [mrad/s]
SCALED_IMU_XMAG = 16  # int16_t [mgauss]
SCALED_IMU_YMAG = 18  # int16_t [mgauss]
SCALED_IMU_ZMAG = 20  # int16_t [mgauss]
SCALED_IMU_TEMPERATURE = 22  # int16_t [cdegC], extension


@kernel
def encode_scaled_imu(
    payload: Bytes,
    time_boot_ms: int,
    xacc: int,
    yacc: int,
    zacc: int,
    xgyro: int,
    ygyro: int,
    zgyro: int,
    xmag: int,
    ymag: int,
    zmag: int,
    temperature: int,
) -> int:
    """Fills `payload` with a SCALED_IMU; returns SCALED_IMU_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SCALED_IMU_TIME_BOOT_MS, time_boot_ms)
    put_i16(payload, zero + SCALED_IMU_XACC, xacc)
    put_i16(payload, zero + SCALED_IMU_YACC, yacc)
    put_i16(payload, zero + SCALED_IMU_ZACC, zacc)
    put_i16(payload, zero + SCALED_IMU_XGYRO, xgyro)
    put_i16(payload, zero + SCALED_IMU_YGYRO, ygyro)
    put_i16(payload, zero + SCALED_IMU_ZGYRO, zgyro)
    put_i16(payload, zero + SCALED_IMU_XMAG, xmag)
    put_i16(payload, zero + SCALED_IMU_YMAG, ymag)
    put_i16(payload, zero + SCALED_IMU_ZMAG, zmag)
    put_i16(payload, zero + SCALED_IMU_TEMPERATURE, temperature)
    return SCALED_IMU_LENGTH


@kernel
def decode_scaled_imu(payload: Bytes) -> tuple[int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a SCALED_IMU.

    time_boot_ms, xacc, yacc, zacc, xgyro, ygyro, zgyro, xmag, ymag, zmag, temperature.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SCALED_IMU_TIME_BOOT_MS),
        get_i16(payload, zero + SCALED_IMU_XACC),
        get_i16(payload, zero + SCALED_IMU_YACC),
        get_i16(payload, zero + SCALED_IMU_ZACC),
        get_i16(payload, zero + SCALED_IMU_XGYRO),
        get_i16(payload, zero + SCALED_IMU_YGYRO),
        get_i16(payload, zero + SCALED_IMU_ZGYRO),
        get_i16(payload, zero + SCALED_IMU_XMAG),
        get_i16(payload, zero + SCALED_IMU_YMAG),
        get_i16(payload, zero + SCALED_IMU_ZMAG),
        get_i16(payload, zero + SCALED_IMU_TEMPERATURE),
    )


# -- RAW_IMU ----------------------------------------------------------------------------------------------------------

RAW_IMU = 27
RAW_IMU_LENGTH = 29
RAW_IMU_TIME_USEC = 0  # uint64_t [us]
RAW_IMU_XACC = 8  # int16_t [mG]
RAW_IMU_YACC = 10  # int16_t [mG]
RAW_IMU_ZACC = 12  # int16_t [mG]
RAW_IMU_XGYRO = 14  # int16_t [mrad/s]
RAW_IMU_YGYRO = 16  # int16_t [mrad/s]
RAW_IMU_ZGYRO = 18  # int16_t [mrad/s]
RAW_IMU_XMAG = 20  # int16_t [mgauss]
RAW_IMU_YMAG = 22  # int16_t [mgauss]
RAW_IMU_ZMAG = 24  # int16_t [mgauss]
RAW_IMU_ID = 26  # uint8_t, extension
RAW_IMU_TEMPERATURE = 27  # int16_t [cdegC], extension


@kernel
def encode_raw_imu(
    payload: Bytes,
    time_usec: int,
    xacc: int,
    yacc: int,
    zacc: int,
    xgyro: int,
    ygyro: int,
    zgyro: int,
    xmag: int,
    ymag: int,
    zmag: int,
    id_: int,
    temperature: int,
) -> int:
    """Fills `payload` with a RAW_IMU; returns RAW_IMU_LENGTH."""
    zero = int(np.int64(0))
    put_u64(payload, zero + RAW_IMU_TIME_USEC, time_usec)
    put_i16(payload, zero + RAW_IMU_XACC, xacc)
    put_i16(payload, zero + RAW_IMU_YACC, yacc)
    put_i16(payload, zero + RAW_IMU_ZACC, zacc)
    put_i16(payload, zero + RAW_IMU_XGYRO, xgyro)
    put_i16(payload, zero + RAW_IMU_YGYRO, ygyro)
    put_i16(payload, zero + RAW_IMU_ZGYRO, zgyro)
    put_i16(payload, zero + RAW_IMU_XMAG, xmag)
    put_i16(payload, zero + RAW_IMU_YMAG, ymag)
    put_i16(payload, zero + RAW_IMU_ZMAG, zmag)
    put_u8(payload, zero + RAW_IMU_ID, id_)
    put_i16(payload, zero + RAW_IMU_TEMPERATURE, temperature)
    return RAW_IMU_LENGTH


@kernel
def decode_raw_imu(payload: Bytes) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a RAW_IMU.

    time_usec, xacc, yacc, zacc, xgyro, ygyro, zgyro, xmag, ymag, zmag, id, temperature.
    """
    zero = int(np.int64(0))
    return (
        get_u64(payload, zero + RAW_IMU_TIME_USEC),
        get_i16(payload, zero + RAW_IMU_XACC),
        get_i16(payload, zero + RAW_IMU_YACC),
        get_i16(payload, zero + RAW_IMU_ZACC),
        get_i16(payload, zero + RAW_IMU_XGYRO),
        get_i16(payload, zero + RAW_IMU_YGYRO),
        get_i16(payload, zero + RAW_IMU_ZGYRO),
        get_i16(payload, zero + RAW_IMU_XMAG),
        get_i16(payload, zero + RAW_IMU_YMAG),
        get_i16(payload, zero + RAW_IMU_ZMAG),
        get_u8(payload, zero + RAW_IMU_ID),
        get_i16(payload, zero + RAW_IMU_TEMPERATURE),
    )


# -- SCALED_PRESSURE --------------------------------------------------------------------------------------------------

SCALED_PRESSURE = 29
SCALED_PRESSURE_LENGTH = 16
SCALED_PRESSURE_TIME_BOOT_MS = 0  # uint32_t [ms]
SCALED_PRESSURE_PRESS_ABS = 4  # float [hPa]
SCALED_PRESSURE_PRESS_DIFF = 8  # float [hPa]
SCALED_PRESSURE_TEMPERATURE = 12  # int16_t [cdegC]
SCALED_PRESSURE_TEMPERATURE_PRESS_DIFF = 14  # int16_t [cdegC], extension


@kernel
def encode_scaled_pressure(
    payload: Bytes,
    time_boot_ms: int,
    press_abs: float,
    press_diff: float,
    temperature: int,
    temperature_press_diff: int,
) -> int:
    """Fills `payload` with a SCALED_PRESSURE; returns SCALED_PRESSURE_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SCALED_PRESSURE_TIME_BOOT_MS, time_boot_ms)
    put_f32(payload, zero + SCALED_PRESSURE_PRESS_ABS, press_abs)
    put_f32(payload, zero + SCALED_PRESSURE_PRESS_DIFF, press_diff)
    put_i16(payload, zero + SCALED_PRESSURE_TEMPERATURE, temperature)
    put_i16(payload, zero + SCALED_PRESSURE_TEMPERATURE_PRESS_DIFF, temperature_press_diff)
    return SCALED_PRESSURE_LENGTH


@kernel
def decode_scaled_pressure(payload: Bytes) -> tuple[int, float, float, int, int]:
    """Returns the scalar fields of a SCALED_PRESSURE.

    time_boot_ms, press_abs, press_diff, temperature, temperature_press_diff.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SCALED_PRESSURE_TIME_BOOT_MS),
        get_f32(payload, zero + SCALED_PRESSURE_PRESS_ABS),
        get_f32(payload, zero + SCALED_PRESSURE_PRESS_DIFF),
        get_i16(payload, zero + SCALED_PRESSURE_TEMPERATURE),
        get_i16(payload, zero + SCALED_PRESSURE_TEMPERATURE_PRESS_DIFF),
    )


# -- ATTITUDE ---------------------------------------------------------------------------------------------------------

ATTITUDE = 30
ATTITUDE_LENGTH = 28
ATTITUDE_TIME_BOOT_MS = 0  # uint32_t [ms]
ATTITUDE_ROLL = 4  # float [rad]
ATTITUDE_PITCH = 8  # float [rad]
ATTITUDE_YAW = 12  # float [rad]
ATTITUDE_ROLLSPEED = 16  # float [rad/s]
ATTITUDE_PITCHSPEED = 20  # float [rad/s]
ATTITUDE_YAWSPEED = 24  # float [rad/s]


@kernel
def encode_attitude(
    payload: Bytes,
    time_boot_ms: int,
    roll: float,
    pitch: float,
    yaw: float,
    rollspeed: float,
    pitchspeed: float,
    yawspeed: float,
) -> int:
    """Fills `payload` with an ATTITUDE; returns ATTITUDE_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + ATTITUDE_TIME_BOOT_MS, time_boot_ms)
    put_f32(payload, zero + ATTITUDE_ROLL, roll)
    put_f32(payload, zero + ATTITUDE_PITCH, pitch)
    put_f32(payload, zero + ATTITUDE_YAW, yaw)
    put_f32(payload, zero + ATTITUDE_ROLLSPEED, rollspeed)
    put_f32(payload, zero + ATTITUDE_PITCHSPEED, pitchspeed)
    put_f32(payload, zero + ATTITUDE_YAWSPEED, yawspeed)
    return ATTITUDE_LENGTH


@kernel
def decode_attitude(payload: Bytes) -> tuple[int, float, float, float, float, float, float]:
    """Returns the scalar fields of an ATTITUDE: time_boot_ms, roll, pitch, yaw, rollspeed, pitchspeed, yawspeed."""
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + ATTITUDE_TIME_BOOT_MS),
        get_f32(payload, zero + ATTITUDE_ROLL),
        get_f32(payload, zero + ATTITUDE_PITCH),
        get_f32(payload, zero + ATTITUDE_YAW),
        get_f32(payload, zero + ATTITUDE_ROLLSPEED),
        get_f32(payload, zero + ATTITUDE_PITCHSPEED),
        get_f32(payload, zero + ATTITUDE_YAWSPEED),
    )


# -- ATTITUDE_QUATERNION ----------------------------------------------------------------------------------------------

ATTITUDE_QUATERNION = 31
ATTITUDE_QUATERNION_LENGTH = 48
ATTITUDE_QUATERNION_TIME_BOOT_MS = 0  # uint32_t [ms]
ATTITUDE_QUATERNION_Q1 = 4  # float
ATTITUDE_QUATERNION_Q2 = 8  # float
ATTITUDE_QUATERNION_Q3 = 12  # float
ATTITUDE_QUATERNION_Q4 = 16  # float
ATTITUDE_QUATERNION_ROLLSPEED = 20  # float [rad/s]
ATTITUDE_QUATERNION_PITCHSPEED = 24  # float [rad/s]
ATTITUDE_QUATERNION_YAWSPEED = 28  # float [rad/s]
ATTITUDE_QUATERNION_REPR_OFFSET_Q = 32  # float[4], extension


@kernel
def encode_attitude_quaternion(
    payload: Bytes,
    time_boot_ms: int,
    q1: float,
    q2: float,
    q3: float,
    q4: float,
    rollspeed: float,
    pitchspeed: float,
    yawspeed: float,
) -> int:
    """Fills `payload` with an ATTITUDE_QUATERNION; returns ATTITUDE_QUATERNION_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + ATTITUDE_QUATERNION_TIME_BOOT_MS, time_boot_ms)
    put_f32(payload, zero + ATTITUDE_QUATERNION_Q1, q1)
    put_f32(payload, zero + ATTITUDE_QUATERNION_Q2, q2)
    put_f32(payload, zero + ATTITUDE_QUATERNION_Q3, q3)
    put_f32(payload, zero + ATTITUDE_QUATERNION_Q4, q4)
    put_f32(payload, zero + ATTITUDE_QUATERNION_ROLLSPEED, rollspeed)
    put_f32(payload, zero + ATTITUDE_QUATERNION_PITCHSPEED, pitchspeed)
    put_f32(payload, zero + ATTITUDE_QUATERNION_YAWSPEED, yawspeed)
    clear(payload, zero + ATTITUDE_QUATERNION_REPR_OFFSET_Q, zero + ATTITUDE_QUATERNION_REPR_OFFSET_Q + 16)
    return ATTITUDE_QUATERNION_LENGTH


@kernel
def decode_attitude_quaternion(payload: Bytes) -> tuple[int, float, float, float, float, float, float, float]:
    """Returns the scalar fields of an ATTITUDE_QUATERNION.

    time_boot_ms, q1, q2, q3, q4, rollspeed, pitchspeed, yawspeed.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + ATTITUDE_QUATERNION_TIME_BOOT_MS),
        get_f32(payload, zero + ATTITUDE_QUATERNION_Q1),
        get_f32(payload, zero + ATTITUDE_QUATERNION_Q2),
        get_f32(payload, zero + ATTITUDE_QUATERNION_Q3),
        get_f32(payload, zero + ATTITUDE_QUATERNION_Q4),
        get_f32(payload, zero + ATTITUDE_QUATERNION_ROLLSPEED),
        get_f32(payload, zero + ATTITUDE_QUATERNION_PITCHSPEED),
        get_f32(payload, zero + ATTITUDE_QUATERNION_YAWSPEED),
    )


@kernel
def put_attitude_quaternion_repr_offset_q(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 3) of `repr_offset_q`."""
    put_f32(payload, ATTITUDE_QUATERNION_REPR_OFFSET_Q + 4 * i, value)


@kernel
def get_attitude_quaternion_repr_offset_q(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 3) of `repr_offset_q`."""
    return get_f32(payload, ATTITUDE_QUATERNION_REPR_OFFSET_Q + 4 * i)


# -- LOCAL_POSITION_NED -----------------------------------------------------------------------------------------------

LOCAL_POSITION_NED = 32
LOCAL_POSITION_NED_LENGTH = 28
LOCAL_POSITION_NED_TIME_BOOT_MS = 0  # uint32_t [ms]
LOCAL_POSITION_NED_X = 4  # float [m]
LOCAL_POSITION_NED_Y = 8  # float [m]
LOCAL_POSITION_NED_Z = 12  # float [m]
LOCAL_POSITION_NED_VX = 16  # float [m/s]
LOCAL_POSITION_NED_VY = 20  # float [m/s]
LOCAL_POSITION_NED_VZ = 24  # float [m/s]


@kernel
def encode_local_position_ned(
    payload: Bytes, time_boot_ms: int, x: float, y: float, z: float, vx: float, vy: float, vz: float
) -> int:
    """Fills `payload` with a LOCAL_POSITION_NED; returns LOCAL_POSITION_NED_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + LOCAL_POSITION_NED_TIME_BOOT_MS, time_boot_ms)
    put_f32(payload, zero + LOCAL_POSITION_NED_X, x)
    put_f32(payload, zero + LOCAL_POSITION_NED_Y, y)
    put_f32(payload, zero + LOCAL_POSITION_NED_Z, z)
    put_f32(payload, zero + LOCAL_POSITION_NED_VX, vx)
    put_f32(payload, zero + LOCAL_POSITION_NED_VY, vy)
    put_f32(payload, zero + LOCAL_POSITION_NED_VZ, vz)
    return LOCAL_POSITION_NED_LENGTH


@kernel
def decode_local_position_ned(payload: Bytes) -> tuple[int, float, float, float, float, float, float]:
    """Returns the scalar fields of a LOCAL_POSITION_NED: time_boot_ms, x, y, z, vx, vy, vz."""
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + LOCAL_POSITION_NED_TIME_BOOT_MS),
        get_f32(payload, zero + LOCAL_POSITION_NED_X),
        get_f32(payload, zero + LOCAL_POSITION_NED_Y),
        get_f32(payload, zero + LOCAL_POSITION_NED_Z),
        get_f32(payload, zero + LOCAL_POSITION_NED_VX),
        get_f32(payload, zero + LOCAL_POSITION_NED_VY),
        get_f32(payload, zero + LOCAL_POSITION_NED_VZ),
    )


# -- GLOBAL_POSITION_INT ----------------------------------------------------------------------------------------------

GLOBAL_POSITION_INT = 33
GLOBAL_POSITION_INT_LENGTH = 28
GLOBAL_POSITION_INT_TIME_BOOT_MS = 0  # uint32_t [ms]
GLOBAL_POSITION_INT_LAT = 4  # int32_t [degE7]
GLOBAL_POSITION_INT_LON = 8  # int32_t [degE7]
GLOBAL_POSITION_INT_ALT = 12  # int32_t [mm]
GLOBAL_POSITION_INT_RELATIVE_ALT = 16  # int32_t [mm]
GLOBAL_POSITION_INT_VX = 20  # int16_t [cm/s]
GLOBAL_POSITION_INT_VY = 22  # int16_t [cm/s]
GLOBAL_POSITION_INT_VZ = 24  # int16_t [cm/s]
GLOBAL_POSITION_INT_HDG = 26  # uint16_t [cdeg]


@kernel
def encode_global_position_int(
    payload: Bytes,
    time_boot_ms: int,
    lat: int,
    lon: int,
    alt: int,
    relative_alt: int,
    vx: int,
    vy: int,
    vz: int,
    hdg: int,
) -> int:
    """Fills `payload` with a GLOBAL_POSITION_INT; returns GLOBAL_POSITION_INT_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + GLOBAL_POSITION_INT_TIME_BOOT_MS, time_boot_ms)
    put_i32(payload, zero + GLOBAL_POSITION_INT_LAT, lat)
    put_i32(payload, zero + GLOBAL_POSITION_INT_LON, lon)
    put_i32(payload, zero + GLOBAL_POSITION_INT_ALT, alt)
    put_i32(payload, zero + GLOBAL_POSITION_INT_RELATIVE_ALT, relative_alt)
    put_i16(payload, zero + GLOBAL_POSITION_INT_VX, vx)
    put_i16(payload, zero + GLOBAL_POSITION_INT_VY, vy)
    put_i16(payload, zero + GLOBAL_POSITION_INT_VZ, vz)
    put_u16(payload, zero + GLOBAL_POSITION_INT_HDG, hdg)
    return GLOBAL_POSITION_INT_LENGTH


@kernel
def decode_global_position_int(payload: Bytes) -> tuple[int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a GLOBAL_POSITION_INT.

    time_boot_ms, lat, lon, alt, relative_alt, vx, vy, vz, hdg.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + GLOBAL_POSITION_INT_TIME_BOOT_MS),
        get_i32(payload, zero + GLOBAL_POSITION_INT_LAT),
        get_i32(payload, zero + GLOBAL_POSITION_INT_LON),
        get_i32(payload, zero + GLOBAL_POSITION_INT_ALT),
        get_i32(payload, zero + GLOBAL_POSITION_INT_RELATIVE_ALT),
        get_i16(payload, zero + GLOBAL_POSITION_INT_VX),
        get_i16(payload, zero + GLOBAL_POSITION_INT_VY),
        get_i16(payload, zero + GLOBAL_POSITION_INT_VZ),
        get_u16(payload, zero + GLOBAL_POSITION_INT_HDG),
    )


# -- SERVO_OUTPUT_RAW -------------------------------------------------------------------------------------------------

SERVO_OUTPUT_RAW = 36
SERVO_OUTPUT_RAW_LENGTH = 37
SERVO_OUTPUT_RAW_TIME_USEC = 0  # uint32_t [us]
SERVO_OUTPUT_RAW_PORT = 20  # uint8_t
SERVO_OUTPUT_RAW_SERVO1_RAW = 4  # uint16_t [us]
SERVO_OUTPUT_RAW_SERVO2_RAW = 6  # uint16_t [us]
SERVO_OUTPUT_RAW_SERVO3_RAW = 8  # uint16_t [us]
SERVO_OUTPUT_RAW_SERVO4_RAW = 10  # uint16_t [us]
SERVO_OUTPUT_RAW_SERVO5_RAW = 12  # uint16_t [us]
SERVO_OUTPUT_RAW_SERVO6_RAW = 14  # uint16_t [us]
SERVO_OUTPUT_RAW_SERVO7_RAW = 16  # uint16_t [us]
SERVO_OUTPUT_RAW_SERVO8_RAW = 18  # uint16_t [us]
SERVO_OUTPUT_RAW_SERVO9_RAW = 21  # uint16_t [us], extension
SERVO_OUTPUT_RAW_SERVO10_RAW = 23  # uint16_t [us], extension
SERVO_OUTPUT_RAW_SERVO11_RAW = 25  # uint16_t [us], extension
SERVO_OUTPUT_RAW_SERVO12_RAW = 27  # uint16_t [us], extension
SERVO_OUTPUT_RAW_SERVO13_RAW = 29  # uint16_t [us], extension
SERVO_OUTPUT_RAW_SERVO14_RAW = 31  # uint16_t [us], extension
SERVO_OUTPUT_RAW_SERVO15_RAW = 33  # uint16_t [us], extension
SERVO_OUTPUT_RAW_SERVO16_RAW = 35  # uint16_t [us], extension


@kernel
def encode_servo_output_raw(
    payload: Bytes,
    time_usec: int,
    port: int,
    servo1_raw: int,
    servo2_raw: int,
    servo3_raw: int,
    servo4_raw: int,
    servo5_raw: int,
    servo6_raw: int,
    servo7_raw: int,
    servo8_raw: int,
    servo9_raw: int,
    servo10_raw: int,
    servo11_raw: int,
    servo12_raw: int,
    servo13_raw: int,
    servo14_raw: int,
    servo15_raw: int,
    servo16_raw: int,
) -> int:
    """Fills `payload` with a SERVO_OUTPUT_RAW; returns SERVO_OUTPUT_RAW_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SERVO_OUTPUT_RAW_TIME_USEC, time_usec)
    put_u8(payload, zero + SERVO_OUTPUT_RAW_PORT, port)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO1_RAW, servo1_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO2_RAW, servo2_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO3_RAW, servo3_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO4_RAW, servo4_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO5_RAW, servo5_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO6_RAW, servo6_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO7_RAW, servo7_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO8_RAW, servo8_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO9_RAW, servo9_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO10_RAW, servo10_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO11_RAW, servo11_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO12_RAW, servo12_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO13_RAW, servo13_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO14_RAW, servo14_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO15_RAW, servo15_raw)
    put_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO16_RAW, servo16_raw)
    return SERVO_OUTPUT_RAW_LENGTH


@kernel
def decode_servo_output_raw(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a SERVO_OUTPUT_RAW.

    time_usec, port, servo1_raw, servo2_raw, servo3_raw, servo4_raw, servo5_raw, servo6_raw, servo7_raw, servo8_raw,
    servo9_raw, servo10_raw, servo11_raw, servo12_raw, servo13_raw, servo14_raw, servo15_raw, servo16_raw.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SERVO_OUTPUT_RAW_TIME_USEC),
        get_u8(payload, zero + SERVO_OUTPUT_RAW_PORT),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO1_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO2_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO3_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO4_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO5_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO6_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO7_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO8_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO9_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO10_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO11_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO12_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO13_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO14_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO15_RAW),
        get_u16(payload, zero + SERVO_OUTPUT_RAW_SERVO16_RAW),
    )


# -- MISSION_REQUEST_PARTIAL_LIST -------------------------------------------------------------------------------------

MISSION_REQUEST_PARTIAL_LIST = 37
MISSION_REQUEST_PARTIAL_LIST_LENGTH = 7
MISSION_REQUEST_PARTIAL_LIST_TARGET_SYSTEM = 4  # uint8_t
MISSION_REQUEST_PARTIAL_LIST_TARGET_COMPONENT = 5  # uint8_t
MISSION_REQUEST_PARTIAL_LIST_START_INDEX = 0  # int16_t
MISSION_REQUEST_PARTIAL_LIST_END_INDEX = 2  # int16_t
MISSION_REQUEST_PARTIAL_LIST_MISSION_TYPE = 6  # uint8_t, extension


@kernel
def encode_mission_request_partial_list(
    payload: Bytes, target_system: int, target_component: int, start_index: int, end_index: int, mission_type: int
) -> int:
    """Fills `payload` with a MISSION_REQUEST_PARTIAL_LIST; returns MISSION_REQUEST_PARTIAL_LIST_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_REQUEST_PARTIAL_LIST_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_REQUEST_PARTIAL_LIST_TARGET_COMPONENT, target_component)
    put_i16(payload, zero + MISSION_REQUEST_PARTIAL_LIST_START_INDEX, start_index)
    put_i16(payload, zero + MISSION_REQUEST_PARTIAL_LIST_END_INDEX, end_index)
    put_u8(payload, zero + MISSION_REQUEST_PARTIAL_LIST_MISSION_TYPE, mission_type)
    return MISSION_REQUEST_PARTIAL_LIST_LENGTH


@kernel
def decode_mission_request_partial_list(payload: Bytes) -> tuple[int, int, int, int, int]:
    """Returns the scalar fields of a MISSION_REQUEST_PARTIAL_LIST.

    target_system, target_component, start_index, end_index, mission_type.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_REQUEST_PARTIAL_LIST_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_REQUEST_PARTIAL_LIST_TARGET_COMPONENT),
        get_i16(payload, zero + MISSION_REQUEST_PARTIAL_LIST_START_INDEX),
        get_i16(payload, zero + MISSION_REQUEST_PARTIAL_LIST_END_INDEX),
        get_u8(payload, zero + MISSION_REQUEST_PARTIAL_LIST_MISSION_TYPE),
    )


# -- MISSION_WRITE_PARTIAL_LIST ---------------------------------------------------------------------------------------

MISSION_WRITE_PARTIAL_LIST = 38
MISSION_WRITE_PARTIAL_LIST_LENGTH = 7
MISSION_WRITE_PARTIAL_LIST_TARGET_SYSTEM = 4  # uint8_t
MISSION_WRITE_PARTIAL_LIST_TARGET_COMPONENT = 5  # uint8_t
MISSION_WRITE_PARTIAL_LIST_START_INDEX = 0  # int16_t
MISSION_WRITE_PARTIAL_LIST_END_INDEX = 2  # int16_t
MISSION_WRITE_PARTIAL_LIST_MISSION_TYPE = 6  # uint8_t, extension


@kernel
def encode_mission_write_partial_list(
    payload: Bytes, target_system: int, target_component: int, start_index: int, end_index: int, mission_type: int
) -> int:
    """Fills `payload` with a MISSION_WRITE_PARTIAL_LIST; returns MISSION_WRITE_PARTIAL_LIST_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_WRITE_PARTIAL_LIST_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_WRITE_PARTIAL_LIST_TARGET_COMPONENT, target_component)
    put_i16(payload, zero + MISSION_WRITE_PARTIAL_LIST_START_INDEX, start_index)
    put_i16(payload, zero + MISSION_WRITE_PARTIAL_LIST_END_INDEX, end_index)
    put_u8(payload, zero + MISSION_WRITE_PARTIAL_LIST_MISSION_TYPE, mission_type)
    return MISSION_WRITE_PARTIAL_LIST_LENGTH


@kernel
def decode_mission_write_partial_list(payload: Bytes) -> tuple[int, int, int, int, int]:
    """Returns the scalar fields of a MISSION_WRITE_PARTIAL_LIST.

    target_system, target_component, start_index, end_index, mission_type.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_WRITE_PARTIAL_LIST_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_WRITE_PARTIAL_LIST_TARGET_COMPONENT),
        get_i16(payload, zero + MISSION_WRITE_PARTIAL_LIST_START_INDEX),
        get_i16(payload, zero + MISSION_WRITE_PARTIAL_LIST_END_INDEX),
        get_u8(payload, zero + MISSION_WRITE_PARTIAL_LIST_MISSION_TYPE),
    )


# -- MISSION_ITEM -----------------------------------------------------------------------------------------------------

MISSION_ITEM = 39
MISSION_ITEM_LENGTH = 38
MISSION_ITEM_TARGET_SYSTEM = 32  # uint8_t
MISSION_ITEM_TARGET_COMPONENT = 33  # uint8_t
MISSION_ITEM_SEQ = 28  # uint16_t
MISSION_ITEM_FRAME = 34  # uint8_t
MISSION_ITEM_COMMAND = 30  # uint16_t
MISSION_ITEM_CURRENT = 35  # uint8_t
MISSION_ITEM_AUTOCONTINUE = 36  # uint8_t
MISSION_ITEM_PARAM1 = 0  # float
MISSION_ITEM_PARAM2 = 4  # float
MISSION_ITEM_PARAM3 = 8  # float
MISSION_ITEM_PARAM4 = 12  # float
MISSION_ITEM_X = 16  # float
MISSION_ITEM_Y = 20  # float
MISSION_ITEM_Z = 24  # float
MISSION_ITEM_MISSION_TYPE = 37  # uint8_t, extension


@kernel
def encode_mission_item(
    payload: Bytes,
    target_system: int,
    target_component: int,
    seq: int,
    frame: int,
    command: int,
    current: int,
    autocontinue: int,
    param1: float,
    param2: float,
    param3: float,
    param4: float,
    x: float,
    y: float,
    z: float,
    mission_type: int,
) -> int:
    """Fills `payload` with a MISSION_ITEM; returns MISSION_ITEM_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_ITEM_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_ITEM_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + MISSION_ITEM_SEQ, seq)
    put_u8(payload, zero + MISSION_ITEM_FRAME, frame)
    put_u16(payload, zero + MISSION_ITEM_COMMAND, command)
    put_u8(payload, zero + MISSION_ITEM_CURRENT, current)
    put_u8(payload, zero + MISSION_ITEM_AUTOCONTINUE, autocontinue)
    put_f32(payload, zero + MISSION_ITEM_PARAM1, param1)
    put_f32(payload, zero + MISSION_ITEM_PARAM2, param2)
    put_f32(payload, zero + MISSION_ITEM_PARAM3, param3)
    put_f32(payload, zero + MISSION_ITEM_PARAM4, param4)
    put_f32(payload, zero + MISSION_ITEM_X, x)
    put_f32(payload, zero + MISSION_ITEM_Y, y)
    put_f32(payload, zero + MISSION_ITEM_Z, z)
    put_u8(payload, zero + MISSION_ITEM_MISSION_TYPE, mission_type)
    return MISSION_ITEM_LENGTH


@kernel
def decode_mission_item(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, int, float, float, float, float, float, float, float, int]:
    """Returns the scalar fields of a MISSION_ITEM.

    target_system, target_component, seq, frame, command, current, autocontinue, param1, param2, param3, param4, x, y,
    z, mission_type.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_ITEM_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_ITEM_TARGET_COMPONENT),
        get_u16(payload, zero + MISSION_ITEM_SEQ),
        get_u8(payload, zero + MISSION_ITEM_FRAME),
        get_u16(payload, zero + MISSION_ITEM_COMMAND),
        get_u8(payload, zero + MISSION_ITEM_CURRENT),
        get_u8(payload, zero + MISSION_ITEM_AUTOCONTINUE),
        get_f32(payload, zero + MISSION_ITEM_PARAM1),
        get_f32(payload, zero + MISSION_ITEM_PARAM2),
        get_f32(payload, zero + MISSION_ITEM_PARAM3),
        get_f32(payload, zero + MISSION_ITEM_PARAM4),
        get_f32(payload, zero + MISSION_ITEM_X),
        get_f32(payload, zero + MISSION_ITEM_Y),
        get_f32(payload, zero + MISSION_ITEM_Z),
        get_u8(payload, zero + MISSION_ITEM_MISSION_TYPE),
    )


# -- MISSION_REQUEST --------------------------------------------------------------------------------------------------

MISSION_REQUEST = 40
MISSION_REQUEST_LENGTH = 5
MISSION_REQUEST_TARGET_SYSTEM = 2  # uint8_t
MISSION_REQUEST_TARGET_COMPONENT = 3  # uint8_t
MISSION_REQUEST_SEQ = 0  # uint16_t
MISSION_REQUEST_MISSION_TYPE = 4  # uint8_t, extension


@kernel
def encode_mission_request(
    payload: Bytes, target_system: int, target_component: int, seq: int, mission_type: int
) -> int:
    """Fills `payload` with a MISSION_REQUEST; returns MISSION_REQUEST_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_REQUEST_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_REQUEST_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + MISSION_REQUEST_SEQ, seq)
    put_u8(payload, zero + MISSION_REQUEST_MISSION_TYPE, mission_type)
    return MISSION_REQUEST_LENGTH


@kernel
def decode_mission_request(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a MISSION_REQUEST: target_system, target_component, seq, mission_type."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_REQUEST_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_REQUEST_TARGET_COMPONENT),
        get_u16(payload, zero + MISSION_REQUEST_SEQ),
        get_u8(payload, zero + MISSION_REQUEST_MISSION_TYPE),
    )


# -- MISSION_SET_CURRENT ----------------------------------------------------------------------------------------------

MISSION_SET_CURRENT = 41
MISSION_SET_CURRENT_LENGTH = 4
MISSION_SET_CURRENT_TARGET_SYSTEM = 2  # uint8_t
MISSION_SET_CURRENT_TARGET_COMPONENT = 3  # uint8_t
MISSION_SET_CURRENT_SEQ = 0  # uint16_t


@kernel
def encode_mission_set_current(payload: Bytes, target_system: int, target_component: int, seq: int) -> int:
    """Fills `payload` with a MISSION_SET_CURRENT; returns MISSION_SET_CURRENT_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_SET_CURRENT_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_SET_CURRENT_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + MISSION_SET_CURRENT_SEQ, seq)
    return MISSION_SET_CURRENT_LENGTH


@kernel
def decode_mission_set_current(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a MISSION_SET_CURRENT: target_system, target_component, seq."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_SET_CURRENT_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_SET_CURRENT_TARGET_COMPONENT),
        get_u16(payload, zero + MISSION_SET_CURRENT_SEQ),
    )


# -- MISSION_CURRENT --------------------------------------------------------------------------------------------------

MISSION_CURRENT = 42
MISSION_CURRENT_LENGTH = 6
MISSION_CURRENT_SEQ = 0  # uint16_t
MISSION_CURRENT_TOTAL = 2  # uint16_t, extension
MISSION_CURRENT_MISSION_STATE = 4  # uint8_t, extension
MISSION_CURRENT_MISSION_MODE = 5  # uint8_t, extension


@kernel
def encode_mission_current(payload: Bytes, seq: int, total: int, mission_state: int, mission_mode: int) -> int:
    """Fills `payload` with a MISSION_CURRENT; returns MISSION_CURRENT_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + MISSION_CURRENT_SEQ, seq)
    put_u16(payload, zero + MISSION_CURRENT_TOTAL, total)
    put_u8(payload, zero + MISSION_CURRENT_MISSION_STATE, mission_state)
    put_u8(payload, zero + MISSION_CURRENT_MISSION_MODE, mission_mode)
    return MISSION_CURRENT_LENGTH


@kernel
def decode_mission_current(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a MISSION_CURRENT: seq, total, mission_state, mission_mode."""
    zero = int(np.int64(0))
    return (
        get_u16(payload, zero + MISSION_CURRENT_SEQ),
        get_u16(payload, zero + MISSION_CURRENT_TOTAL),
        get_u8(payload, zero + MISSION_CURRENT_MISSION_STATE),
        get_u8(payload, zero + MISSION_CURRENT_MISSION_MODE),
    )


# -- MISSION_REQUEST_LIST ---------------------------------------------------------------------------------------------

MISSION_REQUEST_LIST = 43
MISSION_REQUEST_LIST_LENGTH = 3
MISSION_REQUEST_LIST_TARGET_SYSTEM = 0  # uint8_t
MISSION_REQUEST_LIST_TARGET_COMPONENT = 1  # uint8_t
MISSION_REQUEST_LIST_MISSION_TYPE = 2  # uint8_t, extension


@kernel
def encode_mission_request_list(payload: Bytes, target_system: int, target_component: int, mission_type: int) -> int:
    """Fills `payload` with a MISSION_REQUEST_LIST; returns MISSION_REQUEST_LIST_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_REQUEST_LIST_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_REQUEST_LIST_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + MISSION_REQUEST_LIST_MISSION_TYPE, mission_type)
    return MISSION_REQUEST_LIST_LENGTH


@kernel
def decode_mission_request_list(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a MISSION_REQUEST_LIST: target_system, target_component, mission_type."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_REQUEST_LIST_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_REQUEST_LIST_TARGET_COMPONENT),
        get_u8(payload, zero + MISSION_REQUEST_LIST_MISSION_TYPE),
    )


# -- MISSION_COUNT ----------------------------------------------------------------------------------------------------

MISSION_COUNT = 44
MISSION_COUNT_LENGTH = 5
MISSION_COUNT_TARGET_SYSTEM = 2  # uint8_t
MISSION_COUNT_TARGET_COMPONENT = 3  # uint8_t
MISSION_COUNT_COUNT = 0  # uint16_t
MISSION_COUNT_MISSION_TYPE = 4  # uint8_t, extension


@kernel
def encode_mission_count(
    payload: Bytes, target_system: int, target_component: int, count: int, mission_type: int
) -> int:
    """Fills `payload` with a MISSION_COUNT; returns MISSION_COUNT_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_COUNT_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_COUNT_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + MISSION_COUNT_COUNT, count)
    put_u8(payload, zero + MISSION_COUNT_MISSION_TYPE, mission_type)
    return MISSION_COUNT_LENGTH


@kernel
def decode_mission_count(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a MISSION_COUNT: target_system, target_component, count, mission_type."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_COUNT_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_COUNT_TARGET_COMPONENT),
        get_u16(payload, zero + MISSION_COUNT_COUNT),
        get_u8(payload, zero + MISSION_COUNT_MISSION_TYPE),
    )


# -- MISSION_CLEAR_ALL ------------------------------------------------------------------------------------------------

MISSION_CLEAR_ALL = 45
MISSION_CLEAR_ALL_LENGTH = 3
MISSION_CLEAR_ALL_TARGET_SYSTEM = 0  # uint8_t
MISSION_CLEAR_ALL_TARGET_COMPONENT = 1  # uint8_t
MISSION_CLEAR_ALL_MISSION_TYPE = 2  # uint8_t, extension


@kernel
def encode_mission_clear_all(payload: Bytes, target_system: int, target_component: int, mission_type: int) -> int:
    """Fills `payload` with a MISSION_CLEAR_ALL; returns MISSION_CLEAR_ALL_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_CLEAR_ALL_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_CLEAR_ALL_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + MISSION_CLEAR_ALL_MISSION_TYPE, mission_type)
    return MISSION_CLEAR_ALL_LENGTH


@kernel
def decode_mission_clear_all(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a MISSION_CLEAR_ALL: target_system, target_component, mission_type."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_CLEAR_ALL_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_CLEAR_ALL_TARGET_COMPONENT),
        get_u8(payload, zero + MISSION_CLEAR_ALL_MISSION_TYPE),
    )


# -- MISSION_ITEM_REACHED ---------------------------------------------------------------------------------------------

MISSION_ITEM_REACHED = 46
MISSION_ITEM_REACHED_LENGTH = 2
MISSION_ITEM_REACHED_SEQ = 0  # uint16_t


@kernel
def encode_mission_item_reached(payload: Bytes, seq: int) -> int:
    """Fills `payload` with a MISSION_ITEM_REACHED; returns MISSION_ITEM_REACHED_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + MISSION_ITEM_REACHED_SEQ, seq)
    return MISSION_ITEM_REACHED_LENGTH


@kernel
def decode_mission_item_reached(payload: Bytes) -> int:
    """Returns the scalar fields of a MISSION_ITEM_REACHED: seq."""
    zero = int(np.int64(0))
    return get_u16(payload, zero + MISSION_ITEM_REACHED_SEQ)


# -- MISSION_ACK ------------------------------------------------------------------------------------------------------

MISSION_ACK = 47
MISSION_ACK_LENGTH = 4
MISSION_ACK_TARGET_SYSTEM = 0  # uint8_t
MISSION_ACK_TARGET_COMPONENT = 1  # uint8_t
MISSION_ACK_TYPE = 2  # uint8_t
MISSION_ACK_MISSION_TYPE = 3  # uint8_t, extension


@kernel
def encode_mission_ack(payload: Bytes, target_system: int, target_component: int, type_: int, mission_type: int) -> int:
    """Fills `payload` with a MISSION_ACK; returns MISSION_ACK_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_ACK_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_ACK_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + MISSION_ACK_TYPE, type_)
    put_u8(payload, zero + MISSION_ACK_MISSION_TYPE, mission_type)
    return MISSION_ACK_LENGTH


@kernel
def decode_mission_ack(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a MISSION_ACK: target_system, target_component, type, mission_type."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_ACK_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_ACK_TARGET_COMPONENT),
        get_u8(payload, zero + MISSION_ACK_TYPE),
        get_u8(payload, zero + MISSION_ACK_MISSION_TYPE),
    )


# -- SET_GPS_GLOBAL_ORIGIN --------------------------------------------------------------------------------------------

SET_GPS_GLOBAL_ORIGIN = 48
SET_GPS_GLOBAL_ORIGIN_LENGTH = 21
SET_GPS_GLOBAL_ORIGIN_TARGET_SYSTEM = 12  # uint8_t
SET_GPS_GLOBAL_ORIGIN_LATITUDE = 0  # int32_t [degE7]
SET_GPS_GLOBAL_ORIGIN_LONGITUDE = 4  # int32_t [degE7]
SET_GPS_GLOBAL_ORIGIN_ALTITUDE = 8  # int32_t [mm]
SET_GPS_GLOBAL_ORIGIN_TIME_USEC = 13  # uint64_t [us], extension


@kernel
def encode_set_gps_global_origin(
    payload: Bytes, target_system: int, latitude: int, longitude: int, altitude: int, time_usec: int
) -> int:
    """Fills `payload` with a SET_GPS_GLOBAL_ORIGIN; returns SET_GPS_GLOBAL_ORIGIN_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + SET_GPS_GLOBAL_ORIGIN_TARGET_SYSTEM, target_system)
    put_i32(payload, zero + SET_GPS_GLOBAL_ORIGIN_LATITUDE, latitude)
    put_i32(payload, zero + SET_GPS_GLOBAL_ORIGIN_LONGITUDE, longitude)
    put_i32(payload, zero + SET_GPS_GLOBAL_ORIGIN_ALTITUDE, altitude)
    put_u64(payload, zero + SET_GPS_GLOBAL_ORIGIN_TIME_USEC, time_usec)
    return SET_GPS_GLOBAL_ORIGIN_LENGTH


@kernel
def decode_set_gps_global_origin(payload: Bytes) -> tuple[int, int, int, int, int]:
    """Returns the scalar fields of a SET_GPS_GLOBAL_ORIGIN: target_system, latitude, longitude, altitude, time_usec."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + SET_GPS_GLOBAL_ORIGIN_TARGET_SYSTEM),
        get_i32(payload, zero + SET_GPS_GLOBAL_ORIGIN_LATITUDE),
        get_i32(payload, zero + SET_GPS_GLOBAL_ORIGIN_LONGITUDE),
        get_i32(payload, zero + SET_GPS_GLOBAL_ORIGIN_ALTITUDE),
        get_u64(payload, zero + SET_GPS_GLOBAL_ORIGIN_TIME_USEC),
    )


# -- GPS_GLOBAL_ORIGIN ------------------------------------------------------------------------------------------------

GPS_GLOBAL_ORIGIN = 49
GPS_GLOBAL_ORIGIN_LENGTH = 20
GPS_GLOBAL_ORIGIN_LATITUDE = 0  # int32_t [degE7]
GPS_GLOBAL_ORIGIN_LONGITUDE = 4  # int32_t [degE7]
GPS_GLOBAL_ORIGIN_ALTITUDE = 8  # int32_t [mm]
GPS_GLOBAL_ORIGIN_TIME_USEC = 12  # uint64_t [us], extension


@kernel
def encode_gps_global_origin(payload: Bytes, latitude: int, longitude: int, altitude: int, time_usec: int) -> int:
    """Fills `payload` with a GPS_GLOBAL_ORIGIN; returns GPS_GLOBAL_ORIGIN_LENGTH."""
    zero = int(np.int64(0))
    put_i32(payload, zero + GPS_GLOBAL_ORIGIN_LATITUDE, latitude)
    put_i32(payload, zero + GPS_GLOBAL_ORIGIN_LONGITUDE, longitude)
    put_i32(payload, zero + GPS_GLOBAL_ORIGIN_ALTITUDE, altitude)
    put_u64(payload, zero + GPS_GLOBAL_ORIGIN_TIME_USEC, time_usec)
    return GPS_GLOBAL_ORIGIN_LENGTH


@kernel
def decode_gps_global_origin(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a GPS_GLOBAL_ORIGIN: latitude, longitude, altitude, time_usec."""
    zero = int(np.int64(0))
    return (
        get_i32(payload, zero + GPS_GLOBAL_ORIGIN_LATITUDE),
        get_i32(payload, zero + GPS_GLOBAL_ORIGIN_LONGITUDE),
        get_i32(payload, zero + GPS_GLOBAL_ORIGIN_ALTITUDE),
        get_u64(payload, zero + GPS_GLOBAL_ORIGIN_TIME_USEC),
    )


# -- MISSION_REQUEST_INT ----------------------------------------------------------------------------------------------

MISSION_REQUEST_INT = 51
MISSION_REQUEST_INT_LENGTH = 5
MISSION_REQUEST_INT_TARGET_SYSTEM = 2  # uint8_t
MISSION_REQUEST_INT_TARGET_COMPONENT = 3  # uint8_t
MISSION_REQUEST_INT_SEQ = 0  # uint16_t
MISSION_REQUEST_INT_MISSION_TYPE = 4  # uint8_t, extension


@kernel
def encode_mission_request_int(
    payload: Bytes, target_system: int, target_component: int, seq: int, mission_type: int
) -> int:
    """Fills `payload` with a MISSION_REQUEST_INT; returns MISSION_REQUEST_INT_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_REQUEST_INT_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_REQUEST_INT_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + MISSION_REQUEST_INT_SEQ, seq)
    put_u8(payload, zero + MISSION_REQUEST_INT_MISSION_TYPE, mission_type)
    return MISSION_REQUEST_INT_LENGTH


@kernel
def decode_mission_request_int(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a MISSION_REQUEST_INT: target_system, target_component, seq, mission_type."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_REQUEST_INT_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_REQUEST_INT_TARGET_COMPONENT),
        get_u16(payload, zero + MISSION_REQUEST_INT_SEQ),
        get_u8(payload, zero + MISSION_REQUEST_INT_MISSION_TYPE),
    )


# -- NAV_CONTROLLER_OUTPUT --------------------------------------------------------------------------------------------

NAV_CONTROLLER_OUTPUT = 62
NAV_CONTROLLER_OUTPUT_LENGTH = 26
NAV_CONTROLLER_OUTPUT_NAV_ROLL = 0  # float [deg]
NAV_CONTROLLER_OUTPUT_NAV_PITCH = 4  # float [deg]
NAV_CONTROLLER_OUTPUT_NAV_BEARING = 20  # int16_t [deg]
NAV_CONTROLLER_OUTPUT_TARGET_BEARING = 22  # int16_t [deg]
NAV_CONTROLLER_OUTPUT_WP_DIST = 24  # uint16_t [m]
NAV_CONTROLLER_OUTPUT_ALT_ERROR = 8  # float [m]
NAV_CONTROLLER_OUTPUT_ASPD_ERROR = 12  # float [m/s]
NAV_CONTROLLER_OUTPUT_XTRACK_ERROR = 16  # float [m]


@kernel
def encode_nav_controller_output(
    payload: Bytes,
    nav_roll: float,
    nav_pitch: float,
    nav_bearing: int,
    target_bearing: int,
    wp_dist: int,
    alt_error: float,
    aspd_error: float,
    xtrack_error: float,
) -> int:
    """Fills `payload` with a NAV_CONTROLLER_OUTPUT; returns NAV_CONTROLLER_OUTPUT_LENGTH."""
    zero = int(np.int64(0))
    put_f32(payload, zero + NAV_CONTROLLER_OUTPUT_NAV_ROLL, nav_roll)
    put_f32(payload, zero + NAV_CONTROLLER_OUTPUT_NAV_PITCH, nav_pitch)
    put_i16(payload, zero + NAV_CONTROLLER_OUTPUT_NAV_BEARING, nav_bearing)
    put_i16(payload, zero + NAV_CONTROLLER_OUTPUT_TARGET_BEARING, target_bearing)
    put_u16(payload, zero + NAV_CONTROLLER_OUTPUT_WP_DIST, wp_dist)
    put_f32(payload, zero + NAV_CONTROLLER_OUTPUT_ALT_ERROR, alt_error)
    put_f32(payload, zero + NAV_CONTROLLER_OUTPUT_ASPD_ERROR, aspd_error)
    put_f32(payload, zero + NAV_CONTROLLER_OUTPUT_XTRACK_ERROR, xtrack_error)
    return NAV_CONTROLLER_OUTPUT_LENGTH


@kernel
def decode_nav_controller_output(payload: Bytes) -> tuple[float, float, int, int, int, float, float, float]:
    """Returns the scalar fields of a NAV_CONTROLLER_OUTPUT.

    nav_roll, nav_pitch, nav_bearing, target_bearing, wp_dist, alt_error, aspd_error, xtrack_error.
    """
    zero = int(np.int64(0))
    return (
        get_f32(payload, zero + NAV_CONTROLLER_OUTPUT_NAV_ROLL),
        get_f32(payload, zero + NAV_CONTROLLER_OUTPUT_NAV_PITCH),
        get_i16(payload, zero + NAV_CONTROLLER_OUTPUT_NAV_BEARING),
        get_i16(payload, zero + NAV_CONTROLLER_OUTPUT_TARGET_BEARING),
        get_u16(payload, zero + NAV_CONTROLLER_OUTPUT_WP_DIST),
        get_f32(payload, zero + NAV_CONTROLLER_OUTPUT_ALT_ERROR),
        get_f32(payload, zero + NAV_CONTROLLER_OUTPUT_ASPD_ERROR),
        get_f32(payload, zero + NAV_CONTROLLER_OUTPUT_XTRACK_ERROR),
    )


# -- RC_CHANNELS ------------------------------------------------------------------------------------------------------

RC_CHANNELS = 65
RC_CHANNELS_LENGTH = 42
RC_CHANNELS_TIME_BOOT_MS = 0  # uint32_t [ms]
RC_CHANNELS_CHANCOUNT = 40  # uint8_t
RC_CHANNELS_CHAN1_RAW = 4  # uint16_t [us]
RC_CHANNELS_CHAN2_RAW = 6  # uint16_t [us]
RC_CHANNELS_CHAN3_RAW = 8  # uint16_t [us]
RC_CHANNELS_CHAN4_RAW = 10  # uint16_t [us]
RC_CHANNELS_CHAN5_RAW = 12  # uint16_t [us]
RC_CHANNELS_CHAN6_RAW = 14  # uint16_t [us]
RC_CHANNELS_CHAN7_RAW = 16  # uint16_t [us]
RC_CHANNELS_CHAN8_RAW = 18  # uint16_t [us]
RC_CHANNELS_CHAN9_RAW = 20  # uint16_t [us]
RC_CHANNELS_CHAN10_RAW = 22  # uint16_t [us]
RC_CHANNELS_CHAN11_RAW = 24  # uint16_t [us]
RC_CHANNELS_CHAN12_RAW = 26  # uint16_t [us]
RC_CHANNELS_CHAN13_RAW = 28  # uint16_t [us]
RC_CHANNELS_CHAN14_RAW = 30  # uint16_t [us]
RC_CHANNELS_CHAN15_RAW = 32  # uint16_t [us]
RC_CHANNELS_CHAN16_RAW = 34  # uint16_t [us]
RC_CHANNELS_CHAN17_RAW = 36  # uint16_t [us]
RC_CHANNELS_CHAN18_RAW = 38  # uint16_t [us]
RC_CHANNELS_RSSI = 41  # uint8_t


@kernel
def encode_rc_channels(
    payload: Bytes,
    time_boot_ms: int,
    chancount: int,
    chan1_raw: int,
    chan2_raw: int,
    chan3_raw: int,
    chan4_raw: int,
    chan5_raw: int,
    chan6_raw: int,
    chan7_raw: int,
    chan8_raw: int,
    chan9_raw: int,
    chan10_raw: int,
    chan11_raw: int,
    chan12_raw: int,
    chan13_raw: int,
    chan14_raw: int,
    chan15_raw: int,
    chan16_raw: int,
    chan17_raw: int,
    chan18_raw: int,
    rssi: int,
) -> int:
    """Fills `payload` with an RC_CHANNELS; returns RC_CHANNELS_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + RC_CHANNELS_TIME_BOOT_MS, time_boot_ms)
    put_u8(payload, zero + RC_CHANNELS_CHANCOUNT, chancount)
    put_u16(payload, zero + RC_CHANNELS_CHAN1_RAW, chan1_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN2_RAW, chan2_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN3_RAW, chan3_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN4_RAW, chan4_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN5_RAW, chan5_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN6_RAW, chan6_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN7_RAW, chan7_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN8_RAW, chan8_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN9_RAW, chan9_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN10_RAW, chan10_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN11_RAW, chan11_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN12_RAW, chan12_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN13_RAW, chan13_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN14_RAW, chan14_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN15_RAW, chan15_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN16_RAW, chan16_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN17_RAW, chan17_raw)
    put_u16(payload, zero + RC_CHANNELS_CHAN18_RAW, chan18_raw)
    put_u8(payload, zero + RC_CHANNELS_RSSI, rssi)
    return RC_CHANNELS_LENGTH


@kernel
def decode_rc_channels(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of an RC_CHANNELS.

    time_boot_ms, chancount, chan1_raw, chan2_raw, chan3_raw, chan4_raw, chan5_raw, chan6_raw, chan7_raw, chan8_raw,
    chan9_raw, chan10_raw, chan11_raw, chan12_raw, chan13_raw, chan14_raw, chan15_raw, chan16_raw, chan17_raw,
    chan18_raw, rssi.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + RC_CHANNELS_TIME_BOOT_MS),
        get_u8(payload, zero + RC_CHANNELS_CHANCOUNT),
        get_u16(payload, zero + RC_CHANNELS_CHAN1_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN2_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN3_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN4_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN5_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN6_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN7_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN8_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN9_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN10_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN11_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN12_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN13_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN14_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN15_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN16_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN17_RAW),
        get_u16(payload, zero + RC_CHANNELS_CHAN18_RAW),
        get_u8(payload, zero + RC_CHANNELS_RSSI),
    )


# -- REQUEST_DATA_STREAM ----------------------------------------------------------------------------------------------

REQUEST_DATA_STREAM = 66
REQUEST_DATA_STREAM_LENGTH = 6
REQUEST_DATA_STREAM_TARGET_SYSTEM = 2  # uint8_t
REQUEST_DATA_STREAM_TARGET_COMPONENT = 3  # uint8_t
REQUEST_DATA_STREAM_REQ_STREAM_ID = 4  # uint8_t
REQUEST_DATA_STREAM_REQ_MESSAGE_RATE = 0  # uint16_t [Hz]
REQUEST_DATA_STREAM_START_STOP = 5  # uint8_t


@kernel
def encode_request_data_stream(
    payload: Bytes,
    target_system: int,
    target_component: int,
    req_stream_id: int,
    req_message_rate: int,
    start_stop: int,
) -> int:
    """Fills `payload` with a REQUEST_DATA_STREAM; returns REQUEST_DATA_STREAM_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + REQUEST_DATA_STREAM_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + REQUEST_DATA_STREAM_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + REQUEST_DATA_STREAM_REQ_STREAM_ID, req_stream_id)
    put_u16(payload, zero + REQUEST_DATA_STREAM_REQ_MESSAGE_RATE, req_message_rate)
    put_u8(payload, zero + REQUEST_DATA_STREAM_START_STOP, start_stop)
    return REQUEST_DATA_STREAM_LENGTH


@kernel
def decode_request_data_stream(payload: Bytes) -> tuple[int, int, int, int, int]:
    """Returns the scalar fields of a REQUEST_DATA_STREAM.

    target_system, target_component, req_stream_id, req_message_rate, start_stop.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + REQUEST_DATA_STREAM_TARGET_SYSTEM),
        get_u8(payload, zero + REQUEST_DATA_STREAM_TARGET_COMPONENT),
        get_u8(payload, zero + REQUEST_DATA_STREAM_REQ_STREAM_ID),
        get_u16(payload, zero + REQUEST_DATA_STREAM_REQ_MESSAGE_RATE),
        get_u8(payload, zero + REQUEST_DATA_STREAM_START_STOP),
    )


# -- MANUAL_CONTROL ---------------------------------------------------------------------------------------------------

MANUAL_CONTROL = 69
MANUAL_CONTROL_LENGTH = 30
MANUAL_CONTROL_TARGET = 10  # uint8_t
MANUAL_CONTROL_X = 0  # int16_t
MANUAL_CONTROL_Y = 2  # int16_t
MANUAL_CONTROL_Z = 4  # int16_t
MANUAL_CONTROL_R = 6  # int16_t
MANUAL_CONTROL_BUTTONS = 8  # uint16_t
MANUAL_CONTROL_BUTTONS2 = 11  # uint16_t, extension
MANUAL_CONTROL_ENABLED_EXTENSIONS = 13  # uint8_t, extension
MANUAL_CONTROL_S = 14  # int16_t, extension
MANUAL_CONTROL_T = 16  # int16_t, extension
MANUAL_CONTROL_AUX1 = 18  # int16_t, extension
MANUAL_CONTROL_AUX2 = 20  # int16_t, extension
MANUAL_CONTROL_AUX3 = 22  # int16_t, extension
MANUAL_CONTROL_AUX4 = 24  # int16_t, extension
MANUAL_CONTROL_AUX5 = 26  # int16_t, extension
MANUAL_CONTROL_AUX6 = 28  # int16_t, extension


@kernel
def encode_manual_control(
    payload: Bytes,
    target: int,
    x: int,
    y: int,
    z: int,
    r: int,
    buttons: int,
    buttons2: int,
    enabled_extensions: int,
    s: int,
    t: int,
    aux1: int,
    aux2: int,
    aux3: int,
    aux4: int,
    aux5: int,
    aux6: int,
) -> int:
    """Fills `payload` with a MANUAL_CONTROL; returns MANUAL_CONTROL_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MANUAL_CONTROL_TARGET, target)
    put_i16(payload, zero + MANUAL_CONTROL_X, x)
    put_i16(payload, zero + MANUAL_CONTROL_Y, y)
    put_i16(payload, zero + MANUAL_CONTROL_Z, z)
    put_i16(payload, zero + MANUAL_CONTROL_R, r)
    put_u16(payload, zero + MANUAL_CONTROL_BUTTONS, buttons)
    put_u16(payload, zero + MANUAL_CONTROL_BUTTONS2, buttons2)
    put_u8(payload, zero + MANUAL_CONTROL_ENABLED_EXTENSIONS, enabled_extensions)
    put_i16(payload, zero + MANUAL_CONTROL_S, s)
    put_i16(payload, zero + MANUAL_CONTROL_T, t)
    put_i16(payload, zero + MANUAL_CONTROL_AUX1, aux1)
    put_i16(payload, zero + MANUAL_CONTROL_AUX2, aux2)
    put_i16(payload, zero + MANUAL_CONTROL_AUX3, aux3)
    put_i16(payload, zero + MANUAL_CONTROL_AUX4, aux4)
    put_i16(payload, zero + MANUAL_CONTROL_AUX5, aux5)
    put_i16(payload, zero + MANUAL_CONTROL_AUX6, aux6)
    return MANUAL_CONTROL_LENGTH


@kernel
def decode_manual_control(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a MANUAL_CONTROL.

    target, x, y, z, r, buttons, buttons2, enabled_extensions, s, t, aux1, aux2, aux3, aux4, aux5, aux6.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MANUAL_CONTROL_TARGET),
        get_i16(payload, zero + MANUAL_CONTROL_X),
        get_i16(payload, zero + MANUAL_CONTROL_Y),
        get_i16(payload, zero + MANUAL_CONTROL_Z),
        get_i16(payload, zero + MANUAL_CONTROL_R),
        get_u16(payload, zero + MANUAL_CONTROL_BUTTONS),
        get_u16(payload, zero + MANUAL_CONTROL_BUTTONS2),
        get_u8(payload, zero + MANUAL_CONTROL_ENABLED_EXTENSIONS),
        get_i16(payload, zero + MANUAL_CONTROL_S),
        get_i16(payload, zero + MANUAL_CONTROL_T),
        get_i16(payload, zero + MANUAL_CONTROL_AUX1),
        get_i16(payload, zero + MANUAL_CONTROL_AUX2),
        get_i16(payload, zero + MANUAL_CONTROL_AUX3),
        get_i16(payload, zero + MANUAL_CONTROL_AUX4),
        get_i16(payload, zero + MANUAL_CONTROL_AUX5),
        get_i16(payload, zero + MANUAL_CONTROL_AUX6),
    )


# -- RC_CHANNELS_OVERRIDE ---------------------------------------------------------------------------------------------

RC_CHANNELS_OVERRIDE = 70
RC_CHANNELS_OVERRIDE_LENGTH = 38
RC_CHANNELS_OVERRIDE_TARGET_SYSTEM = 16  # uint8_t
RC_CHANNELS_OVERRIDE_TARGET_COMPONENT = 17  # uint8_t
RC_CHANNELS_OVERRIDE_CHAN1_RAW = 0  # uint16_t [us]
RC_CHANNELS_OVERRIDE_CHAN2_RAW = 2  # uint16_t [us]
RC_CHANNELS_OVERRIDE_CHAN3_RAW = 4  # uint16_t [us]
RC_CHANNELS_OVERRIDE_CHAN4_RAW = 6  # uint16_t [us]
RC_CHANNELS_OVERRIDE_CHAN5_RAW = 8  # uint16_t [us]
RC_CHANNELS_OVERRIDE_CHAN6_RAW = 10  # uint16_t [us]
RC_CHANNELS_OVERRIDE_CHAN7_RAW = 12  # uint16_t [us]
RC_CHANNELS_OVERRIDE_CHAN8_RAW = 14  # uint16_t [us]
RC_CHANNELS_OVERRIDE_CHAN9_RAW = 18  # uint16_t [us], extension
RC_CHANNELS_OVERRIDE_CHAN10_RAW = 20  # uint16_t [us], extension
RC_CHANNELS_OVERRIDE_CHAN11_RAW = 22  # uint16_t [us], extension
RC_CHANNELS_OVERRIDE_CHAN12_RAW = 24  # uint16_t [us], extension
RC_CHANNELS_OVERRIDE_CHAN13_RAW = 26  # uint16_t [us], extension
RC_CHANNELS_OVERRIDE_CHAN14_RAW = 28  # uint16_t [us], extension
RC_CHANNELS_OVERRIDE_CHAN15_RAW = 30  # uint16_t [us], extension
RC_CHANNELS_OVERRIDE_CHAN16_RAW = 32  # uint16_t [us], extension
RC_CHANNELS_OVERRIDE_CHAN17_RAW = 34  # uint16_t [us], extension
RC_CHANNELS_OVERRIDE_CHAN18_RAW = 36  # uint16_t [us], extension


@kernel
def encode_rc_channels_override(
    payload: Bytes,
    target_system: int,
    target_component: int,
    chan1_raw: int,
    chan2_raw: int,
    chan3_raw: int,
    chan4_raw: int,
    chan5_raw: int,
    chan6_raw: int,
    chan7_raw: int,
    chan8_raw: int,
    chan9_raw: int,
    chan10_raw: int,
    chan11_raw: int,
    chan12_raw: int,
    chan13_raw: int,
    chan14_raw: int,
    chan15_raw: int,
    chan16_raw: int,
    chan17_raw: int,
    chan18_raw: int,
) -> int:
    """Fills `payload` with an RC_CHANNELS_OVERRIDE; returns RC_CHANNELS_OVERRIDE_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + RC_CHANNELS_OVERRIDE_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + RC_CHANNELS_OVERRIDE_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN1_RAW, chan1_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN2_RAW, chan2_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN3_RAW, chan3_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN4_RAW, chan4_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN5_RAW, chan5_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN6_RAW, chan6_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN7_RAW, chan7_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN8_RAW, chan8_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN9_RAW, chan9_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN10_RAW, chan10_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN11_RAW, chan11_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN12_RAW, chan12_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN13_RAW, chan13_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN14_RAW, chan14_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN15_RAW, chan15_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN16_RAW, chan16_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN17_RAW, chan17_raw)
    put_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN18_RAW, chan18_raw)
    return RC_CHANNELS_OVERRIDE_LENGTH


@kernel
def decode_rc_channels_override(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of an RC_CHANNELS_OVERRIDE.

    target_system, target_component, chan1_raw, chan2_raw, chan3_raw, chan4_raw, chan5_raw, chan6_raw, chan7_raw,
    chan8_raw, chan9_raw, chan10_raw, chan11_raw, chan12_raw, chan13_raw, chan14_raw, chan15_raw, chan16_raw,
    chan17_raw, chan18_raw.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + RC_CHANNELS_OVERRIDE_TARGET_SYSTEM),
        get_u8(payload, zero + RC_CHANNELS_OVERRIDE_TARGET_COMPONENT),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN1_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN2_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN3_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN4_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN5_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN6_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN7_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN8_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN9_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN10_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN11_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN12_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN13_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN14_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN15_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN16_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN17_RAW),
        get_u16(payload, zero + RC_CHANNELS_OVERRIDE_CHAN18_RAW),
    )


# -- MISSION_ITEM_INT -------------------------------------------------------------------------------------------------

MISSION_ITEM_INT = 73
MISSION_ITEM_INT_LENGTH = 38
MISSION_ITEM_INT_TARGET_SYSTEM = 32  # uint8_t
MISSION_ITEM_INT_TARGET_COMPONENT = 33  # uint8_t
MISSION_ITEM_INT_SEQ = 28  # uint16_t
MISSION_ITEM_INT_FRAME = 34  # uint8_t
MISSION_ITEM_INT_COMMAND = 30  # uint16_t
MISSION_ITEM_INT_CURRENT = 35  # uint8_t
MISSION_ITEM_INT_AUTOCONTINUE = 36  # uint8_t
MISSION_ITEM_INT_PARAM1 = 0  # float
MISSION_ITEM_INT_PARAM2 = 4  # float
MISSION_ITEM_INT_PARAM3 = 8  # float
MISSION_ITEM_INT_PARAM4 = 12  # float
MISSION_ITEM_INT_X = 16  # int32_t
MISSION_ITEM_INT_Y = 20  # int32_t
MISSION_ITEM_INT_Z = 24  # float
MISSION_ITEM_INT_MISSION_TYPE = 37  # uint8_t, extension


@kernel
def encode_mission_item_int(
    payload: Bytes,
    target_system: int,
    target_component: int,
    seq: int,
    frame: int,
    command: int,
    current: int,
    autocontinue: int,
    param1: float,
    param2: float,
    param3: float,
    param4: float,
    x: int,
    y: int,
    z: float,
    mission_type: int,
) -> int:
    """Fills `payload` with a MISSION_ITEM_INT; returns MISSION_ITEM_INT_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + MISSION_ITEM_INT_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + MISSION_ITEM_INT_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + MISSION_ITEM_INT_SEQ, seq)
    put_u8(payload, zero + MISSION_ITEM_INT_FRAME, frame)
    put_u16(payload, zero + MISSION_ITEM_INT_COMMAND, command)
    put_u8(payload, zero + MISSION_ITEM_INT_CURRENT, current)
    put_u8(payload, zero + MISSION_ITEM_INT_AUTOCONTINUE, autocontinue)
    put_f32(payload, zero + MISSION_ITEM_INT_PARAM1, param1)
    put_f32(payload, zero + MISSION_ITEM_INT_PARAM2, param2)
    put_f32(payload, zero + MISSION_ITEM_INT_PARAM3, param3)
    put_f32(payload, zero + MISSION_ITEM_INT_PARAM4, param4)
    put_i32(payload, zero + MISSION_ITEM_INT_X, x)
    put_i32(payload, zero + MISSION_ITEM_INT_Y, y)
    put_f32(payload, zero + MISSION_ITEM_INT_Z, z)
    put_u8(payload, zero + MISSION_ITEM_INT_MISSION_TYPE, mission_type)
    return MISSION_ITEM_INT_LENGTH


@kernel
def decode_mission_item_int(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, int, float, float, float, float, int, int, float, int]:
    """Returns the scalar fields of a MISSION_ITEM_INT.

    target_system, target_component, seq, frame, command, current, autocontinue, param1, param2, param3, param4, x, y,
    z, mission_type.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + MISSION_ITEM_INT_TARGET_SYSTEM),
        get_u8(payload, zero + MISSION_ITEM_INT_TARGET_COMPONENT),
        get_u16(payload, zero + MISSION_ITEM_INT_SEQ),
        get_u8(payload, zero + MISSION_ITEM_INT_FRAME),
        get_u16(payload, zero + MISSION_ITEM_INT_COMMAND),
        get_u8(payload, zero + MISSION_ITEM_INT_CURRENT),
        get_u8(payload, zero + MISSION_ITEM_INT_AUTOCONTINUE),
        get_f32(payload, zero + MISSION_ITEM_INT_PARAM1),
        get_f32(payload, zero + MISSION_ITEM_INT_PARAM2),
        get_f32(payload, zero + MISSION_ITEM_INT_PARAM3),
        get_f32(payload, zero + MISSION_ITEM_INT_PARAM4),
        get_i32(payload, zero + MISSION_ITEM_INT_X),
        get_i32(payload, zero + MISSION_ITEM_INT_Y),
        get_f32(payload, zero + MISSION_ITEM_INT_Z),
        get_u8(payload, zero + MISSION_ITEM_INT_MISSION_TYPE),
    )


# -- VFR_HUD ----------------------------------------------------------------------------------------------------------

VFR_HUD = 74
VFR_HUD_LENGTH = 20
VFR_HUD_AIRSPEED = 0  # float [m/s]
VFR_HUD_GROUNDSPEED = 4  # float [m/s]
VFR_HUD_HEADING = 16  # int16_t [deg]
VFR_HUD_THROTTLE = 18  # uint16_t [%]
VFR_HUD_ALT = 8  # float [m]
VFR_HUD_CLIMB = 12  # float [m/s]


@kernel
def encode_vfr_hud(
    payload: Bytes, airspeed: float, groundspeed: float, heading: int, throttle: int, alt: float, climb: float
) -> int:
    """Fills `payload` with a VFR_HUD; returns VFR_HUD_LENGTH."""
    zero = int(np.int64(0))
    put_f32(payload, zero + VFR_HUD_AIRSPEED, airspeed)
    put_f32(payload, zero + VFR_HUD_GROUNDSPEED, groundspeed)
    put_i16(payload, zero + VFR_HUD_HEADING, heading)
    put_u16(payload, zero + VFR_HUD_THROTTLE, throttle)
    put_f32(payload, zero + VFR_HUD_ALT, alt)
    put_f32(payload, zero + VFR_HUD_CLIMB, climb)
    return VFR_HUD_LENGTH


@kernel
def decode_vfr_hud(payload: Bytes) -> tuple[float, float, int, int, float, float]:
    """Returns the scalar fields of a VFR_HUD: airspeed, groundspeed, heading, throttle, alt, climb."""
    zero = int(np.int64(0))
    return (
        get_f32(payload, zero + VFR_HUD_AIRSPEED),
        get_f32(payload, zero + VFR_HUD_GROUNDSPEED),
        get_i16(payload, zero + VFR_HUD_HEADING),
        get_u16(payload, zero + VFR_HUD_THROTTLE),
        get_f32(payload, zero + VFR_HUD_ALT),
        get_f32(payload, zero + VFR_HUD_CLIMB),
    )


# -- COMMAND_INT ------------------------------------------------------------------------------------------------------

COMMAND_INT = 75
COMMAND_INT_LENGTH = 35
COMMAND_INT_TARGET_SYSTEM = 30  # uint8_t
COMMAND_INT_TARGET_COMPONENT = 31  # uint8_t
COMMAND_INT_FRAME = 32  # uint8_t
COMMAND_INT_COMMAND = 28  # uint16_t
COMMAND_INT_CURRENT = 33  # uint8_t
COMMAND_INT_AUTOCONTINUE = 34  # uint8_t
COMMAND_INT_PARAM1 = 0  # float
COMMAND_INT_PARAM2 = 4  # float
COMMAND_INT_PARAM3 = 8  # float
COMMAND_INT_PARAM4 = 12  # float
COMMAND_INT_X = 16  # int32_t
COMMAND_INT_Y = 20  # int32_t
COMMAND_INT_Z = 24  # float


@kernel
def encode_command_int(
    payload: Bytes,
    target_system: int,
    target_component: int,
    frame: int,
    command: int,
    current: int,
    autocontinue: int,
    param1: float,
    param2: float,
    param3: float,
    param4: float,
    x: int,
    y: int,
    z: float,
) -> int:
    """Fills `payload` with a COMMAND_INT; returns COMMAND_INT_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + COMMAND_INT_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + COMMAND_INT_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + COMMAND_INT_FRAME, frame)
    put_u16(payload, zero + COMMAND_INT_COMMAND, command)
    put_u8(payload, zero + COMMAND_INT_CURRENT, current)
    put_u8(payload, zero + COMMAND_INT_AUTOCONTINUE, autocontinue)
    put_f32(payload, zero + COMMAND_INT_PARAM1, param1)
    put_f32(payload, zero + COMMAND_INT_PARAM2, param2)
    put_f32(payload, zero + COMMAND_INT_PARAM3, param3)
    put_f32(payload, zero + COMMAND_INT_PARAM4, param4)
    put_i32(payload, zero + COMMAND_INT_X, x)
    put_i32(payload, zero + COMMAND_INT_Y, y)
    put_f32(payload, zero + COMMAND_INT_Z, z)
    return COMMAND_INT_LENGTH


@kernel
def decode_command_int(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, float, float, float, float, int, int, float]:
    """Returns the scalar fields of a COMMAND_INT.

    target_system, target_component, frame, command, current, autocontinue, param1, param2, param3, param4, x, y, z.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + COMMAND_INT_TARGET_SYSTEM),
        get_u8(payload, zero + COMMAND_INT_TARGET_COMPONENT),
        get_u8(payload, zero + COMMAND_INT_FRAME),
        get_u16(payload, zero + COMMAND_INT_COMMAND),
        get_u8(payload, zero + COMMAND_INT_CURRENT),
        get_u8(payload, zero + COMMAND_INT_AUTOCONTINUE),
        get_f32(payload, zero + COMMAND_INT_PARAM1),
        get_f32(payload, zero + COMMAND_INT_PARAM2),
        get_f32(payload, zero + COMMAND_INT_PARAM3),
        get_f32(payload, zero + COMMAND_INT_PARAM4),
        get_i32(payload, zero + COMMAND_INT_X),
        get_i32(payload, zero + COMMAND_INT_Y),
        get_f32(payload, zero + COMMAND_INT_Z),
    )


# -- COMMAND_LONG -----------------------------------------------------------------------------------------------------

COMMAND_LONG = 76
COMMAND_LONG_LENGTH = 33
COMMAND_LONG_TARGET_SYSTEM = 30  # uint8_t
COMMAND_LONG_TARGET_COMPONENT = 31  # uint8_t
COMMAND_LONG_COMMAND = 28  # uint16_t
COMMAND_LONG_CONFIRMATION = 32  # uint8_t
COMMAND_LONG_PARAM1 = 0  # float
COMMAND_LONG_PARAM2 = 4  # float
COMMAND_LONG_PARAM3 = 8  # float
COMMAND_LONG_PARAM4 = 12  # float
COMMAND_LONG_PARAM5 = 16  # float
COMMAND_LONG_PARAM6 = 20  # float
COMMAND_LONG_PARAM7 = 24  # float


@kernel
def encode_command_long(
    payload: Bytes,
    target_system: int,
    target_component: int,
    command: int,
    confirmation: int,
    param1: float,
    param2: float,
    param3: float,
    param4: float,
    param5: float,
    param6: float,
    param7: float,
) -> int:
    """Fills `payload` with a COMMAND_LONG; returns COMMAND_LONG_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + COMMAND_LONG_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + COMMAND_LONG_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + COMMAND_LONG_COMMAND, command)
    put_u8(payload, zero + COMMAND_LONG_CONFIRMATION, confirmation)
    put_f32(payload, zero + COMMAND_LONG_PARAM1, param1)
    put_f32(payload, zero + COMMAND_LONG_PARAM2, param2)
    put_f32(payload, zero + COMMAND_LONG_PARAM3, param3)
    put_f32(payload, zero + COMMAND_LONG_PARAM4, param4)
    put_f32(payload, zero + COMMAND_LONG_PARAM5, param5)
    put_f32(payload, zero + COMMAND_LONG_PARAM6, param6)
    put_f32(payload, zero + COMMAND_LONG_PARAM7, param7)
    return COMMAND_LONG_LENGTH


@kernel
def decode_command_long(payload: Bytes) -> tuple[int, int, int, int, float, float, float, float, float, float, float]:
    """Returns the scalar fields of a COMMAND_LONG.

    target_system, target_component, command, confirmation, param1, param2, param3, param4, param5, param6, param7.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + COMMAND_LONG_TARGET_SYSTEM),
        get_u8(payload, zero + COMMAND_LONG_TARGET_COMPONENT),
        get_u16(payload, zero + COMMAND_LONG_COMMAND),
        get_u8(payload, zero + COMMAND_LONG_CONFIRMATION),
        get_f32(payload, zero + COMMAND_LONG_PARAM1),
        get_f32(payload, zero + COMMAND_LONG_PARAM2),
        get_f32(payload, zero + COMMAND_LONG_PARAM3),
        get_f32(payload, zero + COMMAND_LONG_PARAM4),
        get_f32(payload, zero + COMMAND_LONG_PARAM5),
        get_f32(payload, zero + COMMAND_LONG_PARAM6),
        get_f32(payload, zero + COMMAND_LONG_PARAM7),
    )


# -- COMMAND_ACK ------------------------------------------------------------------------------------------------------

COMMAND_ACK = 77
COMMAND_ACK_LENGTH = 10
COMMAND_ACK_COMMAND = 0  # uint16_t
COMMAND_ACK_RESULT = 2  # uint8_t
COMMAND_ACK_PROGRESS = 3  # uint8_t, extension
COMMAND_ACK_RESULT_PARAM2 = 4  # int32_t, extension
COMMAND_ACK_TARGET_SYSTEM = 8  # uint8_t, extension
COMMAND_ACK_TARGET_COMPONENT = 9  # uint8_t, extension


@kernel
def encode_command_ack(
    payload: Bytes,
    command: int,
    result: int,
    progress: int,
    result_param2: int,
    target_system: int,
    target_component: int,
) -> int:
    """Fills `payload` with a COMMAND_ACK; returns COMMAND_ACK_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + COMMAND_ACK_COMMAND, command)
    put_u8(payload, zero + COMMAND_ACK_RESULT, result)
    put_u8(payload, zero + COMMAND_ACK_PROGRESS, progress)
    put_i32(payload, zero + COMMAND_ACK_RESULT_PARAM2, result_param2)
    put_u8(payload, zero + COMMAND_ACK_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + COMMAND_ACK_TARGET_COMPONENT, target_component)
    return COMMAND_ACK_LENGTH


@kernel
def decode_command_ack(payload: Bytes) -> tuple[int, int, int, int, int, int]:
    """Returns the scalar fields of a COMMAND_ACK.

    command, result, progress, result_param2, target_system, target_component.
    """
    zero = int(np.int64(0))
    return (
        get_u16(payload, zero + COMMAND_ACK_COMMAND),
        get_u8(payload, zero + COMMAND_ACK_RESULT),
        get_u8(payload, zero + COMMAND_ACK_PROGRESS),
        get_i32(payload, zero + COMMAND_ACK_RESULT_PARAM2),
        get_u8(payload, zero + COMMAND_ACK_TARGET_SYSTEM),
        get_u8(payload, zero + COMMAND_ACK_TARGET_COMPONENT),
    )


# -- SET_ATTITUDE_TARGET ----------------------------------------------------------------------------------------------

SET_ATTITUDE_TARGET = 82
SET_ATTITUDE_TARGET_LENGTH = 39
SET_ATTITUDE_TARGET_TIME_BOOT_MS = 0  # uint32_t [ms]
SET_ATTITUDE_TARGET_TARGET_SYSTEM = 36  # uint8_t
SET_ATTITUDE_TARGET_TARGET_COMPONENT = 37  # uint8_t
SET_ATTITUDE_TARGET_TYPE_MASK = 38  # uint8_t
SET_ATTITUDE_TARGET_Q = 4  # float[4]
SET_ATTITUDE_TARGET_BODY_ROLL_RATE = 20  # float [rad/s]
SET_ATTITUDE_TARGET_BODY_PITCH_RATE = 24  # float [rad/s]
SET_ATTITUDE_TARGET_BODY_YAW_RATE = 28  # float [rad/s]
SET_ATTITUDE_TARGET_THRUST = 32  # float


@kernel
def encode_set_attitude_target(
    payload: Bytes,
    time_boot_ms: int,
    target_system: int,
    target_component: int,
    type_mask: int,
    body_roll_rate: float,
    body_pitch_rate: float,
    body_yaw_rate: float,
    thrust: float,
) -> int:
    """Fills `payload` with a SET_ATTITUDE_TARGET; returns SET_ATTITUDE_TARGET_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SET_ATTITUDE_TARGET_TIME_BOOT_MS, time_boot_ms)
    put_u8(payload, zero + SET_ATTITUDE_TARGET_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + SET_ATTITUDE_TARGET_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + SET_ATTITUDE_TARGET_TYPE_MASK, type_mask)
    clear(payload, zero + SET_ATTITUDE_TARGET_Q, zero + SET_ATTITUDE_TARGET_Q + 16)
    put_f32(payload, zero + SET_ATTITUDE_TARGET_BODY_ROLL_RATE, body_roll_rate)
    put_f32(payload, zero + SET_ATTITUDE_TARGET_BODY_PITCH_RATE, body_pitch_rate)
    put_f32(payload, zero + SET_ATTITUDE_TARGET_BODY_YAW_RATE, body_yaw_rate)
    put_f32(payload, zero + SET_ATTITUDE_TARGET_THRUST, thrust)
    return SET_ATTITUDE_TARGET_LENGTH


@kernel
def decode_set_attitude_target(payload: Bytes) -> tuple[int, int, int, int, float, float, float, float]:
    """Returns the scalar fields of a SET_ATTITUDE_TARGET.

    time_boot_ms, target_system, target_component, type_mask, body_roll_rate, body_pitch_rate, body_yaw_rate, thrust.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SET_ATTITUDE_TARGET_TIME_BOOT_MS),
        get_u8(payload, zero + SET_ATTITUDE_TARGET_TARGET_SYSTEM),
        get_u8(payload, zero + SET_ATTITUDE_TARGET_TARGET_COMPONENT),
        get_u8(payload, zero + SET_ATTITUDE_TARGET_TYPE_MASK),
        get_f32(payload, zero + SET_ATTITUDE_TARGET_BODY_ROLL_RATE),
        get_f32(payload, zero + SET_ATTITUDE_TARGET_BODY_PITCH_RATE),
        get_f32(payload, zero + SET_ATTITUDE_TARGET_BODY_YAW_RATE),
        get_f32(payload, zero + SET_ATTITUDE_TARGET_THRUST),
    )


@kernel
def put_set_attitude_target_q(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 3) of `q`."""
    put_f32(payload, SET_ATTITUDE_TARGET_Q + 4 * i, value)


@kernel
def get_set_attitude_target_q(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 3) of `q`."""
    return get_f32(payload, SET_ATTITUDE_TARGET_Q + 4 * i)


# -- ATTITUDE_TARGET --------------------------------------------------------------------------------------------------

ATTITUDE_TARGET = 83
ATTITUDE_TARGET_LENGTH = 37
ATTITUDE_TARGET_TIME_BOOT_MS = 0  # uint32_t [ms]
ATTITUDE_TARGET_TYPE_MASK = 36  # uint8_t
ATTITUDE_TARGET_Q = 4  # float[4]
ATTITUDE_TARGET_BODY_ROLL_RATE = 20  # float [rad/s]
ATTITUDE_TARGET_BODY_PITCH_RATE = 24  # float [rad/s]
ATTITUDE_TARGET_BODY_YAW_RATE = 28  # float [rad/s]
ATTITUDE_TARGET_THRUST = 32  # float


@kernel
def encode_attitude_target(
    payload: Bytes,
    time_boot_ms: int,
    type_mask: int,
    body_roll_rate: float,
    body_pitch_rate: float,
    body_yaw_rate: float,
    thrust: float,
) -> int:
    """Fills `payload` with an ATTITUDE_TARGET; returns ATTITUDE_TARGET_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + ATTITUDE_TARGET_TIME_BOOT_MS, time_boot_ms)
    put_u8(payload, zero + ATTITUDE_TARGET_TYPE_MASK, type_mask)
    clear(payload, zero + ATTITUDE_TARGET_Q, zero + ATTITUDE_TARGET_Q + 16)
    put_f32(payload, zero + ATTITUDE_TARGET_BODY_ROLL_RATE, body_roll_rate)
    put_f32(payload, zero + ATTITUDE_TARGET_BODY_PITCH_RATE, body_pitch_rate)
    put_f32(payload, zero + ATTITUDE_TARGET_BODY_YAW_RATE, body_yaw_rate)
    put_f32(payload, zero + ATTITUDE_TARGET_THRUST, thrust)
    return ATTITUDE_TARGET_LENGTH


@kernel
def decode_attitude_target(payload: Bytes) -> tuple[int, int, float, float, float, float]:
    """Returns the scalar fields of an ATTITUDE_TARGET.

    time_boot_ms, type_mask, body_roll_rate, body_pitch_rate, body_yaw_rate, thrust.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + ATTITUDE_TARGET_TIME_BOOT_MS),
        get_u8(payload, zero + ATTITUDE_TARGET_TYPE_MASK),
        get_f32(payload, zero + ATTITUDE_TARGET_BODY_ROLL_RATE),
        get_f32(payload, zero + ATTITUDE_TARGET_BODY_PITCH_RATE),
        get_f32(payload, zero + ATTITUDE_TARGET_BODY_YAW_RATE),
        get_f32(payload, zero + ATTITUDE_TARGET_THRUST),
    )


@kernel
def put_attitude_target_q(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 3) of `q`."""
    put_f32(payload, ATTITUDE_TARGET_Q + 4 * i, value)


@kernel
def get_attitude_target_q(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 3) of `q`."""
    return get_f32(payload, ATTITUDE_TARGET_Q + 4 * i)


# -- SET_POSITION_TARGET_LOCAL_NED ------------------------------------------------------------------------------------

SET_POSITION_TARGET_LOCAL_NED = 84
SET_POSITION_TARGET_LOCAL_NED_LENGTH = 53
SET_POSITION_TARGET_LOCAL_NED_TIME_BOOT_MS = 0  # uint32_t [ms]
SET_POSITION_TARGET_LOCAL_NED_TARGET_SYSTEM = 50  # uint8_t
SET_POSITION_TARGET_LOCAL_NED_TARGET_COMPONENT = 51  # uint8_t
SET_POSITION_TARGET_LOCAL_NED_COORDINATE_FRAME = 52  # uint8_t
SET_POSITION_TARGET_LOCAL_NED_TYPE_MASK = 48  # uint16_t
SET_POSITION_TARGET_LOCAL_NED_X = 4  # float [m]
SET_POSITION_TARGET_LOCAL_NED_Y = 8  # float [m]
SET_POSITION_TARGET_LOCAL_NED_Z = 12  # float [m]
SET_POSITION_TARGET_LOCAL_NED_VX = 16  # float [m/s]
SET_POSITION_TARGET_LOCAL_NED_VY = 20  # float [m/s]
SET_POSITION_TARGET_LOCAL_NED_VZ = 24  # float [m/s]
SET_POSITION_TARGET_LOCAL_NED_AFX = 28  # float [m/s/s]
SET_POSITION_TARGET_LOCAL_NED_AFY = 32  # float [m/s/s]
SET_POSITION_TARGET_LOCAL_NED_AFZ = 36  # float [m/s/s]
SET_POSITION_TARGET_LOCAL_NED_YAW = 40  # float [rad]
SET_POSITION_TARGET_LOCAL_NED_YAW_RATE = 44  # float [rad/s]


@kernel
def encode_set_position_target_local_ned(
    payload: Bytes,
    time_boot_ms: int,
    target_system: int,
    target_component: int,
    coordinate_frame: int,
    type_mask: int,
    x: float,
    y: float,
    z: float,
    vx: float,
    vy: float,
    vz: float,
    afx: float,
    afy: float,
    afz: float,
    yaw: float,
    yaw_rate: float,
) -> int:
    """Fills `payload` with a SET_POSITION_TARGET_LOCAL_NED; returns SET_POSITION_TARGET_LOCAL_NED_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_TIME_BOOT_MS, time_boot_ms)
    put_u8(payload, zero + SET_POSITION_TARGET_LOCAL_NED_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + SET_POSITION_TARGET_LOCAL_NED_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + SET_POSITION_TARGET_LOCAL_NED_COORDINATE_FRAME, coordinate_frame)
    put_u16(payload, zero + SET_POSITION_TARGET_LOCAL_NED_TYPE_MASK, type_mask)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_X, x)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_Y, y)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_Z, z)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_VX, vx)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_VY, vy)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_VZ, vz)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_AFX, afx)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_AFY, afy)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_AFZ, afz)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_YAW, yaw)
    put_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_YAW_RATE, yaw_rate)
    return SET_POSITION_TARGET_LOCAL_NED_LENGTH


@kernel
def decode_set_position_target_local_ned(
    payload: Bytes,
) -> tuple[int, int, int, int, int, float, float, float, float, float, float, float, float, float, float, float]:
    """Returns the scalar fields of a SET_POSITION_TARGET_LOCAL_NED.

    time_boot_ms, target_system, target_component, coordinate_frame, type_mask, x, y, z, vx, vy, vz, afx, afy, afz,
    yaw, yaw_rate.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_TIME_BOOT_MS),
        get_u8(payload, zero + SET_POSITION_TARGET_LOCAL_NED_TARGET_SYSTEM),
        get_u8(payload, zero + SET_POSITION_TARGET_LOCAL_NED_TARGET_COMPONENT),
        get_u8(payload, zero + SET_POSITION_TARGET_LOCAL_NED_COORDINATE_FRAME),
        get_u16(payload, zero + SET_POSITION_TARGET_LOCAL_NED_TYPE_MASK),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_X),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_Y),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_Z),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_VX),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_VY),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_VZ),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_AFX),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_AFY),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_AFZ),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_YAW),
        get_f32(payload, zero + SET_POSITION_TARGET_LOCAL_NED_YAW_RATE),
    )


# -- POSITION_TARGET_LOCAL_NED ----------------------------------------------------------------------------------------

POSITION_TARGET_LOCAL_NED = 85
POSITION_TARGET_LOCAL_NED_LENGTH = 51
POSITION_TARGET_LOCAL_NED_TIME_BOOT_MS = 0  # uint32_t [ms]
POSITION_TARGET_LOCAL_NED_COORDINATE_FRAME = 50  # uint8_t
POSITION_TARGET_LOCAL_NED_TYPE_MASK = 48  # uint16_t
POSITION_TARGET_LOCAL_NED_X = 4  # float [m]
POSITION_TARGET_LOCAL_NED_Y = 8  # float [m]
POSITION_TARGET_LOCAL_NED_Z = 12  # float [m]
POSITION_TARGET_LOCAL_NED_VX = 16  # float [m/s]
POSITION_TARGET_LOCAL_NED_VY = 20  # float [m/s]
POSITION_TARGET_LOCAL_NED_VZ = 24  # float [m/s]
POSITION_TARGET_LOCAL_NED_AFX = 28  # float [m/s/s]
POSITION_TARGET_LOCAL_NED_AFY = 32  # float [m/s/s]
POSITION_TARGET_LOCAL_NED_AFZ = 36  # float [m/s/s]
POSITION_TARGET_LOCAL_NED_YAW = 40  # float [rad]
POSITION_TARGET_LOCAL_NED_YAW_RATE = 44  # float [rad/s]


@kernel
def encode_position_target_local_ned(
    payload: Bytes,
    time_boot_ms: int,
    coordinate_frame: int,
    type_mask: int,
    x: float,
    y: float,
    z: float,
    vx: float,
    vy: float,
    vz: float,
    afx: float,
    afy: float,
    afz: float,
    yaw: float,
    yaw_rate: float,
) -> int:
    """Fills `payload` with a POSITION_TARGET_LOCAL_NED; returns POSITION_TARGET_LOCAL_NED_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + POSITION_TARGET_LOCAL_NED_TIME_BOOT_MS, time_boot_ms)
    put_u8(payload, zero + POSITION_TARGET_LOCAL_NED_COORDINATE_FRAME, coordinate_frame)
    put_u16(payload, zero + POSITION_TARGET_LOCAL_NED_TYPE_MASK, type_mask)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_X, x)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_Y, y)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_Z, z)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_VX, vx)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_VY, vy)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_VZ, vz)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_AFX, afx)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_AFY, afy)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_AFZ, afz)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_YAW, yaw)
    put_f32(payload, zero + POSITION_TARGET_LOCAL_NED_YAW_RATE, yaw_rate)
    return POSITION_TARGET_LOCAL_NED_LENGTH


@kernel
def decode_position_target_local_ned(
    payload: Bytes,
) -> tuple[int, int, int, float, float, float, float, float, float, float, float, float, float, float]:
    """Returns the scalar fields of a POSITION_TARGET_LOCAL_NED.

    time_boot_ms, coordinate_frame, type_mask, x, y, z, vx, vy, vz, afx, afy, afz, yaw, yaw_rate.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + POSITION_TARGET_LOCAL_NED_TIME_BOOT_MS),
        get_u8(payload, zero + POSITION_TARGET_LOCAL_NED_COORDINATE_FRAME),
        get_u16(payload, zero + POSITION_TARGET_LOCAL_NED_TYPE_MASK),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_X),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_Y),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_Z),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_VX),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_VY),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_VZ),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_AFX),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_AFY),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_AFZ),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_YAW),
        get_f32(payload, zero + POSITION_TARGET_LOCAL_NED_YAW_RATE),
    )


# -- SET_POSITION_TARGET_GLOBAL_INT -----------------------------------------------------------------------------------

SET_POSITION_TARGET_GLOBAL_INT = 86
SET_POSITION_TARGET_GLOBAL_INT_LENGTH = 53
SET_POSITION_TARGET_GLOBAL_INT_TIME_BOOT_MS = 0  # uint32_t [ms]
SET_POSITION_TARGET_GLOBAL_INT_TARGET_SYSTEM = 50  # uint8_t
SET_POSITION_TARGET_GLOBAL_INT_TARGET_COMPONENT = 51  # uint8_t
SET_POSITION_TARGET_GLOBAL_INT_COORDINATE_FRAME = 52  # uint8_t
SET_POSITION_TARGET_GLOBAL_INT_TYPE_MASK = 48  # uint16_t
SET_POSITION_TARGET_GLOBAL_INT_LAT_INT = 4  # int32_t [degE7]
SET_POSITION_TARGET_GLOBAL_INT_LON_INT = 8  # int32_t [degE7]
SET_POSITION_TARGET_GLOBAL_INT_ALT = 12  # float [m]
SET_POSITION_TARGET_GLOBAL_INT_VX = 16  # float [m/s]
SET_POSITION_TARGET_GLOBAL_INT_VY = 20  # float [m/s]
SET_POSITION_TARGET_GLOBAL_INT_VZ = 24  # float [m/s]
SET_POSITION_TARGET_GLOBAL_INT_AFX = 28  # float [m/s/s]
SET_POSITION_TARGET_GLOBAL_INT_AFY = 32  # float [m/s/s]
SET_POSITION_TARGET_GLOBAL_INT_AFZ = 36  # float [m/s/s]
SET_POSITION_TARGET_GLOBAL_INT_YAW = 40  # float [rad]
SET_POSITION_TARGET_GLOBAL_INT_YAW_RATE = 44  # float [rad/s]


@kernel
def encode_set_position_target_global_int(
    payload: Bytes,
    time_boot_ms: int,
    target_system: int,
    target_component: int,
    coordinate_frame: int,
    type_mask: int,
    lat_int: int,
    lon_int: int,
    alt: float,
    vx: float,
    vy: float,
    vz: float,
    afx: float,
    afy: float,
    afz: float,
    yaw: float,
    yaw_rate: float,
) -> int:
    """Fills `payload` with a SET_POSITION_TARGET_GLOBAL_INT; returns SET_POSITION_TARGET_GLOBAL_INT_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_TIME_BOOT_MS, time_boot_ms)
    put_u8(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_COORDINATE_FRAME, coordinate_frame)
    put_u16(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_TYPE_MASK, type_mask)
    put_i32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_LAT_INT, lat_int)
    put_i32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_LON_INT, lon_int)
    put_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_ALT, alt)
    put_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_VX, vx)
    put_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_VY, vy)
    put_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_VZ, vz)
    put_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_AFX, afx)
    put_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_AFY, afy)
    put_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_AFZ, afz)
    put_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_YAW, yaw)
    put_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_YAW_RATE, yaw_rate)
    return SET_POSITION_TARGET_GLOBAL_INT_LENGTH


@kernel
def decode_set_position_target_global_int(
    payload: Bytes,
) -> tuple[int, int, int, int, int, int, int, float, float, float, float, float, float, float, float, float]:
    """Returns the scalar fields of a SET_POSITION_TARGET_GLOBAL_INT.

    time_boot_ms, target_system, target_component, coordinate_frame, type_mask, lat_int, lon_int, alt, vx, vy, vz, afx,
    afy, afz, yaw, yaw_rate.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_TIME_BOOT_MS),
        get_u8(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_TARGET_SYSTEM),
        get_u8(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_TARGET_COMPONENT),
        get_u8(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_COORDINATE_FRAME),
        get_u16(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_TYPE_MASK),
        get_i32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_LAT_INT),
        get_i32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_LON_INT),
        get_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_ALT),
        get_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_VX),
        get_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_VY),
        get_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_VZ),
        get_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_AFX),
        get_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_AFY),
        get_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_AFZ),
        get_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_YAW),
        get_f32(payload, zero + SET_POSITION_TARGET_GLOBAL_INT_YAW_RATE),
    )


# -- POSITION_TARGET_GLOBAL_INT ---------------------------------------------------------------------------------------

POSITION_TARGET_GLOBAL_INT = 87
POSITION_TARGET_GLOBAL_INT_LENGTH = 51
POSITION_TARGET_GLOBAL_INT_TIME_BOOT_MS = 0  # uint32_t [ms]
POSITION_TARGET_GLOBAL_INT_COORDINATE_FRAME = 50  # uint8_t
POSITION_TARGET_GLOBAL_INT_TYPE_MASK = 48  # uint16_t
POSITION_TARGET_GLOBAL_INT_LAT_INT = 4  # int32_t [degE7]
POSITION_TARGET_GLOBAL_INT_LON_INT = 8  # int32_t [degE7]
POSITION_TARGET_GLOBAL_INT_ALT = 12  # float [m]
POSITION_TARGET_GLOBAL_INT_VX = 16  # float [m/s]
POSITION_TARGET_GLOBAL_INT_VY = 20  # float [m/s]
POSITION_TARGET_GLOBAL_INT_VZ = 24  # float [m/s]
POSITION_TARGET_GLOBAL_INT_AFX = 28  # float [m/s/s]
POSITION_TARGET_GLOBAL_INT_AFY = 32  # float [m/s/s]
POSITION_TARGET_GLOBAL_INT_AFZ = 36  # float [m/s/s]
POSITION_TARGET_GLOBAL_INT_YAW = 40  # float [rad]
POSITION_TARGET_GLOBAL_INT_YAW_RATE = 44  # float [rad/s]


@kernel
def encode_position_target_global_int(
    payload: Bytes,
    time_boot_ms: int,
    coordinate_frame: int,
    type_mask: int,
    lat_int: int,
    lon_int: int,
    alt: float,
    vx: float,
    vy: float,
    vz: float,
    afx: float,
    afy: float,
    afz: float,
    yaw: float,
    yaw_rate: float,
) -> int:
    """Fills `payload` with a POSITION_TARGET_GLOBAL_INT; returns POSITION_TARGET_GLOBAL_INT_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + POSITION_TARGET_GLOBAL_INT_TIME_BOOT_MS, time_boot_ms)
    put_u8(payload, zero + POSITION_TARGET_GLOBAL_INT_COORDINATE_FRAME, coordinate_frame)
    put_u16(payload, zero + POSITION_TARGET_GLOBAL_INT_TYPE_MASK, type_mask)
    put_i32(payload, zero + POSITION_TARGET_GLOBAL_INT_LAT_INT, lat_int)
    put_i32(payload, zero + POSITION_TARGET_GLOBAL_INT_LON_INT, lon_int)
    put_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_ALT, alt)
    put_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_VX, vx)
    put_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_VY, vy)
    put_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_VZ, vz)
    put_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_AFX, afx)
    put_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_AFY, afy)
    put_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_AFZ, afz)
    put_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_YAW, yaw)
    put_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_YAW_RATE, yaw_rate)
    return POSITION_TARGET_GLOBAL_INT_LENGTH


@kernel
def decode_position_target_global_int(
    payload: Bytes,
) -> tuple[int, int, int, int, int, float, float, float, float, float, float, float, float, float]:
    """Returns the scalar fields of a POSITION_TARGET_GLOBAL_INT.

    time_boot_ms, coordinate_frame, type_mask, lat_int, lon_int, alt, vx, vy, vz, afx, afy, afz, yaw, yaw_rate.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + POSITION_TARGET_GLOBAL_INT_TIME_BOOT_MS),
        get_u8(payload, zero + POSITION_TARGET_GLOBAL_INT_COORDINATE_FRAME),
        get_u16(payload, zero + POSITION_TARGET_GLOBAL_INT_TYPE_MASK),
        get_i32(payload, zero + POSITION_TARGET_GLOBAL_INT_LAT_INT),
        get_i32(payload, zero + POSITION_TARGET_GLOBAL_INT_LON_INT),
        get_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_ALT),
        get_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_VX),
        get_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_VY),
        get_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_VZ),
        get_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_AFX),
        get_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_AFY),
        get_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_AFZ),
        get_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_YAW),
        get_f32(payload, zero + POSITION_TARGET_GLOBAL_INT_YAW_RATE),
    )


# -- HIGHRES_IMU ------------------------------------------------------------------------------------------------------

HIGHRES_IMU = 105
HIGHRES_IMU_LENGTH = 63
HIGHRES_IMU_TIME_USEC = 0  # uint64_t [us]
HIGHRES_IMU_XACC = 8  # float [m/s/s]
HIGHRES_IMU_YACC = 12  # float [m/s/s]
HIGHRES_IMU_ZACC = 16  # float [m/s/s]
HIGHRES_IMU_XGYRO = 20  # float [rad/s]
HIGHRES_IMU_YGYRO = 24  # float [rad/s]
HIGHRES_IMU_ZGYRO = 28  # float [rad/s]
HIGHRES_IMU_XMAG = 32  # float [gauss]
HIGHRES_IMU_YMAG = 36  # float [gauss]
HIGHRES_IMU_ZMAG = 40  # float [gauss]
HIGHRES_IMU_ABS_PRESSURE = 44  # float [hPa]
HIGHRES_IMU_DIFF_PRESSURE = 48  # float [hPa]
HIGHRES_IMU_PRESSURE_ALT = 52  # float
HIGHRES_IMU_TEMPERATURE = 56  # float [degC]
HIGHRES_IMU_FIELDS_UPDATED = 60  # uint16_t
HIGHRES_IMU_ID = 62  # uint8_t, extension


@kernel
def encode_highres_imu(
    payload: Bytes,
    time_usec: int,
    xacc: float,
    yacc: float,
    zacc: float,
    xgyro: float,
    ygyro: float,
    zgyro: float,
    xmag: float,
    ymag: float,
    zmag: float,
    abs_pressure: float,
    diff_pressure: float,
    pressure_alt: float,
    temperature: float,
    fields_updated: int,
    id_: int,
) -> int:
    """Fills `payload` with a HIGHRES_IMU; returns HIGHRES_IMU_LENGTH."""
    zero = int(np.int64(0))
    put_u64(payload, zero + HIGHRES_IMU_TIME_USEC, time_usec)
    put_f32(payload, zero + HIGHRES_IMU_XACC, xacc)
    put_f32(payload, zero + HIGHRES_IMU_YACC, yacc)
    put_f32(payload, zero + HIGHRES_IMU_ZACC, zacc)
    put_f32(payload, zero + HIGHRES_IMU_XGYRO, xgyro)
    put_f32(payload, zero + HIGHRES_IMU_YGYRO, ygyro)
    put_f32(payload, zero + HIGHRES_IMU_ZGYRO, zgyro)
    put_f32(payload, zero + HIGHRES_IMU_XMAG, xmag)
    put_f32(payload, zero + HIGHRES_IMU_YMAG, ymag)
    put_f32(payload, zero + HIGHRES_IMU_ZMAG, zmag)
    put_f32(payload, zero + HIGHRES_IMU_ABS_PRESSURE, abs_pressure)
    put_f32(payload, zero + HIGHRES_IMU_DIFF_PRESSURE, diff_pressure)
    put_f32(payload, zero + HIGHRES_IMU_PRESSURE_ALT, pressure_alt)
    put_f32(payload, zero + HIGHRES_IMU_TEMPERATURE, temperature)
    put_u16(payload, zero + HIGHRES_IMU_FIELDS_UPDATED, fields_updated)
    put_u8(payload, zero + HIGHRES_IMU_ID, id_)
    return HIGHRES_IMU_LENGTH


@kernel
def decode_highres_imu(
    payload: Bytes,
) -> tuple[int, float, float, float, float, float, float, float, float, float, float, float, float, float, int, int]:
    """Returns the scalar fields of a HIGHRES_IMU.

    time_usec, xacc, yacc, zacc, xgyro, ygyro, zgyro, xmag, ymag, zmag, abs_pressure, diff_pressure, pressure_alt,
    temperature, fields_updated, id.
    """
    zero = int(np.int64(0))
    return (
        get_u64(payload, zero + HIGHRES_IMU_TIME_USEC),
        get_f32(payload, zero + HIGHRES_IMU_XACC),
        get_f32(payload, zero + HIGHRES_IMU_YACC),
        get_f32(payload, zero + HIGHRES_IMU_ZACC),
        get_f32(payload, zero + HIGHRES_IMU_XGYRO),
        get_f32(payload, zero + HIGHRES_IMU_YGYRO),
        get_f32(payload, zero + HIGHRES_IMU_ZGYRO),
        get_f32(payload, zero + HIGHRES_IMU_XMAG),
        get_f32(payload, zero + HIGHRES_IMU_YMAG),
        get_f32(payload, zero + HIGHRES_IMU_ZMAG),
        get_f32(payload, zero + HIGHRES_IMU_ABS_PRESSURE),
        get_f32(payload, zero + HIGHRES_IMU_DIFF_PRESSURE),
        get_f32(payload, zero + HIGHRES_IMU_PRESSURE_ALT),
        get_f32(payload, zero + HIGHRES_IMU_TEMPERATURE),
        get_u16(payload, zero + HIGHRES_IMU_FIELDS_UPDATED),
        get_u8(payload, zero + HIGHRES_IMU_ID),
    )


# -- SIM_STATE --------------------------------------------------------------------------------------------------------

SIM_STATE = 108
SIM_STATE_LENGTH = 92
SIM_STATE_Q1 = 0  # float
SIM_STATE_Q2 = 4  # float
SIM_STATE_Q3 = 8  # float
SIM_STATE_Q4 = 12  # float
SIM_STATE_ROLL = 16  # float [rad]
SIM_STATE_PITCH = 20  # float [rad]
SIM_STATE_YAW = 24  # float [rad]
SIM_STATE_XACC = 28  # float [m/s/s]
SIM_STATE_YACC = 32  # float [m/s/s]
SIM_STATE_ZACC = 36  # float [m/s/s]
SIM_STATE_XGYRO = 40  # float [rad/s]
SIM_STATE_YGYRO = 44  # float [rad/s]
SIM_STATE_ZGYRO = 48  # float [rad/s]
SIM_STATE_LAT = 52  # float [deg]
SIM_STATE_LON = 56  # float [deg]
SIM_STATE_ALT = 60  # float [m]
SIM_STATE_STD_DEV_HORZ = 64  # float
SIM_STATE_STD_DEV_VERT = 68  # float
SIM_STATE_VN = 72  # float [m/s]
SIM_STATE_VE = 76  # float [m/s]
SIM_STATE_VD = 80  # float [m/s]
SIM_STATE_LAT_INT = 84  # int32_t [degE7], extension
SIM_STATE_LON_INT = 88  # int32_t [degE7], extension


@kernel
def encode_sim_state(
    payload: Bytes,
    q1: float,
    q2: float,
    q3: float,
    q4: float,
    roll: float,
    pitch: float,
    yaw: float,
    xacc: float,
    yacc: float,
    zacc: float,
    xgyro: float,
    ygyro: float,
    zgyro: float,
    lat: float,
    lon: float,
    alt: float,
    std_dev_horz: float,
    std_dev_vert: float,
    vn: float,
    ve: float,
    vd: float,
    lat_int: int,
    lon_int: int,
) -> int:
    """Fills `payload` with a SIM_STATE; returns SIM_STATE_LENGTH."""
    zero = int(np.int64(0))
    put_f32(payload, zero + SIM_STATE_Q1, q1)
    put_f32(payload, zero + SIM_STATE_Q2, q2)
    put_f32(payload, zero + SIM_STATE_Q3, q3)
    put_f32(payload, zero + SIM_STATE_Q4, q4)
    put_f32(payload, zero + SIM_STATE_ROLL, roll)
    put_f32(payload, zero + SIM_STATE_PITCH, pitch)
    put_f32(payload, zero + SIM_STATE_YAW, yaw)
    put_f32(payload, zero + SIM_STATE_XACC, xacc)
    put_f32(payload, zero + SIM_STATE_YACC, yacc)
    put_f32(payload, zero + SIM_STATE_ZACC, zacc)
    put_f32(payload, zero + SIM_STATE_XGYRO, xgyro)
    put_f32(payload, zero + SIM_STATE_YGYRO, ygyro)
    put_f32(payload, zero + SIM_STATE_ZGYRO, zgyro)
    put_f32(payload, zero + SIM_STATE_LAT, lat)
    put_f32(payload, zero + SIM_STATE_LON, lon)
    put_f32(payload, zero + SIM_STATE_ALT, alt)
    put_f32(payload, zero + SIM_STATE_STD_DEV_HORZ, std_dev_horz)
    put_f32(payload, zero + SIM_STATE_STD_DEV_VERT, std_dev_vert)
    put_f32(payload, zero + SIM_STATE_VN, vn)
    put_f32(payload, zero + SIM_STATE_VE, ve)
    put_f32(payload, zero + SIM_STATE_VD, vd)
    put_i32(payload, zero + SIM_STATE_LAT_INT, lat_int)
    put_i32(payload, zero + SIM_STATE_LON_INT, lon_int)
    return SIM_STATE_LENGTH


@kernel
def decode_sim_state(
    payload: Bytes,
) -> tuple[
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    float,
    int,
    int,
]:
    """Returns the scalar fields of a SIM_STATE.

    q1, q2, q3, q4, roll, pitch, yaw, xacc, yacc, zacc, xgyro, ygyro, zgyro, lat, lon, alt, std_dev_horz, std_dev_vert,
    vn, ve, vd, lat_int, lon_int.
    """
    zero = int(np.int64(0))
    return (
        get_f32(payload, zero + SIM_STATE_Q1),
        get_f32(payload, zero + SIM_STATE_Q2),
        get_f32(payload, zero + SIM_STATE_Q3),
        get_f32(payload, zero + SIM_STATE_Q4),
        get_f32(payload, zero + SIM_STATE_ROLL),
        get_f32(payload, zero + SIM_STATE_PITCH),
        get_f32(payload, zero + SIM_STATE_YAW),
        get_f32(payload, zero + SIM_STATE_XACC),
        get_f32(payload, zero + SIM_STATE_YACC),
        get_f32(payload, zero + SIM_STATE_ZACC),
        get_f32(payload, zero + SIM_STATE_XGYRO),
        get_f32(payload, zero + SIM_STATE_YGYRO),
        get_f32(payload, zero + SIM_STATE_ZGYRO),
        get_f32(payload, zero + SIM_STATE_LAT),
        get_f32(payload, zero + SIM_STATE_LON),
        get_f32(payload, zero + SIM_STATE_ALT),
        get_f32(payload, zero + SIM_STATE_STD_DEV_HORZ),
        get_f32(payload, zero + SIM_STATE_STD_DEV_VERT),
        get_f32(payload, zero + SIM_STATE_VN),
        get_f32(payload, zero + SIM_STATE_VE),
        get_f32(payload, zero + SIM_STATE_VD),
        get_i32(payload, zero + SIM_STATE_LAT_INT),
        get_i32(payload, zero + SIM_STATE_LON_INT),
    )


# -- RADIO_STATUS -----------------------------------------------------------------------------------------------------

RADIO_STATUS = 109
RADIO_STATUS_LENGTH = 9
RADIO_STATUS_RSSI = 4  # uint8_t
RADIO_STATUS_REMRSSI = 5  # uint8_t
RADIO_STATUS_TXBUF = 6  # uint8_t [%]
RADIO_STATUS_NOISE = 7  # uint8_t
RADIO_STATUS_REMNOISE = 8  # uint8_t
RADIO_STATUS_RXERRORS = 0  # uint16_t
RADIO_STATUS_FIXED = 2  # uint16_t


@kernel
def encode_radio_status(
    payload: Bytes, rssi: int, remrssi: int, txbuf: int, noise: int, remnoise: int, rxerrors: int, fixed: int
) -> int:
    """Fills `payload` with a RADIO_STATUS; returns RADIO_STATUS_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + RADIO_STATUS_RSSI, rssi)
    put_u8(payload, zero + RADIO_STATUS_REMRSSI, remrssi)
    put_u8(payload, zero + RADIO_STATUS_TXBUF, txbuf)
    put_u8(payload, zero + RADIO_STATUS_NOISE, noise)
    put_u8(payload, zero + RADIO_STATUS_REMNOISE, remnoise)
    put_u16(payload, zero + RADIO_STATUS_RXERRORS, rxerrors)
    put_u16(payload, zero + RADIO_STATUS_FIXED, fixed)
    return RADIO_STATUS_LENGTH


@kernel
def decode_radio_status(payload: Bytes) -> tuple[int, int, int, int, int, int, int]:
    """Returns the scalar fields of a RADIO_STATUS: rssi, remrssi, txbuf, noise, remnoise, rxerrors, fixed."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + RADIO_STATUS_RSSI),
        get_u8(payload, zero + RADIO_STATUS_REMRSSI),
        get_u8(payload, zero + RADIO_STATUS_TXBUF),
        get_u8(payload, zero + RADIO_STATUS_NOISE),
        get_u8(payload, zero + RADIO_STATUS_REMNOISE),
        get_u16(payload, zero + RADIO_STATUS_RXERRORS),
        get_u16(payload, zero + RADIO_STATUS_FIXED),
    )


# -- FILE_TRANSFER_PROTOCOL -------------------------------------------------------------------------------------------

FILE_TRANSFER_PROTOCOL = 110
FILE_TRANSFER_PROTOCOL_LENGTH = 254
FILE_TRANSFER_PROTOCOL_TARGET_NETWORK = 0  # uint8_t
FILE_TRANSFER_PROTOCOL_TARGET_SYSTEM = 1  # uint8_t
FILE_TRANSFER_PROTOCOL_TARGET_COMPONENT = 2  # uint8_t
FILE_TRANSFER_PROTOCOL_PAYLOAD = 3  # uint8_t[251]


@kernel
def encode_file_transfer_protocol(
    payload: Bytes, target_network: int, target_system: int, target_component: int
) -> int:
    """Fills `payload` with a FILE_TRANSFER_PROTOCOL; returns FILE_TRANSFER_PROTOCOL_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + FILE_TRANSFER_PROTOCOL_TARGET_NETWORK, target_network)
    put_u8(payload, zero + FILE_TRANSFER_PROTOCOL_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + FILE_TRANSFER_PROTOCOL_TARGET_COMPONENT, target_component)
    clear(payload, zero + FILE_TRANSFER_PROTOCOL_PAYLOAD, zero + FILE_TRANSFER_PROTOCOL_PAYLOAD + 251)
    return FILE_TRANSFER_PROTOCOL_LENGTH


@kernel
def decode_file_transfer_protocol(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a FILE_TRANSFER_PROTOCOL: target_network, target_system, target_component."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + FILE_TRANSFER_PROTOCOL_TARGET_NETWORK),
        get_u8(payload, zero + FILE_TRANSFER_PROTOCOL_TARGET_SYSTEM),
        get_u8(payload, zero + FILE_TRANSFER_PROTOCOL_TARGET_COMPONENT),
    )


@kernel
def put_file_transfer_protocol_payload(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 250) of `payload`."""
    put_u8(payload, FILE_TRANSFER_PROTOCOL_PAYLOAD + i, value)


@kernel
def get_file_transfer_protocol_payload(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 250) of `payload`."""
    return get_u8(payload, FILE_TRANSFER_PROTOCOL_PAYLOAD + i)


# -- TIMESYNC ---------------------------------------------------------------------------------------------------------

TIMESYNC = 111
TIMESYNC_LENGTH = 16
TIMESYNC_TC1 = 0  # int64_t [ns]
TIMESYNC_TS1 = 8  # int64_t [ns]


@kernel
def encode_timesync(payload: Bytes, tc1: int, ts1: int) -> int:
    """Fills `payload` with a TIMESYNC; returns TIMESYNC_LENGTH."""
    zero = int(np.int64(0))
    put_i64(payload, zero + TIMESYNC_TC1, tc1)
    put_i64(payload, zero + TIMESYNC_TS1, ts1)
    return TIMESYNC_LENGTH


@kernel
def decode_timesync(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of a TIMESYNC: tc1, ts1."""
    zero = int(np.int64(0))
    return (
        get_i64(payload, zero + TIMESYNC_TC1),
        get_i64(payload, zero + TIMESYNC_TS1),
    )


# -- SCALED_IMU2 ------------------------------------------------------------------------------------------------------

SCALED_IMU2 = 116
SCALED_IMU2_LENGTH = 24
SCALED_IMU2_TIME_BOOT_MS = 0  # uint32_t [ms]
SCALED_IMU2_XACC = 4  # int16_t [mG]
SCALED_IMU2_YACC = 6  # int16_t [mG]
SCALED_IMU2_ZACC = 8  # int16_t [mG]
SCALED_IMU2_XGYRO = 10  # int16_t [mrad/s]
SCALED_IMU2_YGYRO = 12  # int16_t [mrad/s]
SCALED_IMU2_ZGYRO = 14  # int16_t [mrad/s]
SCALED_IMU2_XMAG = 16  # int16_t [mgauss]
SCALED_IMU2_YMAG = 18  # int16_t [mgauss]
SCALED_IMU2_ZMAG = 20  # int16_t [mgauss]
SCALED_IMU2_TEMPERATURE = 22  # int16_t [cdegC], extension


@kernel
def encode_scaled_imu2(
    payload: Bytes,
    time_boot_ms: int,
    xacc: int,
    yacc: int,
    zacc: int,
    xgyro: int,
    ygyro: int,
    zgyro: int,
    xmag: int,
    ymag: int,
    zmag: int,
    temperature: int,
) -> int:
    """Fills `payload` with a SCALED_IMU2; returns SCALED_IMU2_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SCALED_IMU2_TIME_BOOT_MS, time_boot_ms)
    put_i16(payload, zero + SCALED_IMU2_XACC, xacc)
    put_i16(payload, zero + SCALED_IMU2_YACC, yacc)
    put_i16(payload, zero + SCALED_IMU2_ZACC, zacc)
    put_i16(payload, zero + SCALED_IMU2_XGYRO, xgyro)
    put_i16(payload, zero + SCALED_IMU2_YGYRO, ygyro)
    put_i16(payload, zero + SCALED_IMU2_ZGYRO, zgyro)
    put_i16(payload, zero + SCALED_IMU2_XMAG, xmag)
    put_i16(payload, zero + SCALED_IMU2_YMAG, ymag)
    put_i16(payload, zero + SCALED_IMU2_ZMAG, zmag)
    put_i16(payload, zero + SCALED_IMU2_TEMPERATURE, temperature)
    return SCALED_IMU2_LENGTH


@kernel
def decode_scaled_imu2(payload: Bytes) -> tuple[int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a SCALED_IMU2.

    time_boot_ms, xacc, yacc, zacc, xgyro, ygyro, zgyro, xmag, ymag, zmag, temperature.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SCALED_IMU2_TIME_BOOT_MS),
        get_i16(payload, zero + SCALED_IMU2_XACC),
        get_i16(payload, zero + SCALED_IMU2_YACC),
        get_i16(payload, zero + SCALED_IMU2_ZACC),
        get_i16(payload, zero + SCALED_IMU2_XGYRO),
        get_i16(payload, zero + SCALED_IMU2_YGYRO),
        get_i16(payload, zero + SCALED_IMU2_ZGYRO),
        get_i16(payload, zero + SCALED_IMU2_XMAG),
        get_i16(payload, zero + SCALED_IMU2_YMAG),
        get_i16(payload, zero + SCALED_IMU2_ZMAG),
        get_i16(payload, zero + SCALED_IMU2_TEMPERATURE),
    )


# -- LOG_REQUEST_LIST -------------------------------------------------------------------------------------------------

LOG_REQUEST_LIST = 117
LOG_REQUEST_LIST_LENGTH = 6
LOG_REQUEST_LIST_TARGET_SYSTEM = 4  # uint8_t
LOG_REQUEST_LIST_TARGET_COMPONENT = 5  # uint8_t
LOG_REQUEST_LIST_START = 0  # uint16_t
LOG_REQUEST_LIST_END = 2  # uint16_t


@kernel
def encode_log_request_list(payload: Bytes, target_system: int, target_component: int, start: int, end: int) -> int:
    """Fills `payload` with a LOG_REQUEST_LIST; returns LOG_REQUEST_LIST_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + LOG_REQUEST_LIST_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + LOG_REQUEST_LIST_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + LOG_REQUEST_LIST_START, start)
    put_u16(payload, zero + LOG_REQUEST_LIST_END, end)
    return LOG_REQUEST_LIST_LENGTH


@kernel
def decode_log_request_list(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a LOG_REQUEST_LIST: target_system, target_component, start, end."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + LOG_REQUEST_LIST_TARGET_SYSTEM),
        get_u8(payload, zero + LOG_REQUEST_LIST_TARGET_COMPONENT),
        get_u16(payload, zero + LOG_REQUEST_LIST_START),
        get_u16(payload, zero + LOG_REQUEST_LIST_END),
    )


# -- LOG_ENTRY --------------------------------------------------------------------------------------------------------

LOG_ENTRY = 118
LOG_ENTRY_LENGTH = 14
LOG_ENTRY_ID = 8  # uint16_t
LOG_ENTRY_NUM_LOGS = 10  # uint16_t
LOG_ENTRY_LAST_LOG_NUM = 12  # uint16_t
LOG_ENTRY_TIME_UTC = 0  # uint32_t [s]
LOG_ENTRY_SIZE = 4  # uint32_t [bytes]


@kernel
def encode_log_entry(payload: Bytes, id_: int, num_logs: int, last_log_num: int, time_utc: int, size: int) -> int:
    """Fills `payload` with a LOG_ENTRY; returns LOG_ENTRY_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + LOG_ENTRY_ID, id_)
    put_u16(payload, zero + LOG_ENTRY_NUM_LOGS, num_logs)
    put_u16(payload, zero + LOG_ENTRY_LAST_LOG_NUM, last_log_num)
    put_u32(payload, zero + LOG_ENTRY_TIME_UTC, time_utc)
    put_u32(payload, zero + LOG_ENTRY_SIZE, size)
    return LOG_ENTRY_LENGTH


@kernel
def decode_log_entry(payload: Bytes) -> tuple[int, int, int, int, int]:
    """Returns the scalar fields of a LOG_ENTRY: id, num_logs, last_log_num, time_utc, size."""
    zero = int(np.int64(0))
    return (
        get_u16(payload, zero + LOG_ENTRY_ID),
        get_u16(payload, zero + LOG_ENTRY_NUM_LOGS),
        get_u16(payload, zero + LOG_ENTRY_LAST_LOG_NUM),
        get_u32(payload, zero + LOG_ENTRY_TIME_UTC),
        get_u32(payload, zero + LOG_ENTRY_SIZE),
    )


# -- LOG_REQUEST_DATA -------------------------------------------------------------------------------------------------

LOG_REQUEST_DATA = 119
LOG_REQUEST_DATA_LENGTH = 12
LOG_REQUEST_DATA_TARGET_SYSTEM = 10  # uint8_t
LOG_REQUEST_DATA_TARGET_COMPONENT = 11  # uint8_t
LOG_REQUEST_DATA_ID = 8  # uint16_t
LOG_REQUEST_DATA_OFS = 0  # uint32_t
LOG_REQUEST_DATA_COUNT = 4  # uint32_t [bytes]


@kernel
def encode_log_request_data(
    payload: Bytes, target_system: int, target_component: int, id_: int, ofs: int, count: int
) -> int:
    """Fills `payload` with a LOG_REQUEST_DATA; returns LOG_REQUEST_DATA_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + LOG_REQUEST_DATA_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + LOG_REQUEST_DATA_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + LOG_REQUEST_DATA_ID, id_)
    put_u32(payload, zero + LOG_REQUEST_DATA_OFS, ofs)
    put_u32(payload, zero + LOG_REQUEST_DATA_COUNT, count)
    return LOG_REQUEST_DATA_LENGTH


@kernel
def decode_log_request_data(payload: Bytes) -> tuple[int, int, int, int, int]:
    """Returns the scalar fields of a LOG_REQUEST_DATA: target_system, target_component, id, ofs, count."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + LOG_REQUEST_DATA_TARGET_SYSTEM),
        get_u8(payload, zero + LOG_REQUEST_DATA_TARGET_COMPONENT),
        get_u16(payload, zero + LOG_REQUEST_DATA_ID),
        get_u32(payload, zero + LOG_REQUEST_DATA_OFS),
        get_u32(payload, zero + LOG_REQUEST_DATA_COUNT),
    )


# -- LOG_DATA ---------------------------------------------------------------------------------------------------------

LOG_DATA = 120
LOG_DATA_LENGTH = 97
LOG_DATA_ID = 4  # uint16_t
LOG_DATA_OFS = 0  # uint32_t
LOG_DATA_COUNT = 6  # uint8_t [bytes]
LOG_DATA_DATA = 7  # uint8_t[90]


@kernel
def encode_log_data(payload: Bytes, id_: int, ofs: int, count: int) -> int:
    """Fills `payload` with a LOG_DATA; returns LOG_DATA_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + LOG_DATA_ID, id_)
    put_u32(payload, zero + LOG_DATA_OFS, ofs)
    put_u8(payload, zero + LOG_DATA_COUNT, count)
    clear(payload, zero + LOG_DATA_DATA, zero + LOG_DATA_DATA + 90)
    return LOG_DATA_LENGTH


@kernel
def decode_log_data(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a LOG_DATA: id, ofs, count."""
    zero = int(np.int64(0))
    return (
        get_u16(payload, zero + LOG_DATA_ID),
        get_u32(payload, zero + LOG_DATA_OFS),
        get_u8(payload, zero + LOG_DATA_COUNT),
    )


@kernel
def put_log_data_data(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 89) of `data`."""
    put_u8(payload, LOG_DATA_DATA + i, value)


@kernel
def get_log_data_data(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 89) of `data`."""
    return get_u8(payload, LOG_DATA_DATA + i)


# -- LOG_ERASE --------------------------------------------------------------------------------------------------------

LOG_ERASE = 121
LOG_ERASE_LENGTH = 2
LOG_ERASE_TARGET_SYSTEM = 0  # uint8_t
LOG_ERASE_TARGET_COMPONENT = 1  # uint8_t


@kernel
def encode_log_erase(payload: Bytes, target_system: int, target_component: int) -> int:
    """Fills `payload` with a LOG_ERASE; returns LOG_ERASE_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + LOG_ERASE_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + LOG_ERASE_TARGET_COMPONENT, target_component)
    return LOG_ERASE_LENGTH


@kernel
def decode_log_erase(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of a LOG_ERASE: target_system, target_component."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + LOG_ERASE_TARGET_SYSTEM),
        get_u8(payload, zero + LOG_ERASE_TARGET_COMPONENT),
    )


# -- LOG_REQUEST_END --------------------------------------------------------------------------------------------------

LOG_REQUEST_END = 122
LOG_REQUEST_END_LENGTH = 2
LOG_REQUEST_END_TARGET_SYSTEM = 0  # uint8_t
LOG_REQUEST_END_TARGET_COMPONENT = 1  # uint8_t


@kernel
def encode_log_request_end(payload: Bytes, target_system: int, target_component: int) -> int:
    """Fills `payload` with a LOG_REQUEST_END; returns LOG_REQUEST_END_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + LOG_REQUEST_END_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + LOG_REQUEST_END_TARGET_COMPONENT, target_component)
    return LOG_REQUEST_END_LENGTH


@kernel
def decode_log_request_end(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of a LOG_REQUEST_END: target_system, target_component."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + LOG_REQUEST_END_TARGET_SYSTEM),
        get_u8(payload, zero + LOG_REQUEST_END_TARGET_COMPONENT),
    )


# -- POWER_STATUS -----------------------------------------------------------------------------------------------------

POWER_STATUS = 125
POWER_STATUS_LENGTH = 6
POWER_STATUS_VCC = 0  # uint16_t [mV]
POWER_STATUS_VSERVO = 2  # uint16_t [mV]
POWER_STATUS_FLAGS = 4  # uint16_t


@kernel
def encode_power_status(payload: Bytes, Vcc: int, Vservo: int, flags: int) -> int:
    """Fills `payload` with a POWER_STATUS; returns POWER_STATUS_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + POWER_STATUS_VCC, Vcc)
    put_u16(payload, zero + POWER_STATUS_VSERVO, Vservo)
    put_u16(payload, zero + POWER_STATUS_FLAGS, flags)
    return POWER_STATUS_LENGTH


@kernel
def decode_power_status(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a POWER_STATUS: Vcc, Vservo, flags."""
    zero = int(np.int64(0))
    return (
        get_u16(payload, zero + POWER_STATUS_VCC),
        get_u16(payload, zero + POWER_STATUS_VSERVO),
        get_u16(payload, zero + POWER_STATUS_FLAGS),
    )


# -- SCALED_IMU3 ------------------------------------------------------------------------------------------------------

SCALED_IMU3 = 129
SCALED_IMU3_LENGTH = 24
SCALED_IMU3_TIME_BOOT_MS = 0  # uint32_t [ms]
SCALED_IMU3_XACC = 4  # int16_t [mG]
SCALED_IMU3_YACC = 6  # int16_t [mG]
SCALED_IMU3_ZACC = 8  # int16_t [mG]
SCALED_IMU3_XGYRO = 10  # int16_t [mrad/s]
SCALED_IMU3_YGYRO = 12  # int16_t [mrad/s]
SCALED_IMU3_ZGYRO = 14  # int16_t [mrad/s]
SCALED_IMU3_XMAG = 16  # int16_t [mgauss]
SCALED_IMU3_YMAG = 18  # int16_t [mgauss]
SCALED_IMU3_ZMAG = 20  # int16_t [mgauss]
SCALED_IMU3_TEMPERATURE = 22  # int16_t [cdegC], extension


@kernel
def encode_scaled_imu3(
    payload: Bytes,
    time_boot_ms: int,
    xacc: int,
    yacc: int,
    zacc: int,
    xgyro: int,
    ygyro: int,
    zgyro: int,
    xmag: int,
    ymag: int,
    zmag: int,
    temperature: int,
) -> int:
    """Fills `payload` with a SCALED_IMU3; returns SCALED_IMU3_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SCALED_IMU3_TIME_BOOT_MS, time_boot_ms)
    put_i16(payload, zero + SCALED_IMU3_XACC, xacc)
    put_i16(payload, zero + SCALED_IMU3_YACC, yacc)
    put_i16(payload, zero + SCALED_IMU3_ZACC, zacc)
    put_i16(payload, zero + SCALED_IMU3_XGYRO, xgyro)
    put_i16(payload, zero + SCALED_IMU3_YGYRO, ygyro)
    put_i16(payload, zero + SCALED_IMU3_ZGYRO, zgyro)
    put_i16(payload, zero + SCALED_IMU3_XMAG, xmag)
    put_i16(payload, zero + SCALED_IMU3_YMAG, ymag)
    put_i16(payload, zero + SCALED_IMU3_ZMAG, zmag)
    put_i16(payload, zero + SCALED_IMU3_TEMPERATURE, temperature)
    return SCALED_IMU3_LENGTH


@kernel
def decode_scaled_imu3(payload: Bytes) -> tuple[int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a SCALED_IMU3.

    time_boot_ms, xacc, yacc, zacc, xgyro, ygyro, zgyro, xmag, ymag, zmag, temperature.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SCALED_IMU3_TIME_BOOT_MS),
        get_i16(payload, zero + SCALED_IMU3_XACC),
        get_i16(payload, zero + SCALED_IMU3_YACC),
        get_i16(payload, zero + SCALED_IMU3_ZACC),
        get_i16(payload, zero + SCALED_IMU3_XGYRO),
        get_i16(payload, zero + SCALED_IMU3_YGYRO),
        get_i16(payload, zero + SCALED_IMU3_ZGYRO),
        get_i16(payload, zero + SCALED_IMU3_XMAG),
        get_i16(payload, zero + SCALED_IMU3_YMAG),
        get_i16(payload, zero + SCALED_IMU3_ZMAG),
        get_i16(payload, zero + SCALED_IMU3_TEMPERATURE),
    )


# -- DISTANCE_SENSOR --------------------------------------------------------------------------------------------------

DISTANCE_SENSOR = 132
DISTANCE_SENSOR_LENGTH = 39
DISTANCE_SENSOR_TIME_BOOT_MS = 0  # uint32_t [ms]
DISTANCE_SENSOR_MIN_DISTANCE = 4  # uint16_t [cm]
DISTANCE_SENSOR_MAX_DISTANCE = 6  # uint16_t [cm]
DISTANCE_SENSOR_CURRENT_DISTANCE = 8  # uint16_t [cm]
DISTANCE_SENSOR_TYPE = 10  # uint8_t
DISTANCE_SENSOR_ID = 11  # uint8_t
DISTANCE_SENSOR_ORIENTATION = 12  # uint8_t
DISTANCE_SENSOR_COVARIANCE = 13  # uint8_t [cm^2]
DISTANCE_SENSOR_HORIZONTAL_FOV = 14  # float [rad], extension
DISTANCE_SENSOR_VERTICAL_FOV = 18  # float [rad], extension
DISTANCE_SENSOR_QUATERNION = 22  # float[4], extension
DISTANCE_SENSOR_SIGNAL_QUALITY = 38  # uint8_t [%], extension


@kernel
def encode_distance_sensor(
    payload: Bytes,
    time_boot_ms: int,
    min_distance: int,
    max_distance: int,
    current_distance: int,
    type_: int,
    id_: int,
    orientation: int,
    covariance: int,
    horizontal_fov: float,
    vertical_fov: float,
    signal_quality: int,
) -> int:
    """Fills `payload` with a DISTANCE_SENSOR; returns DISTANCE_SENSOR_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + DISTANCE_SENSOR_TIME_BOOT_MS, time_boot_ms)
    put_u16(payload, zero + DISTANCE_SENSOR_MIN_DISTANCE, min_distance)
    put_u16(payload, zero + DISTANCE_SENSOR_MAX_DISTANCE, max_distance)
    put_u16(payload, zero + DISTANCE_SENSOR_CURRENT_DISTANCE, current_distance)
    put_u8(payload, zero + DISTANCE_SENSOR_TYPE, type_)
    put_u8(payload, zero + DISTANCE_SENSOR_ID, id_)
    put_u8(payload, zero + DISTANCE_SENSOR_ORIENTATION, orientation)
    put_u8(payload, zero + DISTANCE_SENSOR_COVARIANCE, covariance)
    put_f32(payload, zero + DISTANCE_SENSOR_HORIZONTAL_FOV, horizontal_fov)
    put_f32(payload, zero + DISTANCE_SENSOR_VERTICAL_FOV, vertical_fov)
    clear(payload, zero + DISTANCE_SENSOR_QUATERNION, zero + DISTANCE_SENSOR_QUATERNION + 16)
    put_u8(payload, zero + DISTANCE_SENSOR_SIGNAL_QUALITY, signal_quality)
    return DISTANCE_SENSOR_LENGTH


@kernel
def decode_distance_sensor(payload: Bytes) -> tuple[int, int, int, int, int, int, int, int, float, float, int]:
    """Returns the scalar fields of a DISTANCE_SENSOR.

    time_boot_ms, min_distance, max_distance, current_distance, type, id, orientation, covariance, horizontal_fov,
    vertical_fov, signal_quality.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + DISTANCE_SENSOR_TIME_BOOT_MS),
        get_u16(payload, zero + DISTANCE_SENSOR_MIN_DISTANCE),
        get_u16(payload, zero + DISTANCE_SENSOR_MAX_DISTANCE),
        get_u16(payload, zero + DISTANCE_SENSOR_CURRENT_DISTANCE),
        get_u8(payload, zero + DISTANCE_SENSOR_TYPE),
        get_u8(payload, zero + DISTANCE_SENSOR_ID),
        get_u8(payload, zero + DISTANCE_SENSOR_ORIENTATION),
        get_u8(payload, zero + DISTANCE_SENSOR_COVARIANCE),
        get_f32(payload, zero + DISTANCE_SENSOR_HORIZONTAL_FOV),
        get_f32(payload, zero + DISTANCE_SENSOR_VERTICAL_FOV),
        get_u8(payload, zero + DISTANCE_SENSOR_SIGNAL_QUALITY),
    )


@kernel
def put_distance_sensor_quaternion(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 3) of `quaternion`."""
    put_f32(payload, DISTANCE_SENSOR_QUATERNION + 4 * i, value)


@kernel
def get_distance_sensor_quaternion(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 3) of `quaternion`."""
    return get_f32(payload, DISTANCE_SENSOR_QUATERNION + 4 * i)


# -- TERRAIN_CHECK ----------------------------------------------------------------------------------------------------

TERRAIN_CHECK = 135
TERRAIN_CHECK_LENGTH = 8
TERRAIN_CHECK_LAT = 0  # int32_t [degE7]
TERRAIN_CHECK_LON = 4  # int32_t [degE7]


@kernel
def encode_terrain_check(payload: Bytes, lat: int, lon: int) -> int:
    """Fills `payload` with a TERRAIN_CHECK; returns TERRAIN_CHECK_LENGTH."""
    zero = int(np.int64(0))
    put_i32(payload, zero + TERRAIN_CHECK_LAT, lat)
    put_i32(payload, zero + TERRAIN_CHECK_LON, lon)
    return TERRAIN_CHECK_LENGTH


@kernel
def decode_terrain_check(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of a TERRAIN_CHECK: lat, lon."""
    zero = int(np.int64(0))
    return (
        get_i32(payload, zero + TERRAIN_CHECK_LAT),
        get_i32(payload, zero + TERRAIN_CHECK_LON),
    )


# -- TERRAIN_REPORT ---------------------------------------------------------------------------------------------------

TERRAIN_REPORT = 136
TERRAIN_REPORT_LENGTH = 22
TERRAIN_REPORT_LAT = 0  # int32_t [degE7]
TERRAIN_REPORT_LON = 4  # int32_t [degE7]
TERRAIN_REPORT_SPACING = 16  # uint16_t
TERRAIN_REPORT_TERRAIN_HEIGHT = 8  # float [m]
TERRAIN_REPORT_CURRENT_HEIGHT = 12  # float [m]
TERRAIN_REPORT_PENDING = 18  # uint16_t
TERRAIN_REPORT_LOADED = 20  # uint16_t


@kernel
def encode_terrain_report(
    payload: Bytes,
    lat: int,
    lon: int,
    spacing: int,
    terrain_height: float,
    current_height: float,
    pending: int,
    loaded: int,
) -> int:
    """Fills `payload` with a TERRAIN_REPORT; returns TERRAIN_REPORT_LENGTH."""
    zero = int(np.int64(0))
    put_i32(payload, zero + TERRAIN_REPORT_LAT, lat)
    put_i32(payload, zero + TERRAIN_REPORT_LON, lon)
    put_u16(payload, zero + TERRAIN_REPORT_SPACING, spacing)
    put_f32(payload, zero + TERRAIN_REPORT_TERRAIN_HEIGHT, terrain_height)
    put_f32(payload, zero + TERRAIN_REPORT_CURRENT_HEIGHT, current_height)
    put_u16(payload, zero + TERRAIN_REPORT_PENDING, pending)
    put_u16(payload, zero + TERRAIN_REPORT_LOADED, loaded)
    return TERRAIN_REPORT_LENGTH


@kernel
def decode_terrain_report(payload: Bytes) -> tuple[int, int, int, float, float, int, int]:
    """Returns the scalar fields of a TERRAIN_REPORT.

    lat, lon, spacing, terrain_height, current_height, pending, loaded.
    """
    zero = int(np.int64(0))
    return (
        get_i32(payload, zero + TERRAIN_REPORT_LAT),
        get_i32(payload, zero + TERRAIN_REPORT_LON),
        get_u16(payload, zero + TERRAIN_REPORT_SPACING),
        get_f32(payload, zero + TERRAIN_REPORT_TERRAIN_HEIGHT),
        get_f32(payload, zero + TERRAIN_REPORT_CURRENT_HEIGHT),
        get_u16(payload, zero + TERRAIN_REPORT_PENDING),
        get_u16(payload, zero + TERRAIN_REPORT_LOADED),
    )


# -- SCALED_PRESSURE2 -------------------------------------------------------------------------------------------------

SCALED_PRESSURE2 = 137
SCALED_PRESSURE2_LENGTH = 16
SCALED_PRESSURE2_TIME_BOOT_MS = 0  # uint32_t [ms]
SCALED_PRESSURE2_PRESS_ABS = 4  # float [hPa]
SCALED_PRESSURE2_PRESS_DIFF = 8  # float [hPa]
SCALED_PRESSURE2_TEMPERATURE = 12  # int16_t [cdegC]
SCALED_PRESSURE2_TEMPERATURE_PRESS_DIFF = 14  # int16_t [cdegC], extension


@kernel
def encode_scaled_pressure2(
    payload: Bytes,
    time_boot_ms: int,
    press_abs: float,
    press_diff: float,
    temperature: int,
    temperature_press_diff: int,
) -> int:
    """Fills `payload` with a SCALED_PRESSURE2; returns SCALED_PRESSURE2_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + SCALED_PRESSURE2_TIME_BOOT_MS, time_boot_ms)
    put_f32(payload, zero + SCALED_PRESSURE2_PRESS_ABS, press_abs)
    put_f32(payload, zero + SCALED_PRESSURE2_PRESS_DIFF, press_diff)
    put_i16(payload, zero + SCALED_PRESSURE2_TEMPERATURE, temperature)
    put_i16(payload, zero + SCALED_PRESSURE2_TEMPERATURE_PRESS_DIFF, temperature_press_diff)
    return SCALED_PRESSURE2_LENGTH


@kernel
def decode_scaled_pressure2(payload: Bytes) -> tuple[int, float, float, int, int]:
    """Returns the scalar fields of a SCALED_PRESSURE2.

    time_boot_ms, press_abs, press_diff, temperature, temperature_press_diff.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + SCALED_PRESSURE2_TIME_BOOT_MS),
        get_f32(payload, zero + SCALED_PRESSURE2_PRESS_ABS),
        get_f32(payload, zero + SCALED_PRESSURE2_PRESS_DIFF),
        get_i16(payload, zero + SCALED_PRESSURE2_TEMPERATURE),
        get_i16(payload, zero + SCALED_PRESSURE2_TEMPERATURE_PRESS_DIFF),
    )


# -- FOLLOW_TARGET ----------------------------------------------------------------------------------------------------

FOLLOW_TARGET = 144
FOLLOW_TARGET_LENGTH = 93
FOLLOW_TARGET_TIMESTAMP = 0  # uint64_t [ms]
FOLLOW_TARGET_EST_CAPABILITIES = 92  # uint8_t
FOLLOW_TARGET_LAT = 16  # int32_t [degE7]
FOLLOW_TARGET_LON = 20  # int32_t [degE7]
FOLLOW_TARGET_ALT = 24  # float [m]
FOLLOW_TARGET_VEL = 28  # float[3] [m/s]
FOLLOW_TARGET_ACC = 40  # float[3] [m/s/s]
FOLLOW_TARGET_ATTITUDE_Q = 52  # float[4]
FOLLOW_TARGET_RATES = 68  # float[3]
FOLLOW_TARGET_POSITION_COV = 80  # float[3]
FOLLOW_TARGET_CUSTOM_STATE = 8  # uint64_t


@kernel
def encode_follow_target(
    payload: Bytes, timestamp: int, est_capabilities: int, lat: int, lon: int, alt: float, custom_state: int
) -> int:
    """Fills `payload` with a FOLLOW_TARGET; returns FOLLOW_TARGET_LENGTH."""
    zero = int(np.int64(0))
    put_u64(payload, zero + FOLLOW_TARGET_TIMESTAMP, timestamp)
    put_u8(payload, zero + FOLLOW_TARGET_EST_CAPABILITIES, est_capabilities)
    put_i32(payload, zero + FOLLOW_TARGET_LAT, lat)
    put_i32(payload, zero + FOLLOW_TARGET_LON, lon)
    put_f32(payload, zero + FOLLOW_TARGET_ALT, alt)
    clear(payload, zero + FOLLOW_TARGET_VEL, zero + FOLLOW_TARGET_VEL + 12)
    clear(payload, zero + FOLLOW_TARGET_ACC, zero + FOLLOW_TARGET_ACC + 12)
    clear(payload, zero + FOLLOW_TARGET_ATTITUDE_Q, zero + FOLLOW_TARGET_ATTITUDE_Q + 16)
    clear(payload, zero + FOLLOW_TARGET_RATES, zero + FOLLOW_TARGET_RATES + 12)
    clear(payload, zero + FOLLOW_TARGET_POSITION_COV, zero + FOLLOW_TARGET_POSITION_COV + 12)
    put_u64(payload, zero + FOLLOW_TARGET_CUSTOM_STATE, custom_state)
    return FOLLOW_TARGET_LENGTH


@kernel
def decode_follow_target(payload: Bytes) -> tuple[int, int, int, int, float, int]:
    """Returns the scalar fields of a FOLLOW_TARGET: timestamp, est_capabilities, lat, lon, alt, custom_state."""
    zero = int(np.int64(0))
    return (
        get_u64(payload, zero + FOLLOW_TARGET_TIMESTAMP),
        get_u8(payload, zero + FOLLOW_TARGET_EST_CAPABILITIES),
        get_i32(payload, zero + FOLLOW_TARGET_LAT),
        get_i32(payload, zero + FOLLOW_TARGET_LON),
        get_f32(payload, zero + FOLLOW_TARGET_ALT),
        get_u64(payload, zero + FOLLOW_TARGET_CUSTOM_STATE),
    )


@kernel
def put_follow_target_vel(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 2) of `vel`."""
    put_f32(payload, FOLLOW_TARGET_VEL + 4 * i, value)


@kernel
def get_follow_target_vel(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 2) of `vel`."""
    return get_f32(payload, FOLLOW_TARGET_VEL + 4 * i)


@kernel
def put_follow_target_acc(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 2) of `acc`."""
    put_f32(payload, FOLLOW_TARGET_ACC + 4 * i, value)


@kernel
def get_follow_target_acc(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 2) of `acc`."""
    return get_f32(payload, FOLLOW_TARGET_ACC + 4 * i)


@kernel
def put_follow_target_attitude_q(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 3) of `attitude_q`."""
    put_f32(payload, FOLLOW_TARGET_ATTITUDE_Q + 4 * i, value)


@kernel
def get_follow_target_attitude_q(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 3) of `attitude_q`."""
    return get_f32(payload, FOLLOW_TARGET_ATTITUDE_Q + 4 * i)


@kernel
def put_follow_target_rates(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 2) of `rates`."""
    put_f32(payload, FOLLOW_TARGET_RATES + 4 * i, value)


@kernel
def get_follow_target_rates(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 2) of `rates`."""
    return get_f32(payload, FOLLOW_TARGET_RATES + 4 * i)


@kernel
def put_follow_target_position_cov(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 2) of `position_cov`."""
    put_f32(payload, FOLLOW_TARGET_POSITION_COV + 4 * i, value)


@kernel
def get_follow_target_position_cov(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 2) of `position_cov`."""
    return get_f32(payload, FOLLOW_TARGET_POSITION_COV + 4 * i)


# -- BATTERY_STATUS ---------------------------------------------------------------------------------------------------

BATTERY_STATUS = 147
BATTERY_STATUS_LENGTH = 54
BATTERY_STATUS_ID = 32  # uint8_t
BATTERY_STATUS_BATTERY_FUNCTION = 33  # uint8_t
BATTERY_STATUS_TYPE = 34  # uint8_t
BATTERY_STATUS_TEMPERATURE = 8  # int16_t [cdegC]
BATTERY_STATUS_VOLTAGES = 10  # uint16_t[10] [mV]
BATTERY_STATUS_CURRENT_BATTERY = 30  # int16_t [cA]
BATTERY_STATUS_CURRENT_CONSUMED = 0  # int32_t [mAh]
BATTERY_STATUS_ENERGY_CONSUMED = 4  # int32_t [hJ]
BATTERY_STATUS_BATTERY_REMAINING = 35  # int8_t [%]
BATTERY_STATUS_TIME_REMAINING = 36  # int32_t [s], extension
BATTERY_STATUS_CHARGE_STATE = 40  # uint8_t, extension
BATTERY_STATUS_VOLTAGES_EXT = 41  # uint16_t[4] [mV], extension
BATTERY_STATUS_MODE = 49  # uint8_t, extension
BATTERY_STATUS_FAULT_BITMASK = 50  # uint32_t, extension


@kernel
def encode_battery_status(
    payload: Bytes,
    id_: int,
    battery_function: int,
    type_: int,
    temperature: int,
    current_battery: int,
    current_consumed: int,
    energy_consumed: int,
    battery_remaining: int,
    time_remaining: int,
    charge_state: int,
    mode: int,
    fault_bitmask: int,
) -> int:
    """Fills `payload` with a BATTERY_STATUS; returns BATTERY_STATUS_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + BATTERY_STATUS_ID, id_)
    put_u8(payload, zero + BATTERY_STATUS_BATTERY_FUNCTION, battery_function)
    put_u8(payload, zero + BATTERY_STATUS_TYPE, type_)
    put_i16(payload, zero + BATTERY_STATUS_TEMPERATURE, temperature)
    clear(payload, zero + BATTERY_STATUS_VOLTAGES, zero + BATTERY_STATUS_VOLTAGES + 20)
    put_i16(payload, zero + BATTERY_STATUS_CURRENT_BATTERY, current_battery)
    put_i32(payload, zero + BATTERY_STATUS_CURRENT_CONSUMED, current_consumed)
    put_i32(payload, zero + BATTERY_STATUS_ENERGY_CONSUMED, energy_consumed)
    put_i8(payload, zero + BATTERY_STATUS_BATTERY_REMAINING, battery_remaining)
    put_i32(payload, zero + BATTERY_STATUS_TIME_REMAINING, time_remaining)
    put_u8(payload, zero + BATTERY_STATUS_CHARGE_STATE, charge_state)
    clear(payload, zero + BATTERY_STATUS_VOLTAGES_EXT, zero + BATTERY_STATUS_VOLTAGES_EXT + 8)
    put_u8(payload, zero + BATTERY_STATUS_MODE, mode)
    put_u32(payload, zero + BATTERY_STATUS_FAULT_BITMASK, fault_bitmask)
    return BATTERY_STATUS_LENGTH


@kernel
def decode_battery_status(payload: Bytes) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of a BATTERY_STATUS.

    id, battery_function, type, temperature, current_battery, current_consumed, energy_consumed, battery_remaining,
    time_remaining, charge_state, mode, fault_bitmask.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + BATTERY_STATUS_ID),
        get_u8(payload, zero + BATTERY_STATUS_BATTERY_FUNCTION),
        get_u8(payload, zero + BATTERY_STATUS_TYPE),
        get_i16(payload, zero + BATTERY_STATUS_TEMPERATURE),
        get_i16(payload, zero + BATTERY_STATUS_CURRENT_BATTERY),
        get_i32(payload, zero + BATTERY_STATUS_CURRENT_CONSUMED),
        get_i32(payload, zero + BATTERY_STATUS_ENERGY_CONSUMED),
        get_i8(payload, zero + BATTERY_STATUS_BATTERY_REMAINING),
        get_i32(payload, zero + BATTERY_STATUS_TIME_REMAINING),
        get_u8(payload, zero + BATTERY_STATUS_CHARGE_STATE),
        get_u8(payload, zero + BATTERY_STATUS_MODE),
        get_u32(payload, zero + BATTERY_STATUS_FAULT_BITMASK),
    )


@kernel
def put_battery_status_voltages(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 9) of `voltages`."""
    put_u16(payload, BATTERY_STATUS_VOLTAGES + 2 * i, value)


@kernel
def get_battery_status_voltages(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 9) of `voltages`."""
    return get_u16(payload, BATTERY_STATUS_VOLTAGES + 2 * i)


@kernel
def put_battery_status_voltages_ext(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 3) of `voltages_ext`."""
    put_u16(payload, BATTERY_STATUS_VOLTAGES_EXT + 2 * i, value)


@kernel
def get_battery_status_voltages_ext(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 3) of `voltages_ext`."""
    return get_u16(payload, BATTERY_STATUS_VOLTAGES_EXT + 2 * i)


# -- AUTOPILOT_VERSION ------------------------------------------------------------------------------------------------

AUTOPILOT_VERSION = 148
AUTOPILOT_VERSION_LENGTH = 78
AUTOPILOT_VERSION_CAPABILITIES = 0  # uint64_t
AUTOPILOT_VERSION_FLIGHT_SW_VERSION = 16  # uint32_t
AUTOPILOT_VERSION_MIDDLEWARE_SW_VERSION = 20  # uint32_t
AUTOPILOT_VERSION_OS_SW_VERSION = 24  # uint32_t
AUTOPILOT_VERSION_BOARD_VERSION = 28  # uint32_t
AUTOPILOT_VERSION_FLIGHT_CUSTOM_VERSION = 36  # uint8_t[8]
AUTOPILOT_VERSION_MIDDLEWARE_CUSTOM_VERSION = 44  # uint8_t[8]
AUTOPILOT_VERSION_OS_CUSTOM_VERSION = 52  # uint8_t[8]
AUTOPILOT_VERSION_VENDOR_ID = 32  # uint16_t
AUTOPILOT_VERSION_PRODUCT_ID = 34  # uint16_t
AUTOPILOT_VERSION_UID = 8  # uint64_t
AUTOPILOT_VERSION_UID2 = 60  # uint8_t[18], extension


@kernel
def encode_autopilot_version(
    payload: Bytes,
    capabilities: int,
    flight_sw_version: int,
    middleware_sw_version: int,
    os_sw_version: int,
    board_version: int,
    vendor_id: int,
    product_id: int,
    uid: int,
) -> int:
    """Fills `payload` with an AUTOPILOT_VERSION; returns AUTOPILOT_VERSION_LENGTH."""
    zero = int(np.int64(0))
    put_u64(payload, zero + AUTOPILOT_VERSION_CAPABILITIES, capabilities)
    put_u32(payload, zero + AUTOPILOT_VERSION_FLIGHT_SW_VERSION, flight_sw_version)
    put_u32(payload, zero + AUTOPILOT_VERSION_MIDDLEWARE_SW_VERSION, middleware_sw_version)
    put_u32(payload, zero + AUTOPILOT_VERSION_OS_SW_VERSION, os_sw_version)
    put_u32(payload, zero + AUTOPILOT_VERSION_BOARD_VERSION, board_version)
    clear(payload, zero + AUTOPILOT_VERSION_FLIGHT_CUSTOM_VERSION, zero + AUTOPILOT_VERSION_FLIGHT_CUSTOM_VERSION + 8)
    clear(
        payload,
        zero + AUTOPILOT_VERSION_MIDDLEWARE_CUSTOM_VERSION,
        zero + AUTOPILOT_VERSION_MIDDLEWARE_CUSTOM_VERSION + 8,
    )
    clear(payload, zero + AUTOPILOT_VERSION_OS_CUSTOM_VERSION, zero + AUTOPILOT_VERSION_OS_CUSTOM_VERSION + 8)
    put_u16(payload, zero + AUTOPILOT_VERSION_VENDOR_ID, vendor_id)
    put_u16(payload, zero + AUTOPILOT_VERSION_PRODUCT_ID, product_id)
    put_u64(payload, zero + AUTOPILOT_VERSION_UID, uid)
    clear(payload, zero + AUTOPILOT_VERSION_UID2, zero + AUTOPILOT_VERSION_UID2 + 18)
    return AUTOPILOT_VERSION_LENGTH


@kernel
def decode_autopilot_version(payload: Bytes) -> tuple[int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of an AUTOPILOT_VERSION.

    capabilities, flight_sw_version, middleware_sw_version, os_sw_version, board_version, vendor_id, product_id, uid.
    """
    zero = int(np.int64(0))
    return (
        get_u64(payload, zero + AUTOPILOT_VERSION_CAPABILITIES),
        get_u32(payload, zero + AUTOPILOT_VERSION_FLIGHT_SW_VERSION),
        get_u32(payload, zero + AUTOPILOT_VERSION_MIDDLEWARE_SW_VERSION),
        get_u32(payload, zero + AUTOPILOT_VERSION_OS_SW_VERSION),
        get_u32(payload, zero + AUTOPILOT_VERSION_BOARD_VERSION),
        get_u16(payload, zero + AUTOPILOT_VERSION_VENDOR_ID),
        get_u16(payload, zero + AUTOPILOT_VERSION_PRODUCT_ID),
        get_u64(payload, zero + AUTOPILOT_VERSION_UID),
    )


@kernel
def put_autopilot_version_flight_custom_version(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 7) of `flight_custom_version`."""
    put_u8(payload, AUTOPILOT_VERSION_FLIGHT_CUSTOM_VERSION + i, value)


@kernel
def get_autopilot_version_flight_custom_version(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 7) of `flight_custom_version`."""
    return get_u8(payload, AUTOPILOT_VERSION_FLIGHT_CUSTOM_VERSION + i)


@kernel
def put_autopilot_version_middleware_custom_version(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 7) of `middleware_custom_version`."""
    put_u8(payload, AUTOPILOT_VERSION_MIDDLEWARE_CUSTOM_VERSION + i, value)


@kernel
def get_autopilot_version_middleware_custom_version(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 7) of `middleware_custom_version`."""
    return get_u8(payload, AUTOPILOT_VERSION_MIDDLEWARE_CUSTOM_VERSION + i)


@kernel
def put_autopilot_version_os_custom_version(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 7) of `os_custom_version`."""
    put_u8(payload, AUTOPILOT_VERSION_OS_CUSTOM_VERSION + i, value)


@kernel
def get_autopilot_version_os_custom_version(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 7) of `os_custom_version`."""
    return get_u8(payload, AUTOPILOT_VERSION_OS_CUSTOM_VERSION + i)


@kernel
def put_autopilot_version_uid2(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 17) of `uid2`."""
    put_u8(payload, AUTOPILOT_VERSION_UID2 + i, value)


@kernel
def get_autopilot_version_uid2(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 17) of `uid2`."""
    return get_u8(payload, AUTOPILOT_VERSION_UID2 + i)


# -- MEMINFO ----------------------------------------------------------------------------------------------------------

MEMINFO = 152
MEMINFO_LENGTH = 8
MEMINFO_BRKVAL = 0  # uint16_t
MEMINFO_FREEMEM = 2  # uint16_t [bytes]
MEMINFO_FREEMEM32 = 4  # uint32_t [bytes], extension


@kernel
def encode_meminfo(payload: Bytes, brkval: int, freemem: int, freemem32: int) -> int:
    """Fills `payload` with a MEMINFO; returns MEMINFO_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + MEMINFO_BRKVAL, brkval)
    put_u16(payload, zero + MEMINFO_FREEMEM, freemem)
    put_u32(payload, zero + MEMINFO_FREEMEM32, freemem32)
    return MEMINFO_LENGTH


@kernel
def decode_meminfo(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a MEMINFO: brkval, freemem, freemem32."""
    zero = int(np.int64(0))
    return (
        get_u16(payload, zero + MEMINFO_BRKVAL),
        get_u16(payload, zero + MEMINFO_FREEMEM),
        get_u32(payload, zero + MEMINFO_FREEMEM32),
    )


# -- FENCE_FETCH_POINT ------------------------------------------------------------------------------------------------

FENCE_FETCH_POINT = 161
FENCE_FETCH_POINT_LENGTH = 3
FENCE_FETCH_POINT_TARGET_SYSTEM = 0  # uint8_t
FENCE_FETCH_POINT_TARGET_COMPONENT = 1  # uint8_t
FENCE_FETCH_POINT_IDX = 2  # uint8_t


@kernel
def encode_fence_fetch_point(payload: Bytes, target_system: int, target_component: int, idx: int) -> int:
    """Fills `payload` with a FENCE_FETCH_POINT; returns FENCE_FETCH_POINT_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + FENCE_FETCH_POINT_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + FENCE_FETCH_POINT_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + FENCE_FETCH_POINT_IDX, idx)
    return FENCE_FETCH_POINT_LENGTH


@kernel
def decode_fence_fetch_point(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a FENCE_FETCH_POINT: target_system, target_component, idx."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + FENCE_FETCH_POINT_TARGET_SYSTEM),
        get_u8(payload, zero + FENCE_FETCH_POINT_TARGET_COMPONENT),
        get_u8(payload, zero + FENCE_FETCH_POINT_IDX),
    )


# -- FENCE_STATUS -----------------------------------------------------------------------------------------------------

FENCE_STATUS = 162
FENCE_STATUS_LENGTH = 9
FENCE_STATUS_BREACH_STATUS = 6  # uint8_t
FENCE_STATUS_BREACH_COUNT = 4  # uint16_t
FENCE_STATUS_BREACH_TYPE = 7  # uint8_t
FENCE_STATUS_BREACH_TIME = 0  # uint32_t [ms]
FENCE_STATUS_BREACH_MITIGATION = 8  # uint8_t, extension


@kernel
def encode_fence_status(
    payload: Bytes, breach_status: int, breach_count: int, breach_type: int, breach_time: int, breach_mitigation: int
) -> int:
    """Fills `payload` with a FENCE_STATUS; returns FENCE_STATUS_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + FENCE_STATUS_BREACH_STATUS, breach_status)
    put_u16(payload, zero + FENCE_STATUS_BREACH_COUNT, breach_count)
    put_u8(payload, zero + FENCE_STATUS_BREACH_TYPE, breach_type)
    put_u32(payload, zero + FENCE_STATUS_BREACH_TIME, breach_time)
    put_u8(payload, zero + FENCE_STATUS_BREACH_MITIGATION, breach_mitigation)
    return FENCE_STATUS_LENGTH


@kernel
def decode_fence_status(payload: Bytes) -> tuple[int, int, int, int, int]:
    """Returns the scalar fields of a FENCE_STATUS.

    breach_status, breach_count, breach_type, breach_time, breach_mitigation.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + FENCE_STATUS_BREACH_STATUS),
        get_u16(payload, zero + FENCE_STATUS_BREACH_COUNT),
        get_u8(payload, zero + FENCE_STATUS_BREACH_TYPE),
        get_u32(payload, zero + FENCE_STATUS_BREACH_TIME),
        get_u8(payload, zero + FENCE_STATUS_BREACH_MITIGATION),
    )


# -- AHRS -------------------------------------------------------------------------------------------------------------

AHRS = 163
AHRS_LENGTH = 28
AHRS_OMEGAIX = 0  # float [rad/s]
AHRS_OMEGAIY = 4  # float [rad/s]
AHRS_OMEGAIZ = 8  # float [rad/s]
AHRS_ACCEL_WEIGHT = 12  # float
AHRS_RENORM_VAL = 16  # float
AHRS_ERROR_RP = 20  # float
AHRS_ERROR_YAW = 24  # float


@kernel
def encode_ahrs(
    payload: Bytes,
    omegaIx: float,
    omegaIy: float,
    omegaIz: float,
    accel_weight: float,
    renorm_val: float,
    error_rp: float,
    error_yaw: float,
) -> int:
    """Fills `payload` with an AHRS; returns AHRS_LENGTH."""
    zero = int(np.int64(0))
    put_f32(payload, zero + AHRS_OMEGAIX, omegaIx)
    put_f32(payload, zero + AHRS_OMEGAIY, omegaIy)
    put_f32(payload, zero + AHRS_OMEGAIZ, omegaIz)
    put_f32(payload, zero + AHRS_ACCEL_WEIGHT, accel_weight)
    put_f32(payload, zero + AHRS_RENORM_VAL, renorm_val)
    put_f32(payload, zero + AHRS_ERROR_RP, error_rp)
    put_f32(payload, zero + AHRS_ERROR_YAW, error_yaw)
    return AHRS_LENGTH


@kernel
def decode_ahrs(payload: Bytes) -> tuple[float, float, float, float, float, float, float]:
    """Returns the scalar fields of an AHRS.

    omegaIx, omegaIy, omegaIz, accel_weight, renorm_val, error_rp, error_yaw.
    """
    zero = int(np.int64(0))
    return (
        get_f32(payload, zero + AHRS_OMEGAIX),
        get_f32(payload, zero + AHRS_OMEGAIY),
        get_f32(payload, zero + AHRS_OMEGAIZ),
        get_f32(payload, zero + AHRS_ACCEL_WEIGHT),
        get_f32(payload, zero + AHRS_RENORM_VAL),
        get_f32(payload, zero + AHRS_ERROR_RP),
        get_f32(payload, zero + AHRS_ERROR_YAW),
    )


# -- SIMSTATE ---------------------------------------------------------------------------------------------------------

SIMSTATE = 164
SIMSTATE_LENGTH = 44
SIMSTATE_ROLL = 0  # float [rad]
SIMSTATE_PITCH = 4  # float [rad]
SIMSTATE_YAW = 8  # float [rad]
SIMSTATE_XACC = 12  # float [m/s/s]
SIMSTATE_YACC = 16  # float [m/s/s]
SIMSTATE_ZACC = 20  # float [m/s/s]
SIMSTATE_XGYRO = 24  # float [rad/s]
SIMSTATE_YGYRO = 28  # float [rad/s]
SIMSTATE_ZGYRO = 32  # float [rad/s]
SIMSTATE_LAT = 36  # int32_t [degE7]
SIMSTATE_LNG = 40  # int32_t [degE7]


@kernel
def encode_simstate(
    payload: Bytes,
    roll: float,
    pitch: float,
    yaw: float,
    xacc: float,
    yacc: float,
    zacc: float,
    xgyro: float,
    ygyro: float,
    zgyro: float,
    lat: int,
    lng: int,
) -> int:
    """Fills `payload` with a SIMSTATE; returns SIMSTATE_LENGTH."""
    zero = int(np.int64(0))
    put_f32(payload, zero + SIMSTATE_ROLL, roll)
    put_f32(payload, zero + SIMSTATE_PITCH, pitch)
    put_f32(payload, zero + SIMSTATE_YAW, yaw)
    put_f32(payload, zero + SIMSTATE_XACC, xacc)
    put_f32(payload, zero + SIMSTATE_YACC, yacc)
    put_f32(payload, zero + SIMSTATE_ZACC, zacc)
    put_f32(payload, zero + SIMSTATE_XGYRO, xgyro)
    put_f32(payload, zero + SIMSTATE_YGYRO, ygyro)
    put_f32(payload, zero + SIMSTATE_ZGYRO, zgyro)
    put_i32(payload, zero + SIMSTATE_LAT, lat)
    put_i32(payload, zero + SIMSTATE_LNG, lng)
    return SIMSTATE_LENGTH


@kernel
def decode_simstate(payload: Bytes) -> tuple[float, float, float, float, float, float, float, float, float, int, int]:
    """Returns the scalar fields of a SIMSTATE: roll, pitch, yaw, xacc, yacc, zacc, xgyro, ygyro, zgyro, lat, lng."""
    zero = int(np.int64(0))
    return (
        get_f32(payload, zero + SIMSTATE_ROLL),
        get_f32(payload, zero + SIMSTATE_PITCH),
        get_f32(payload, zero + SIMSTATE_YAW),
        get_f32(payload, zero + SIMSTATE_XACC),
        get_f32(payload, zero + SIMSTATE_YACC),
        get_f32(payload, zero + SIMSTATE_ZACC),
        get_f32(payload, zero + SIMSTATE_XGYRO),
        get_f32(payload, zero + SIMSTATE_YGYRO),
        get_f32(payload, zero + SIMSTATE_ZGYRO),
        get_i32(payload, zero + SIMSTATE_LAT),
        get_i32(payload, zero + SIMSTATE_LNG),
    )


# -- HWSTATUS ---------------------------------------------------------------------------------------------------------

HWSTATUS = 165
HWSTATUS_LENGTH = 3
HWSTATUS_VCC = 0  # uint16_t [mV]
HWSTATUS_I2CERR = 2  # uint8_t


@kernel
def encode_hwstatus(payload: Bytes, Vcc: int, I2Cerr: int) -> int:
    """Fills `payload` with a HWSTATUS; returns HWSTATUS_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + HWSTATUS_VCC, Vcc)
    put_u8(payload, zero + HWSTATUS_I2CERR, I2Cerr)
    return HWSTATUS_LENGTH


@kernel
def decode_hwstatus(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of a HWSTATUS: Vcc, I2Cerr."""
    zero = int(np.int64(0))
    return (
        get_u16(payload, zero + HWSTATUS_VCC),
        get_u8(payload, zero + HWSTATUS_I2CERR),
    )


# -- WIND -------------------------------------------------------------------------------------------------------------

WIND = 168
WIND_LENGTH = 12
WIND_DIRECTION = 0  # float [deg]
WIND_SPEED = 4  # float [m/s]
WIND_SPEED_Z = 8  # float [m/s]


@kernel
def encode_wind(payload: Bytes, direction: float, speed: float, speed_z: float) -> int:
    """Fills `payload` with a WIND; returns WIND_LENGTH."""
    zero = int(np.int64(0))
    put_f32(payload, zero + WIND_DIRECTION, direction)
    put_f32(payload, zero + WIND_SPEED, speed)
    put_f32(payload, zero + WIND_SPEED_Z, speed_z)
    return WIND_LENGTH


@kernel
def decode_wind(payload: Bytes) -> tuple[float, float, float]:
    """Returns the scalar fields of a WIND: direction, speed, speed_z."""
    zero = int(np.int64(0))
    return (
        get_f32(payload, zero + WIND_DIRECTION),
        get_f32(payload, zero + WIND_SPEED),
        get_f32(payload, zero + WIND_SPEED_Z),
    )


# -- RANGEFINDER ------------------------------------------------------------------------------------------------------

RANGEFINDER = 173
RANGEFINDER_LENGTH = 8
RANGEFINDER_DISTANCE = 0  # float [m]
RANGEFINDER_VOLTAGE = 4  # float [V]


@kernel
def encode_rangefinder(payload: Bytes, distance: float, voltage: float) -> int:
    """Fills `payload` with a RANGEFINDER; returns RANGEFINDER_LENGTH."""
    zero = int(np.int64(0))
    put_f32(payload, zero + RANGEFINDER_DISTANCE, distance)
    put_f32(payload, zero + RANGEFINDER_VOLTAGE, voltage)
    return RANGEFINDER_LENGTH


@kernel
def decode_rangefinder(payload: Bytes) -> tuple[float, float]:
    """Returns the scalar fields of a RANGEFINDER: distance, voltage."""
    zero = int(np.int64(0))
    return (
        get_f32(payload, zero + RANGEFINDER_DISTANCE),
        get_f32(payload, zero + RANGEFINDER_VOLTAGE),
    )


# -- RALLY_FETCH_POINT ------------------------------------------------------------------------------------------------

RALLY_FETCH_POINT = 176
RALLY_FETCH_POINT_LENGTH = 3
RALLY_FETCH_POINT_TARGET_SYSTEM = 0  # uint8_t
RALLY_FETCH_POINT_TARGET_COMPONENT = 1  # uint8_t
RALLY_FETCH_POINT_IDX = 2  # uint8_t


@kernel
def encode_rally_fetch_point(payload: Bytes, target_system: int, target_component: int, idx: int) -> int:
    """Fills `payload` with a RALLY_FETCH_POINT; returns RALLY_FETCH_POINT_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + RALLY_FETCH_POINT_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + RALLY_FETCH_POINT_TARGET_COMPONENT, target_component)
    put_u8(payload, zero + RALLY_FETCH_POINT_IDX, idx)
    return RALLY_FETCH_POINT_LENGTH


@kernel
def decode_rally_fetch_point(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a RALLY_FETCH_POINT: target_system, target_component, idx."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + RALLY_FETCH_POINT_TARGET_SYSTEM),
        get_u8(payload, zero + RALLY_FETCH_POINT_TARGET_COMPONENT),
        get_u8(payload, zero + RALLY_FETCH_POINT_IDX),
    )


# -- AHRS2 ------------------------------------------------------------------------------------------------------------

AHRS2 = 178
AHRS2_LENGTH = 24
AHRS2_ROLL = 0  # float [rad]
AHRS2_PITCH = 4  # float [rad]
AHRS2_YAW = 8  # float [rad]
AHRS2_ALTITUDE = 12  # float [m]
AHRS2_LAT = 16  # int32_t [degE7]
AHRS2_LNG = 20  # int32_t [degE7]


@kernel
def encode_ahrs2(payload: Bytes, roll: float, pitch: float, yaw: float, altitude: float, lat: int, lng: int) -> int:
    """Fills `payload` with an AHRS2; returns AHRS2_LENGTH."""
    zero = int(np.int64(0))
    put_f32(payload, zero + AHRS2_ROLL, roll)
    put_f32(payload, zero + AHRS2_PITCH, pitch)
    put_f32(payload, zero + AHRS2_YAW, yaw)
    put_f32(payload, zero + AHRS2_ALTITUDE, altitude)
    put_i32(payload, zero + AHRS2_LAT, lat)
    put_i32(payload, zero + AHRS2_LNG, lng)
    return AHRS2_LENGTH


@kernel
def decode_ahrs2(payload: Bytes) -> tuple[float, float, float, float, int, int]:
    """Returns the scalar fields of an AHRS2: roll, pitch, yaw, altitude, lat, lng."""
    zero = int(np.int64(0))
    return (
        get_f32(payload, zero + AHRS2_ROLL),
        get_f32(payload, zero + AHRS2_PITCH),
        get_f32(payload, zero + AHRS2_YAW),
        get_f32(payload, zero + AHRS2_ALTITUDE),
        get_i32(payload, zero + AHRS2_LAT),
        get_i32(payload, zero + AHRS2_LNG),
    )


# -- EKF_STATUS_REPORT ------------------------------------------------------------------------------------------------

EKF_STATUS_REPORT = 193
EKF_STATUS_REPORT_LENGTH = 26
EKF_STATUS_REPORT_FLAGS = 20  # uint16_t
EKF_STATUS_REPORT_VELOCITY_VARIANCE = 0  # float
EKF_STATUS_REPORT_POS_HORIZ_VARIANCE = 4  # float
EKF_STATUS_REPORT_POS_VERT_VARIANCE = 8  # float
EKF_STATUS_REPORT_COMPASS_VARIANCE = 12  # float
EKF_STATUS_REPORT_TERRAIN_ALT_VARIANCE = 16  # float
EKF_STATUS_REPORT_AIRSPEED_VARIANCE = 22  # float, extension


@kernel
def encode_ekf_status_report(
    payload: Bytes,
    flags: int,
    velocity_variance: float,
    pos_horiz_variance: float,
    pos_vert_variance: float,
    compass_variance: float,
    terrain_alt_variance: float,
    airspeed_variance: float,
) -> int:
    """Fills `payload` with an EKF_STATUS_REPORT; returns EKF_STATUS_REPORT_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + EKF_STATUS_REPORT_FLAGS, flags)
    put_f32(payload, zero + EKF_STATUS_REPORT_VELOCITY_VARIANCE, velocity_variance)
    put_f32(payload, zero + EKF_STATUS_REPORT_POS_HORIZ_VARIANCE, pos_horiz_variance)
    put_f32(payload, zero + EKF_STATUS_REPORT_POS_VERT_VARIANCE, pos_vert_variance)
    put_f32(payload, zero + EKF_STATUS_REPORT_COMPASS_VARIANCE, compass_variance)
    put_f32(payload, zero + EKF_STATUS_REPORT_TERRAIN_ALT_VARIANCE, terrain_alt_variance)
    put_f32(payload, zero + EKF_STATUS_REPORT_AIRSPEED_VARIANCE, airspeed_variance)
    return EKF_STATUS_REPORT_LENGTH


@kernel
def decode_ekf_status_report(payload: Bytes) -> tuple[int, float, float, float, float, float, float]:
    """Returns the scalar fields of an EKF_STATUS_REPORT.

    flags, velocity_variance, pos_horiz_variance, pos_vert_variance, compass_variance, terrain_alt_variance,
    airspeed_variance.
    """
    zero = int(np.int64(0))
    return (
        get_u16(payload, zero + EKF_STATUS_REPORT_FLAGS),
        get_f32(payload, zero + EKF_STATUS_REPORT_VELOCITY_VARIANCE),
        get_f32(payload, zero + EKF_STATUS_REPORT_POS_HORIZ_VARIANCE),
        get_f32(payload, zero + EKF_STATUS_REPORT_POS_VERT_VARIANCE),
        get_f32(payload, zero + EKF_STATUS_REPORT_COMPASS_VARIANCE),
        get_f32(payload, zero + EKF_STATUS_REPORT_TERRAIN_ALT_VARIANCE),
        get_f32(payload, zero + EKF_STATUS_REPORT_AIRSPEED_VARIANCE),
    )


# -- HIGH_LATENCY2 ----------------------------------------------------------------------------------------------------

HIGH_LATENCY2 = 235
HIGH_LATENCY2_LENGTH = 42
HIGH_LATENCY2_TIMESTAMP = 0  # uint32_t [ms]
HIGH_LATENCY2_TYPE = 24  # uint8_t
HIGH_LATENCY2_AUTOPILOT = 25  # uint8_t
HIGH_LATENCY2_CUSTOM_MODE = 12  # uint16_t
HIGH_LATENCY2_LATITUDE = 4  # int32_t [degE7]
HIGH_LATENCY2_LONGITUDE = 8  # int32_t [degE7]
HIGH_LATENCY2_ALTITUDE = 14  # int16_t [m]
HIGH_LATENCY2_TARGET_ALTITUDE = 16  # int16_t [m]
HIGH_LATENCY2_HEADING = 26  # uint8_t [deg/2]
HIGH_LATENCY2_TARGET_HEADING = 27  # uint8_t [deg/2]
HIGH_LATENCY2_TARGET_DISTANCE = 18  # uint16_t [dam]
HIGH_LATENCY2_THROTTLE = 28  # uint8_t [%]
HIGH_LATENCY2_AIRSPEED = 29  # uint8_t [m/s*5]
HIGH_LATENCY2_AIRSPEED_SP = 30  # uint8_t [m/s*5]
HIGH_LATENCY2_GROUNDSPEED = 31  # uint8_t [m/s*5]
HIGH_LATENCY2_WINDSPEED = 32  # uint8_t [m/s*5]
HIGH_LATENCY2_WIND_HEADING = 33  # uint8_t [deg/2]
HIGH_LATENCY2_EPH = 34  # uint8_t [dm]
HIGH_LATENCY2_EPV = 35  # uint8_t [dm]
HIGH_LATENCY2_TEMPERATURE_AIR = 36  # int8_t [degC]
HIGH_LATENCY2_CLIMB_RATE = 37  # int8_t [dm/s]
HIGH_LATENCY2_BATTERY = 38  # int8_t [%]
HIGH_LATENCY2_WP_NUM = 20  # uint16_t
HIGH_LATENCY2_FAILURE_FLAGS = 22  # uint16_t
HIGH_LATENCY2_CUSTOM0 = 39  # int8_t
HIGH_LATENCY2_CUSTOM1 = 40  # int8_t
HIGH_LATENCY2_CUSTOM2 = 41  # int8_t


@kernel
def encode_high_latency2(
    payload: Bytes,
    timestamp: int,
    type_: int,
    autopilot: int,
    custom_mode: int,
    latitude: int,
    longitude: int,
    altitude: int,
    target_altitude: int,
    heading: int,
    target_heading: int,
    target_distance: int,
    throttle: int,
    airspeed: int,
    airspeed_sp: int,
    groundspeed: int,
    windspeed: int,
    wind_heading: int,
    eph: int,
    epv: int,
    temperature_air: int,
    climb_rate: int,
    battery: int,
    wp_num: int,
    failure_flags: int,
    custom0: int,
    custom1: int,
    custom2: int,
) -> int:
    """Fills `payload` with a HIGH_LATENCY2; returns HIGH_LATENCY2_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + HIGH_LATENCY2_TIMESTAMP, timestamp)
    put_u8(payload, zero + HIGH_LATENCY2_TYPE, type_)
    put_u8(payload, zero + HIGH_LATENCY2_AUTOPILOT, autopilot)
    put_u16(payload, zero + HIGH_LATENCY2_CUSTOM_MODE, custom_mode)
    put_i32(payload, zero + HIGH_LATENCY2_LATITUDE, latitude)
    put_i32(payload, zero + HIGH_LATENCY2_LONGITUDE, longitude)
    put_i16(payload, zero + HIGH_LATENCY2_ALTITUDE, altitude)
    put_i16(payload, zero + HIGH_LATENCY2_TARGET_ALTITUDE, target_altitude)
    put_u8(payload, zero + HIGH_LATENCY2_HEADING, heading)
    put_u8(payload, zero + HIGH_LATENCY2_TARGET_HEADING, target_heading)
    put_u16(payload, zero + HIGH_LATENCY2_TARGET_DISTANCE, target_distance)
    put_u8(payload, zero + HIGH_LATENCY2_THROTTLE, throttle)
    put_u8(payload, zero + HIGH_LATENCY2_AIRSPEED, airspeed)
    put_u8(payload, zero + HIGH_LATENCY2_AIRSPEED_SP, airspeed_sp)
    put_u8(payload, zero + HIGH_LATENCY2_GROUNDSPEED, groundspeed)
    put_u8(payload, zero + HIGH_LATENCY2_WINDSPEED, windspeed)
    put_u8(payload, zero + HIGH_LATENCY2_WIND_HEADING, wind_heading)
    put_u8(payload, zero + HIGH_LATENCY2_EPH, eph)
    put_u8(payload, zero + HIGH_LATENCY2_EPV, epv)
    put_i8(payload, zero + HIGH_LATENCY2_TEMPERATURE_AIR, temperature_air)
    put_i8(payload, zero + HIGH_LATENCY2_CLIMB_RATE, climb_rate)
    put_i8(payload, zero + HIGH_LATENCY2_BATTERY, battery)
    put_u16(payload, zero + HIGH_LATENCY2_WP_NUM, wp_num)
    put_u16(payload, zero + HIGH_LATENCY2_FAILURE_FLAGS, failure_flags)
    put_i8(payload, zero + HIGH_LATENCY2_CUSTOM0, custom0)
    put_i8(payload, zero + HIGH_LATENCY2_CUSTOM1, custom1)
    put_i8(payload, zero + HIGH_LATENCY2_CUSTOM2, custom2)
    return HIGH_LATENCY2_LENGTH


@kernel
def decode_high_latency2(
    payload: Bytes,
) -> tuple[
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
    int,
]:
    """Returns the scalar fields of a HIGH_LATENCY2.

    timestamp, type, autopilot, custom_mode, latitude, longitude, altitude, target_altitude, heading, target_heading,
    target_distance, throttle, airspeed, airspeed_sp, groundspeed, windspeed, wind_heading, eph, epv, temperature_air,
    climb_rate, battery, wp_num, failure_flags, custom0, custom1, custom2.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + HIGH_LATENCY2_TIMESTAMP),
        get_u8(payload, zero + HIGH_LATENCY2_TYPE),
        get_u8(payload, zero + HIGH_LATENCY2_AUTOPILOT),
        get_u16(payload, zero + HIGH_LATENCY2_CUSTOM_MODE),
        get_i32(payload, zero + HIGH_LATENCY2_LATITUDE),
        get_i32(payload, zero + HIGH_LATENCY2_LONGITUDE),
        get_i16(payload, zero + HIGH_LATENCY2_ALTITUDE),
        get_i16(payload, zero + HIGH_LATENCY2_TARGET_ALTITUDE),
        get_u8(payload, zero + HIGH_LATENCY2_HEADING),
        get_u8(payload, zero + HIGH_LATENCY2_TARGET_HEADING),
        get_u16(payload, zero + HIGH_LATENCY2_TARGET_DISTANCE),
        get_u8(payload, zero + HIGH_LATENCY2_THROTTLE),
        get_u8(payload, zero + HIGH_LATENCY2_AIRSPEED),
        get_u8(payload, zero + HIGH_LATENCY2_AIRSPEED_SP),
        get_u8(payload, zero + HIGH_LATENCY2_GROUNDSPEED),
        get_u8(payload, zero + HIGH_LATENCY2_WINDSPEED),
        get_u8(payload, zero + HIGH_LATENCY2_WIND_HEADING),
        get_u8(payload, zero + HIGH_LATENCY2_EPH),
        get_u8(payload, zero + HIGH_LATENCY2_EPV),
        get_i8(payload, zero + HIGH_LATENCY2_TEMPERATURE_AIR),
        get_i8(payload, zero + HIGH_LATENCY2_CLIMB_RATE),
        get_i8(payload, zero + HIGH_LATENCY2_BATTERY),
        get_u16(payload, zero + HIGH_LATENCY2_WP_NUM),
        get_u16(payload, zero + HIGH_LATENCY2_FAILURE_FLAGS),
        get_i8(payload, zero + HIGH_LATENCY2_CUSTOM0),
        get_i8(payload, zero + HIGH_LATENCY2_CUSTOM1),
        get_i8(payload, zero + HIGH_LATENCY2_CUSTOM2),
    )


# -- VIBRATION --------------------------------------------------------------------------------------------------------

VIBRATION = 241
VIBRATION_LENGTH = 32
VIBRATION_TIME_USEC = 0  # uint64_t [us]
VIBRATION_VIBRATION_X = 8  # float
VIBRATION_VIBRATION_Y = 12  # float
VIBRATION_VIBRATION_Z = 16  # float
VIBRATION_CLIPPING_0 = 20  # uint32_t
VIBRATION_CLIPPING_1 = 24  # uint32_t
VIBRATION_CLIPPING_2 = 28  # uint32_t


@kernel
def encode_vibration(
    payload: Bytes,
    time_usec: int,
    vibration_x: float,
    vibration_y: float,
    vibration_z: float,
    clipping_0: int,
    clipping_1: int,
    clipping_2: int,
) -> int:
    """Fills `payload` with a VIBRATION; returns VIBRATION_LENGTH."""
    zero = int(np.int64(0))
    put_u64(payload, zero + VIBRATION_TIME_USEC, time_usec)
    put_f32(payload, zero + VIBRATION_VIBRATION_X, vibration_x)
    put_f32(payload, zero + VIBRATION_VIBRATION_Y, vibration_y)
    put_f32(payload, zero + VIBRATION_VIBRATION_Z, vibration_z)
    put_u32(payload, zero + VIBRATION_CLIPPING_0, clipping_0)
    put_u32(payload, zero + VIBRATION_CLIPPING_1, clipping_1)
    put_u32(payload, zero + VIBRATION_CLIPPING_2, clipping_2)
    return VIBRATION_LENGTH


@kernel
def decode_vibration(payload: Bytes) -> tuple[int, float, float, float, int, int, int]:
    """Returns the scalar fields of a VIBRATION.

    time_usec, vibration_x, vibration_y, vibration_z, clipping_0, clipping_1, clipping_2.
    """
    zero = int(np.int64(0))
    return (
        get_u64(payload, zero + VIBRATION_TIME_USEC),
        get_f32(payload, zero + VIBRATION_VIBRATION_X),
        get_f32(payload, zero + VIBRATION_VIBRATION_Y),
        get_f32(payload, zero + VIBRATION_VIBRATION_Z),
        get_u32(payload, zero + VIBRATION_CLIPPING_0),
        get_u32(payload, zero + VIBRATION_CLIPPING_1),
        get_u32(payload, zero + VIBRATION_CLIPPING_2),
    )


# -- HOME_POSITION ----------------------------------------------------------------------------------------------------

HOME_POSITION = 242
HOME_POSITION_LENGTH = 60
HOME_POSITION_LATITUDE = 0  # int32_t [degE7]
HOME_POSITION_LONGITUDE = 4  # int32_t [degE7]
HOME_POSITION_ALTITUDE = 8  # int32_t [mm]
HOME_POSITION_X = 12  # float [m]
HOME_POSITION_Y = 16  # float [m]
HOME_POSITION_Z = 20  # float [m]
HOME_POSITION_Q = 24  # float[4]
HOME_POSITION_APPROACH_X = 40  # float [m]
HOME_POSITION_APPROACH_Y = 44  # float [m]
HOME_POSITION_APPROACH_Z = 48  # float [m]
HOME_POSITION_TIME_USEC = 52  # uint64_t [us], extension


@kernel
def encode_home_position(
    payload: Bytes,
    latitude: int,
    longitude: int,
    altitude: int,
    x: float,
    y: float,
    z: float,
    approach_x: float,
    approach_y: float,
    approach_z: float,
    time_usec: int,
) -> int:
    """Fills `payload` with a HOME_POSITION; returns HOME_POSITION_LENGTH."""
    zero = int(np.int64(0))
    put_i32(payload, zero + HOME_POSITION_LATITUDE, latitude)
    put_i32(payload, zero + HOME_POSITION_LONGITUDE, longitude)
    put_i32(payload, zero + HOME_POSITION_ALTITUDE, altitude)
    put_f32(payload, zero + HOME_POSITION_X, x)
    put_f32(payload, zero + HOME_POSITION_Y, y)
    put_f32(payload, zero + HOME_POSITION_Z, z)
    clear(payload, zero + HOME_POSITION_Q, zero + HOME_POSITION_Q + 16)
    put_f32(payload, zero + HOME_POSITION_APPROACH_X, approach_x)
    put_f32(payload, zero + HOME_POSITION_APPROACH_Y, approach_y)
    put_f32(payload, zero + HOME_POSITION_APPROACH_Z, approach_z)
    put_u64(payload, zero + HOME_POSITION_TIME_USEC, time_usec)
    return HOME_POSITION_LENGTH


@kernel
def decode_home_position(payload: Bytes) -> tuple[int, int, int, float, float, float, float, float, float, int]:
    """Returns the scalar fields of a HOME_POSITION.

    latitude, longitude, altitude, x, y, z, approach_x, approach_y, approach_z, time_usec.
    """
    zero = int(np.int64(0))
    return (
        get_i32(payload, zero + HOME_POSITION_LATITUDE),
        get_i32(payload, zero + HOME_POSITION_LONGITUDE),
        get_i32(payload, zero + HOME_POSITION_ALTITUDE),
        get_f32(payload, zero + HOME_POSITION_X),
        get_f32(payload, zero + HOME_POSITION_Y),
        get_f32(payload, zero + HOME_POSITION_Z),
        get_f32(payload, zero + HOME_POSITION_APPROACH_X),
        get_f32(payload, zero + HOME_POSITION_APPROACH_Y),
        get_f32(payload, zero + HOME_POSITION_APPROACH_Z),
        get_u64(payload, zero + HOME_POSITION_TIME_USEC),
    )


@kernel
def put_home_position_q(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 3) of `q`."""
    put_f32(payload, HOME_POSITION_Q + 4 * i, value)


@kernel
def get_home_position_q(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 3) of `q`."""
    return get_f32(payload, HOME_POSITION_Q + 4 * i)


# -- SET_HOME_POSITION ------------------------------------------------------------------------------------------------

SET_HOME_POSITION = 243
SET_HOME_POSITION_LENGTH = 61
SET_HOME_POSITION_TARGET_SYSTEM = 52  # uint8_t
SET_HOME_POSITION_LATITUDE = 0  # int32_t [degE7]
SET_HOME_POSITION_LONGITUDE = 4  # int32_t [degE7]
SET_HOME_POSITION_ALTITUDE = 8  # int32_t [mm]
SET_HOME_POSITION_X = 12  # float [m]
SET_HOME_POSITION_Y = 16  # float [m]
SET_HOME_POSITION_Z = 20  # float [m]
SET_HOME_POSITION_Q = 24  # float[4]
SET_HOME_POSITION_APPROACH_X = 40  # float [m]
SET_HOME_POSITION_APPROACH_Y = 44  # float [m]
SET_HOME_POSITION_APPROACH_Z = 48  # float [m]
SET_HOME_POSITION_TIME_USEC = 53  # uint64_t [us], extension


@kernel
def encode_set_home_position(
    payload: Bytes,
    target_system: int,
    latitude: int,
    longitude: int,
    altitude: int,
    x: float,
    y: float,
    z: float,
    approach_x: float,
    approach_y: float,
    approach_z: float,
    time_usec: int,
) -> int:
    """Fills `payload` with a SET_HOME_POSITION; returns SET_HOME_POSITION_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + SET_HOME_POSITION_TARGET_SYSTEM, target_system)
    put_i32(payload, zero + SET_HOME_POSITION_LATITUDE, latitude)
    put_i32(payload, zero + SET_HOME_POSITION_LONGITUDE, longitude)
    put_i32(payload, zero + SET_HOME_POSITION_ALTITUDE, altitude)
    put_f32(payload, zero + SET_HOME_POSITION_X, x)
    put_f32(payload, zero + SET_HOME_POSITION_Y, y)
    put_f32(payload, zero + SET_HOME_POSITION_Z, z)
    clear(payload, zero + SET_HOME_POSITION_Q, zero + SET_HOME_POSITION_Q + 16)
    put_f32(payload, zero + SET_HOME_POSITION_APPROACH_X, approach_x)
    put_f32(payload, zero + SET_HOME_POSITION_APPROACH_Y, approach_y)
    put_f32(payload, zero + SET_HOME_POSITION_APPROACH_Z, approach_z)
    put_u64(payload, zero + SET_HOME_POSITION_TIME_USEC, time_usec)
    return SET_HOME_POSITION_LENGTH


@kernel
def decode_set_home_position(
    payload: Bytes,
) -> tuple[int, int, int, int, float, float, float, float, float, float, int]:
    """Returns the scalar fields of a SET_HOME_POSITION.

    target_system, latitude, longitude, altitude, x, y, z, approach_x, approach_y, approach_z, time_usec.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + SET_HOME_POSITION_TARGET_SYSTEM),
        get_i32(payload, zero + SET_HOME_POSITION_LATITUDE),
        get_i32(payload, zero + SET_HOME_POSITION_LONGITUDE),
        get_i32(payload, zero + SET_HOME_POSITION_ALTITUDE),
        get_f32(payload, zero + SET_HOME_POSITION_X),
        get_f32(payload, zero + SET_HOME_POSITION_Y),
        get_f32(payload, zero + SET_HOME_POSITION_Z),
        get_f32(payload, zero + SET_HOME_POSITION_APPROACH_X),
        get_f32(payload, zero + SET_HOME_POSITION_APPROACH_Y),
        get_f32(payload, zero + SET_HOME_POSITION_APPROACH_Z),
        get_u64(payload, zero + SET_HOME_POSITION_TIME_USEC),
    )


@kernel
def put_set_home_position_q(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 3) of `q`."""
    put_f32(payload, SET_HOME_POSITION_Q + 4 * i, value)


@kernel
def get_set_home_position_q(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 3) of `q`."""
    return get_f32(payload, SET_HOME_POSITION_Q + 4 * i)


# -- MESSAGE_INTERVAL -------------------------------------------------------------------------------------------------

MESSAGE_INTERVAL = 244
MESSAGE_INTERVAL_LENGTH = 6
MESSAGE_INTERVAL_MESSAGE_ID = 4  # uint16_t
MESSAGE_INTERVAL_INTERVAL_US = 0  # int32_t [us]


@kernel
def encode_message_interval(payload: Bytes, message_id: int, interval_us: int) -> int:
    """Fills `payload` with a MESSAGE_INTERVAL; returns MESSAGE_INTERVAL_LENGTH."""
    zero = int(np.int64(0))
    put_u16(payload, zero + MESSAGE_INTERVAL_MESSAGE_ID, message_id)
    put_i32(payload, zero + MESSAGE_INTERVAL_INTERVAL_US, interval_us)
    return MESSAGE_INTERVAL_LENGTH


@kernel
def decode_message_interval(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of a MESSAGE_INTERVAL: message_id, interval_us."""
    zero = int(np.int64(0))
    return (
        get_u16(payload, zero + MESSAGE_INTERVAL_MESSAGE_ID),
        get_i32(payload, zero + MESSAGE_INTERVAL_INTERVAL_US),
    )


# -- EXTENDED_SYS_STATE -----------------------------------------------------------------------------------------------

EXTENDED_SYS_STATE = 245
EXTENDED_SYS_STATE_LENGTH = 2
EXTENDED_SYS_STATE_VTOL_STATE = 0  # uint8_t
EXTENDED_SYS_STATE_LANDED_STATE = 1  # uint8_t


@kernel
def encode_extended_sys_state(payload: Bytes, vtol_state: int, landed_state: int) -> int:
    """Fills `payload` with an EXTENDED_SYS_STATE; returns EXTENDED_SYS_STATE_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + EXTENDED_SYS_STATE_VTOL_STATE, vtol_state)
    put_u8(payload, zero + EXTENDED_SYS_STATE_LANDED_STATE, landed_state)
    return EXTENDED_SYS_STATE_LENGTH


@kernel
def decode_extended_sys_state(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of an EXTENDED_SYS_STATE: vtol_state, landed_state."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + EXTENDED_SYS_STATE_VTOL_STATE),
        get_u8(payload, zero + EXTENDED_SYS_STATE_LANDED_STATE),
    )


# -- ADSB_VEHICLE -----------------------------------------------------------------------------------------------------

ADSB_VEHICLE = 246
ADSB_VEHICLE_LENGTH = 38
ADSB_VEHICLE_ICAO_ADDRESS = 0  # uint32_t
ADSB_VEHICLE_LAT = 4  # int32_t [degE7]
ADSB_VEHICLE_LON = 8  # int32_t [degE7]
ADSB_VEHICLE_ALTITUDE_TYPE = 26  # uint8_t
ADSB_VEHICLE_ALTITUDE = 12  # int32_t [mm]
ADSB_VEHICLE_HEADING = 16  # uint16_t [cdeg]
ADSB_VEHICLE_HOR_VELOCITY = 18  # uint16_t [cm/s]
ADSB_VEHICLE_VER_VELOCITY = 20  # int16_t [cm/s]
ADSB_VEHICLE_CALLSIGN = 27  # char[9]
ADSB_VEHICLE_EMITTER_TYPE = 36  # uint8_t
ADSB_VEHICLE_TSLC = 37  # uint8_t [s]
ADSB_VEHICLE_FLAGS = 22  # uint16_t
ADSB_VEHICLE_SQUAWK = 24  # uint16_t


@kernel
def encode_adsb_vehicle(
    payload: Bytes,
    ICAO_address: int,
    lat: int,
    lon: int,
    altitude_type: int,
    altitude: int,
    heading: int,
    hor_velocity: int,
    ver_velocity: int,
    emitter_type: int,
    tslc: int,
    flags: int,
    squawk: int,
) -> int:
    """Fills `payload` with an ADSB_VEHICLE; returns ADSB_VEHICLE_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + ADSB_VEHICLE_ICAO_ADDRESS, ICAO_address)
    put_i32(payload, zero + ADSB_VEHICLE_LAT, lat)
    put_i32(payload, zero + ADSB_VEHICLE_LON, lon)
    put_u8(payload, zero + ADSB_VEHICLE_ALTITUDE_TYPE, altitude_type)
    put_i32(payload, zero + ADSB_VEHICLE_ALTITUDE, altitude)
    put_u16(payload, zero + ADSB_VEHICLE_HEADING, heading)
    put_u16(payload, zero + ADSB_VEHICLE_HOR_VELOCITY, hor_velocity)
    put_i16(payload, zero + ADSB_VEHICLE_VER_VELOCITY, ver_velocity)
    clear(payload, zero + ADSB_VEHICLE_CALLSIGN, zero + ADSB_VEHICLE_CALLSIGN + 9)
    put_u8(payload, zero + ADSB_VEHICLE_EMITTER_TYPE, emitter_type)
    put_u8(payload, zero + ADSB_VEHICLE_TSLC, tslc)
    put_u16(payload, zero + ADSB_VEHICLE_FLAGS, flags)
    put_u16(payload, zero + ADSB_VEHICLE_SQUAWK, squawk)
    return ADSB_VEHICLE_LENGTH


@kernel
def decode_adsb_vehicle(payload: Bytes) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int]:
    """Returns the scalar fields of an ADSB_VEHICLE.

    ICAO_address, lat, lon, altitude_type, altitude, heading, hor_velocity, ver_velocity, emitter_type, tslc, flags,
    squawk.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + ADSB_VEHICLE_ICAO_ADDRESS),
        get_i32(payload, zero + ADSB_VEHICLE_LAT),
        get_i32(payload, zero + ADSB_VEHICLE_LON),
        get_u8(payload, zero + ADSB_VEHICLE_ALTITUDE_TYPE),
        get_i32(payload, zero + ADSB_VEHICLE_ALTITUDE),
        get_u16(payload, zero + ADSB_VEHICLE_HEADING),
        get_u16(payload, zero + ADSB_VEHICLE_HOR_VELOCITY),
        get_i16(payload, zero + ADSB_VEHICLE_VER_VELOCITY),
        get_u8(payload, zero + ADSB_VEHICLE_EMITTER_TYPE),
        get_u8(payload, zero + ADSB_VEHICLE_TSLC),
        get_u16(payload, zero + ADSB_VEHICLE_FLAGS),
        get_u16(payload, zero + ADSB_VEHICLE_SQUAWK),
    )


@kernel
def put_adsb_vehicle_callsign(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 8) of `callsign`."""
    put_u8(payload, ADSB_VEHICLE_CALLSIGN + i, value)


@kernel
def get_adsb_vehicle_callsign(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 8) of `callsign`."""
    return get_u8(payload, ADSB_VEHICLE_CALLSIGN + i)


# -- V2_EXTENSION -----------------------------------------------------------------------------------------------------

V2_EXTENSION = 248
V2_EXTENSION_LENGTH = 254
V2_EXTENSION_TARGET_NETWORK = 2  # uint8_t
V2_EXTENSION_TARGET_SYSTEM = 3  # uint8_t
V2_EXTENSION_TARGET_COMPONENT = 4  # uint8_t
V2_EXTENSION_MESSAGE_TYPE = 0  # uint16_t
V2_EXTENSION_PAYLOAD = 5  # uint8_t[249]


@kernel
def encode_v2_extension(
    payload: Bytes, target_network: int, target_system: int, target_component: int, message_type: int
) -> int:
    """Fills `payload` with a V2_EXTENSION; returns V2_EXTENSION_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + V2_EXTENSION_TARGET_NETWORK, target_network)
    put_u8(payload, zero + V2_EXTENSION_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + V2_EXTENSION_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + V2_EXTENSION_MESSAGE_TYPE, message_type)
    clear(payload, zero + V2_EXTENSION_PAYLOAD, zero + V2_EXTENSION_PAYLOAD + 249)
    return V2_EXTENSION_LENGTH


@kernel
def decode_v2_extension(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a V2_EXTENSION: target_network, target_system, target_component, message_type."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + V2_EXTENSION_TARGET_NETWORK),
        get_u8(payload, zero + V2_EXTENSION_TARGET_SYSTEM),
        get_u8(payload, zero + V2_EXTENSION_TARGET_COMPONENT),
        get_u16(payload, zero + V2_EXTENSION_MESSAGE_TYPE),
    )


@kernel
def put_v2_extension_payload(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 248) of `payload`."""
    put_u8(payload, V2_EXTENSION_PAYLOAD + i, value)


@kernel
def get_v2_extension_payload(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 248) of `payload`."""
    return get_u8(payload, V2_EXTENSION_PAYLOAD + i)


# -- DEBUG_VECT -------------------------------------------------------------------------------------------------------

DEBUG_VECT = 250
DEBUG_VECT_LENGTH = 30
DEBUG_VECT_NAME = 20  # char[10]
DEBUG_VECT_TIME_USEC = 0  # uint64_t [us]
DEBUG_VECT_X = 8  # float
DEBUG_VECT_Y = 12  # float
DEBUG_VECT_Z = 16  # float


@kernel
def encode_debug_vect(payload: Bytes, time_usec: int, x: float, y: float, z: float) -> int:
    """Fills `payload` with a DEBUG_VECT; returns DEBUG_VECT_LENGTH."""
    zero = int(np.int64(0))
    clear(payload, zero + DEBUG_VECT_NAME, zero + DEBUG_VECT_NAME + 10)
    put_u64(payload, zero + DEBUG_VECT_TIME_USEC, time_usec)
    put_f32(payload, zero + DEBUG_VECT_X, x)
    put_f32(payload, zero + DEBUG_VECT_Y, y)
    put_f32(payload, zero + DEBUG_VECT_Z, z)
    return DEBUG_VECT_LENGTH


@kernel
def decode_debug_vect(payload: Bytes) -> tuple[int, float, float, float]:
    """Returns the scalar fields of a DEBUG_VECT: time_usec, x, y, z."""
    zero = int(np.int64(0))
    return (
        get_u64(payload, zero + DEBUG_VECT_TIME_USEC),
        get_f32(payload, zero + DEBUG_VECT_X),
        get_f32(payload, zero + DEBUG_VECT_Y),
        get_f32(payload, zero + DEBUG_VECT_Z),
    )


@kernel
def put_debug_vect_name(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 9) of `name`."""
    put_u8(payload, DEBUG_VECT_NAME + i, value)


@kernel
def get_debug_vect_name(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 9) of `name`."""
    return get_u8(payload, DEBUG_VECT_NAME + i)


# -- NAMED_VALUE_FLOAT ------------------------------------------------------------------------------------------------

NAMED_VALUE_FLOAT = 251
NAMED_VALUE_FLOAT_LENGTH = 18
NAMED_VALUE_FLOAT_TIME_BOOT_MS = 0  # uint32_t [ms]
NAMED_VALUE_FLOAT_NAME = 8  # char[10]
NAMED_VALUE_FLOAT_VALUE = 4  # float


@kernel
def encode_named_value_float(payload: Bytes, time_boot_ms: int, value: float) -> int:
    """Fills `payload` with a NAMED_VALUE_FLOAT; returns NAMED_VALUE_FLOAT_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + NAMED_VALUE_FLOAT_TIME_BOOT_MS, time_boot_ms)
    clear(payload, zero + NAMED_VALUE_FLOAT_NAME, zero + NAMED_VALUE_FLOAT_NAME + 10)
    put_f32(payload, zero + NAMED_VALUE_FLOAT_VALUE, value)
    return NAMED_VALUE_FLOAT_LENGTH


@kernel
def decode_named_value_float(payload: Bytes) -> tuple[int, float]:
    """Returns the scalar fields of a NAMED_VALUE_FLOAT: time_boot_ms, value."""
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + NAMED_VALUE_FLOAT_TIME_BOOT_MS),
        get_f32(payload, zero + NAMED_VALUE_FLOAT_VALUE),
    )


@kernel
def put_named_value_float_name(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 9) of `name`."""
    put_u8(payload, NAMED_VALUE_FLOAT_NAME + i, value)


@kernel
def get_named_value_float_name(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 9) of `name`."""
    return get_u8(payload, NAMED_VALUE_FLOAT_NAME + i)


# -- NAMED_VALUE_INT --------------------------------------------------------------------------------------------------

NAMED_VALUE_INT = 252
NAMED_VALUE_INT_LENGTH = 18
NAMED_VALUE_INT_TIME_BOOT_MS = 0  # uint32_t [ms]
NAMED_VALUE_INT_NAME = 8  # char[10]
NAMED_VALUE_INT_VALUE = 4  # int32_t


@kernel
def encode_named_value_int(payload: Bytes, time_boot_ms: int, value: int) -> int:
    """Fills `payload` with a NAMED_VALUE_INT; returns NAMED_VALUE_INT_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + NAMED_VALUE_INT_TIME_BOOT_MS, time_boot_ms)
    clear(payload, zero + NAMED_VALUE_INT_NAME, zero + NAMED_VALUE_INT_NAME + 10)
    put_i32(payload, zero + NAMED_VALUE_INT_VALUE, value)
    return NAMED_VALUE_INT_LENGTH


@kernel
def decode_named_value_int(payload: Bytes) -> tuple[int, int]:
    """Returns the scalar fields of a NAMED_VALUE_INT: time_boot_ms, value."""
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + NAMED_VALUE_INT_TIME_BOOT_MS),
        get_i32(payload, zero + NAMED_VALUE_INT_VALUE),
    )


@kernel
def put_named_value_int_name(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 9) of `name`."""
    put_u8(payload, NAMED_VALUE_INT_NAME + i, value)


@kernel
def get_named_value_int_name(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 9) of `name`."""
    return get_u8(payload, NAMED_VALUE_INT_NAME + i)


# -- STATUSTEXT -------------------------------------------------------------------------------------------------------

STATUSTEXT = 253
STATUSTEXT_LENGTH = 54
STATUSTEXT_SEVERITY = 0  # uint8_t
STATUSTEXT_TEXT = 1  # char[50]
STATUSTEXT_ID = 51  # uint16_t, extension
STATUSTEXT_CHUNK_SEQ = 53  # uint8_t, extension


@kernel
def encode_statustext(payload: Bytes, severity: int, id_: int, chunk_seq: int) -> int:
    """Fills `payload` with a STATUSTEXT; returns STATUSTEXT_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + STATUSTEXT_SEVERITY, severity)
    clear(payload, zero + STATUSTEXT_TEXT, zero + STATUSTEXT_TEXT + 50)
    put_u16(payload, zero + STATUSTEXT_ID, id_)
    put_u8(payload, zero + STATUSTEXT_CHUNK_SEQ, chunk_seq)
    return STATUSTEXT_LENGTH


@kernel
def decode_statustext(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a STATUSTEXT: severity, id, chunk_seq."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + STATUSTEXT_SEVERITY),
        get_u16(payload, zero + STATUSTEXT_ID),
        get_u8(payload, zero + STATUSTEXT_CHUNK_SEQ),
    )


@kernel
def put_statustext_text(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 49) of `text`."""
    put_u8(payload, STATUSTEXT_TEXT + i, value)


@kernel
def get_statustext_text(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 49) of `text`."""
    return get_u8(payload, STATUSTEXT_TEXT + i)


# -- DEBUG ------------------------------------------------------------------------------------------------------------

DEBUG = 254
DEBUG_LENGTH = 9
DEBUG_TIME_BOOT_MS = 0  # uint32_t [ms]
DEBUG_IND = 8  # uint8_t
DEBUG_VALUE = 4  # float


@kernel
def encode_debug(payload: Bytes, time_boot_ms: int, ind: int, value: float) -> int:
    """Fills `payload` with a DEBUG; returns DEBUG_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + DEBUG_TIME_BOOT_MS, time_boot_ms)
    put_u8(payload, zero + DEBUG_IND, ind)
    put_f32(payload, zero + DEBUG_VALUE, value)
    return DEBUG_LENGTH


@kernel
def decode_debug(payload: Bytes) -> tuple[int, int, float]:
    """Returns the scalar fields of a DEBUG: time_boot_ms, ind, value."""
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + DEBUG_TIME_BOOT_MS),
        get_u8(payload, zero + DEBUG_IND),
        get_f32(payload, zero + DEBUG_VALUE),
    )


# -- FLIGHT_INFORMATION -----------------------------------------------------------------------------------------------

FLIGHT_INFORMATION = 264
FLIGHT_INFORMATION_LENGTH = 32
FLIGHT_INFORMATION_TIME_BOOT_MS = 24  # uint32_t [ms]
FLIGHT_INFORMATION_ARMING_TIME_UTC = 0  # uint64_t [us]
FLIGHT_INFORMATION_TAKEOFF_TIME_UTC = 8  # uint64_t [us]
FLIGHT_INFORMATION_FLIGHT_UUID = 16  # uint64_t
FLIGHT_INFORMATION_LANDING_TIME = 28  # uint32_t [ms], extension


@kernel
def encode_flight_information(
    payload: Bytes, time_boot_ms: int, arming_time_utc: int, takeoff_time_utc: int, flight_uuid: int, landing_time: int
) -> int:
    """Fills `payload` with a FLIGHT_INFORMATION; returns FLIGHT_INFORMATION_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + FLIGHT_INFORMATION_TIME_BOOT_MS, time_boot_ms)
    put_u64(payload, zero + FLIGHT_INFORMATION_ARMING_TIME_UTC, arming_time_utc)
    put_u64(payload, zero + FLIGHT_INFORMATION_TAKEOFF_TIME_UTC, takeoff_time_utc)
    put_u64(payload, zero + FLIGHT_INFORMATION_FLIGHT_UUID, flight_uuid)
    put_u32(payload, zero + FLIGHT_INFORMATION_LANDING_TIME, landing_time)
    return FLIGHT_INFORMATION_LENGTH


@kernel
def decode_flight_information(payload: Bytes) -> tuple[int, int, int, int, int]:
    """Returns the scalar fields of a FLIGHT_INFORMATION.

    time_boot_ms, arming_time_utc, takeoff_time_utc, flight_uuid, landing_time.
    """
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + FLIGHT_INFORMATION_TIME_BOOT_MS),
        get_u64(payload, zero + FLIGHT_INFORMATION_ARMING_TIME_UTC),
        get_u64(payload, zero + FLIGHT_INFORMATION_TAKEOFF_TIME_UTC),
        get_u64(payload, zero + FLIGHT_INFORMATION_FLIGHT_UUID),
        get_u32(payload, zero + FLIGHT_INFORMATION_LANDING_TIME),
    )


# -- AUTOPILOT_STATE_FOR_GIMBAL_DEVICE --------------------------------------------------------------------------------

AUTOPILOT_STATE_FOR_GIMBAL_DEVICE = 286
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_LENGTH = 57
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_TARGET_SYSTEM = 50  # uint8_t
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_TARGET_COMPONENT = 51  # uint8_t
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_TIME_BOOT_US = 0  # uint64_t [us]
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_Q = 8  # float[4]
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_Q_ESTIMATED_DELAY_US = 24  # uint32_t [us]
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_VX = 28  # float [m/s]
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_VY = 32  # float [m/s]
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_VZ = 36  # float [m/s]
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_V_ESTIMATED_DELAY_US = 40  # uint32_t [us]
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_FEED_FORWARD_ANGULAR_VELOCITY_Z = 44  # float [rad/s]
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_ESTIMATOR_STATUS = 48  # uint16_t
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_LANDED_STATE = 52  # uint8_t
AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_ANGULAR_VELOCITY_Z = 53  # float [rad/s], extension


@kernel
def encode_autopilot_state_for_gimbal_device(
    payload: Bytes,
    target_system: int,
    target_component: int,
    time_boot_us: int,
    q_estimated_delay_us: int,
    vx: float,
    vy: float,
    vz: float,
    v_estimated_delay_us: int,
    feed_forward_angular_velocity_z: float,
    estimator_status: int,
    landed_state: int,
    angular_velocity_z: float,
) -> int:
    """Fills `payload` with an AUTOPILOT_STATE_FOR_GIMBAL_DEVICE; returns AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_TARGET_COMPONENT, target_component)
    put_u64(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_TIME_BOOT_US, time_boot_us)
    clear(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_Q, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_Q + 16)
    put_u32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_Q_ESTIMATED_DELAY_US, q_estimated_delay_us)
    put_f32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_VX, vx)
    put_f32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_VY, vy)
    put_f32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_VZ, vz)
    put_u32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_V_ESTIMATED_DELAY_US, v_estimated_delay_us)
    put_f32(
        payload,
        zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_FEED_FORWARD_ANGULAR_VELOCITY_Z,
        feed_forward_angular_velocity_z,
    )
    put_u16(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_ESTIMATOR_STATUS, estimator_status)
    put_u8(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_LANDED_STATE, landed_state)
    put_f32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_ANGULAR_VELOCITY_Z, angular_velocity_z)
    return AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_LENGTH


@kernel
def decode_autopilot_state_for_gimbal_device(
    payload: Bytes,
) -> tuple[int, int, int, int, float, float, float, int, float, int, int, float]:
    """Returns the scalar fields of an AUTOPILOT_STATE_FOR_GIMBAL_DEVICE.

    target_system, target_component, time_boot_us, q_estimated_delay_us, vx, vy, vz, v_estimated_delay_us,
    feed_forward_angular_velocity_z, estimator_status, landed_state, angular_velocity_z.
    """
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_TARGET_SYSTEM),
        get_u8(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_TARGET_COMPONENT),
        get_u64(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_TIME_BOOT_US),
        get_u32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_Q_ESTIMATED_DELAY_US),
        get_f32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_VX),
        get_f32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_VY),
        get_f32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_VZ),
        get_u32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_V_ESTIMATED_DELAY_US),
        get_f32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_FEED_FORWARD_ANGULAR_VELOCITY_Z),
        get_u16(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_ESTIMATOR_STATUS),
        get_u8(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_LANDED_STATE),
        get_f32(payload, zero + AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_ANGULAR_VELOCITY_Z),
    )


@kernel
def put_autopilot_state_for_gimbal_device_q(payload: Bytes, i: int, value: float) -> None:
    """Sets element i (0 to 3) of `q`."""
    put_f32(payload, AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_Q + 4 * i, value)


@kernel
def get_autopilot_state_for_gimbal_device_q(payload: Bytes, i: int) -> float:
    """Returns element i (0 to 3) of `q`."""
    return get_f32(payload, AUTOPILOT_STATE_FOR_GIMBAL_DEVICE_Q + 4 * i)


# -- RELAY_STATUS -----------------------------------------------------------------------------------------------------

RELAY_STATUS = 376
RELAY_STATUS_LENGTH = 8
RELAY_STATUS_TIME_BOOT_MS = 0  # uint32_t [ms]
RELAY_STATUS_ON = 4  # uint16_t
RELAY_STATUS_PRESENT = 6  # uint16_t


@kernel
def encode_relay_status(payload: Bytes, time_boot_ms: int, on: int, present: int) -> int:
    """Fills `payload` with a RELAY_STATUS; returns RELAY_STATUS_LENGTH."""
    zero = int(np.int64(0))
    put_u32(payload, zero + RELAY_STATUS_TIME_BOOT_MS, time_boot_ms)
    put_u16(payload, zero + RELAY_STATUS_ON, on)
    put_u16(payload, zero + RELAY_STATUS_PRESENT, present)
    return RELAY_STATUS_LENGTH


@kernel
def decode_relay_status(payload: Bytes) -> tuple[int, int, int]:
    """Returns the scalar fields of a RELAY_STATUS: time_boot_ms, on, present."""
    zero = int(np.int64(0))
    return (
        get_u32(payload, zero + RELAY_STATUS_TIME_BOOT_MS),
        get_u16(payload, zero + RELAY_STATUS_ON),
        get_u16(payload, zero + RELAY_STATUS_PRESENT),
    )


# -- TUNNEL -----------------------------------------------------------------------------------------------------------

TUNNEL = 385
TUNNEL_LENGTH = 133
TUNNEL_TARGET_SYSTEM = 2  # uint8_t
TUNNEL_TARGET_COMPONENT = 3  # uint8_t
TUNNEL_PAYLOAD_TYPE = 0  # uint16_t
TUNNEL_PAYLOAD_LENGTH = 4  # uint8_t
TUNNEL_PAYLOAD = 5  # uint8_t[128]


@kernel
def encode_tunnel(
    payload: Bytes, target_system: int, target_component: int, payload_type: int, payload_length: int
) -> int:
    """Fills `payload` with a TUNNEL; returns TUNNEL_LENGTH."""
    zero = int(np.int64(0))
    put_u8(payload, zero + TUNNEL_TARGET_SYSTEM, target_system)
    put_u8(payload, zero + TUNNEL_TARGET_COMPONENT, target_component)
    put_u16(payload, zero + TUNNEL_PAYLOAD_TYPE, payload_type)
    put_u8(payload, zero + TUNNEL_PAYLOAD_LENGTH, payload_length)
    clear(payload, zero + TUNNEL_PAYLOAD, zero + TUNNEL_PAYLOAD + 128)
    return TUNNEL_LENGTH


@kernel
def decode_tunnel(payload: Bytes) -> tuple[int, int, int, int]:
    """Returns the scalar fields of a TUNNEL: target_system, target_component, payload_type, payload_length."""
    zero = int(np.int64(0))
    return (
        get_u8(payload, zero + TUNNEL_TARGET_SYSTEM),
        get_u8(payload, zero + TUNNEL_TARGET_COMPONENT),
        get_u16(payload, zero + TUNNEL_PAYLOAD_TYPE),
        get_u8(payload, zero + TUNNEL_PAYLOAD_LENGTH),
    )


@kernel
def put_tunnel_payload(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 127) of `payload`."""
    put_u8(payload, TUNNEL_PAYLOAD + i, value)


@kernel
def get_tunnel_payload(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 127) of `payload`."""
    return get_u8(payload, TUNNEL_PAYLOAD + i)


# -- ESC_TELEMETRY_1_TO_4 ---------------------------------------------------------------------------------------------

ESC_TELEMETRY_1_TO_4 = 11030
ESC_TELEMETRY_1_TO_4_LENGTH = 44
ESC_TELEMETRY_1_TO_4_TEMPERATURE = 40  # uint8_t[4] [degC]
ESC_TELEMETRY_1_TO_4_VOLTAGE = 0  # uint16_t[4] [cV]
ESC_TELEMETRY_1_TO_4_CURRENT = 8  # uint16_t[4] [cA]
ESC_TELEMETRY_1_TO_4_TOTALCURRENT = 16  # uint16_t[4] [mAh]
ESC_TELEMETRY_1_TO_4_RPM = 24  # uint16_t[4] [rpm]
ESC_TELEMETRY_1_TO_4_COUNT = 32  # uint16_t[4]


@kernel
def encode_esc_telemetry_1_to_4(payload: Bytes) -> int:
    """Fills `payload` with an ESC_TELEMETRY_1_TO_4; returns ESC_TELEMETRY_1_TO_4_LENGTH."""
    zero = int(np.int64(0))
    clear(payload, zero + ESC_TELEMETRY_1_TO_4_TEMPERATURE, zero + ESC_TELEMETRY_1_TO_4_TEMPERATURE + 4)
    clear(payload, zero + ESC_TELEMETRY_1_TO_4_VOLTAGE, zero + ESC_TELEMETRY_1_TO_4_VOLTAGE + 8)
    clear(payload, zero + ESC_TELEMETRY_1_TO_4_CURRENT, zero + ESC_TELEMETRY_1_TO_4_CURRENT + 8)
    clear(payload, zero + ESC_TELEMETRY_1_TO_4_TOTALCURRENT, zero + ESC_TELEMETRY_1_TO_4_TOTALCURRENT + 8)
    clear(payload, zero + ESC_TELEMETRY_1_TO_4_RPM, zero + ESC_TELEMETRY_1_TO_4_RPM + 8)
    clear(payload, zero + ESC_TELEMETRY_1_TO_4_COUNT, zero + ESC_TELEMETRY_1_TO_4_COUNT + 8)
    return ESC_TELEMETRY_1_TO_4_LENGTH


@kernel
def put_esc_telemetry_1_to_4_temperature(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 3) of `temperature`."""
    put_u8(payload, ESC_TELEMETRY_1_TO_4_TEMPERATURE + i, value)


@kernel
def get_esc_telemetry_1_to_4_temperature(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 3) of `temperature`."""
    return get_u8(payload, ESC_TELEMETRY_1_TO_4_TEMPERATURE + i)


@kernel
def put_esc_telemetry_1_to_4_voltage(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 3) of `voltage`."""
    put_u16(payload, ESC_TELEMETRY_1_TO_4_VOLTAGE + 2 * i, value)


@kernel
def get_esc_telemetry_1_to_4_voltage(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 3) of `voltage`."""
    return get_u16(payload, ESC_TELEMETRY_1_TO_4_VOLTAGE + 2 * i)


@kernel
def put_esc_telemetry_1_to_4_current(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 3) of `current`."""
    put_u16(payload, ESC_TELEMETRY_1_TO_4_CURRENT + 2 * i, value)


@kernel
def get_esc_telemetry_1_to_4_current(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 3) of `current`."""
    return get_u16(payload, ESC_TELEMETRY_1_TO_4_CURRENT + 2 * i)


@kernel
def put_esc_telemetry_1_to_4_totalcurrent(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 3) of `totalcurrent`."""
    put_u16(payload, ESC_TELEMETRY_1_TO_4_TOTALCURRENT + 2 * i, value)


@kernel
def get_esc_telemetry_1_to_4_totalcurrent(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 3) of `totalcurrent`."""
    return get_u16(payload, ESC_TELEMETRY_1_TO_4_TOTALCURRENT + 2 * i)


@kernel
def put_esc_telemetry_1_to_4_rpm(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 3) of `rpm`."""
    put_u16(payload, ESC_TELEMETRY_1_TO_4_RPM + 2 * i, value)


@kernel
def get_esc_telemetry_1_to_4_rpm(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 3) of `rpm`."""
    return get_u16(payload, ESC_TELEMETRY_1_TO_4_RPM + 2 * i)


@kernel
def put_esc_telemetry_1_to_4_count(payload: Bytes, i: int, value: int) -> None:
    """Sets element i (0 to 3) of `count`."""
    put_u16(payload, ESC_TELEMETRY_1_TO_4_COUNT + 2 * i, value)


@kernel
def get_esc_telemetry_1_to_4_count(payload: Bytes, i: int) -> int:
    """Returns element i (0 to 3) of `count`."""
    return get_u16(payload, ESC_TELEMETRY_1_TO_4_COUNT + 2 * i)


# -- enumerations -----------------------------------------------------------------------------------------------------

# MAV_TYPE
MAV_TYPE_GENERIC = 0
MAV_TYPE_FIXED_WING = 1
MAV_TYPE_QUADROTOR = 2
MAV_TYPE_COAXIAL = 3
MAV_TYPE_HELICOPTER = 4
MAV_TYPE_ANTENNA_TRACKER = 5
MAV_TYPE_GCS = 6
MAV_TYPE_AIRSHIP = 7
MAV_TYPE_FREE_BALLOON = 8
MAV_TYPE_ROCKET = 9
MAV_TYPE_GROUND_ROVER = 10
MAV_TYPE_SURFACE_BOAT = 11
MAV_TYPE_SUBMARINE = 12
MAV_TYPE_HEXAROTOR = 13
MAV_TYPE_OCTOROTOR = 14
MAV_TYPE_TRICOPTER = 15
MAV_TYPE_FLAPPING_WING = 16
MAV_TYPE_KITE = 17
MAV_TYPE_ONBOARD_CONTROLLER = 18
MAV_TYPE_VTOL_DUOROTOR = 19
MAV_TYPE_VTOL_QUADROTOR = 20
MAV_TYPE_VTOL_TILTROTOR = 21
MAV_TYPE_VTOL_RESERVED2 = 22
MAV_TYPE_VTOL_RESERVED3 = 23
MAV_TYPE_VTOL_RESERVED4 = 24
MAV_TYPE_VTOL_RESERVED5 = 25
MAV_TYPE_GIMBAL = 26
MAV_TYPE_ADSB = 27
MAV_TYPE_PARAFOIL = 28
MAV_TYPE_DODECAROTOR = 29
MAV_TYPE_CAMERA = 30
MAV_TYPE_CHARGING_STATION = 31
MAV_TYPE_FLARM = 32
MAV_TYPE_SERVO = 33
MAV_TYPE_ODID = 34
MAV_TYPE_DECAROTOR = 35
MAV_TYPE_BATTERY = 36
MAV_TYPE_PARACHUTE = 37
MAV_TYPE_LOG = 38
MAV_TYPE_OSD = 39
MAV_TYPE_IMU = 40
MAV_TYPE_GPS = 41
MAV_TYPE_WINCH = 42
MAV_TYPE_GENERIC_MULTIROTOR = 43
MAV_TYPE_ILLUMINATOR = 44
MAV_TYPE_SPACECRAFT_ORBITER = 45
MAV_TYPE_GROUND_QUADRUPED = 46
MAV_TYPE_VTOL_GYRODYNE = 47
MAV_TYPE_GRIPPER = 48

# MAV_AUTOPILOT
MAV_AUTOPILOT_GENERIC = 0
MAV_AUTOPILOT_RESERVED = 1
MAV_AUTOPILOT_SLUGS = 2
MAV_AUTOPILOT_ARDUPILOTMEGA = 3
MAV_AUTOPILOT_OPENPILOT = 4
MAV_AUTOPILOT_GENERIC_WAYPOINTS_ONLY = 5
MAV_AUTOPILOT_GENERIC_WAYPOINTS_AND_SIMPLE_NAVIGATION_ONLY = 6
MAV_AUTOPILOT_GENERIC_MISSION_FULL = 7
MAV_AUTOPILOT_INVALID = 8
MAV_AUTOPILOT_PPZ = 9
MAV_AUTOPILOT_UDB = 10
MAV_AUTOPILOT_FP = 11
MAV_AUTOPILOT_PX4 = 12
MAV_AUTOPILOT_SMACCMPILOT = 13
MAV_AUTOPILOT_AUTOQUAD = 14
MAV_AUTOPILOT_ARMAZILA = 15
MAV_AUTOPILOT_AEROB = 16
MAV_AUTOPILOT_ASLUAV = 17
MAV_AUTOPILOT_SMARTAP = 18
MAV_AUTOPILOT_AIRRAILS = 19
MAV_AUTOPILOT_REFLEX = 20

# MAV_COMPONENT
MAV_COMP_ID_ALL = 0
MAV_COMP_ID_AUTOPILOT1 = 1
MAV_COMP_ID_USER1 = 25
MAV_COMP_ID_USER2 = 26
MAV_COMP_ID_USER3 = 27
MAV_COMP_ID_USER4 = 28
MAV_COMP_ID_USER5 = 29
MAV_COMP_ID_USER6 = 30
MAV_COMP_ID_USER7 = 31
MAV_COMP_ID_USER8 = 32
MAV_COMP_ID_USER9 = 33
MAV_COMP_ID_USER10 = 34
MAV_COMP_ID_USER11 = 35
MAV_COMP_ID_USER12 = 36
MAV_COMP_ID_USER13 = 37
MAV_COMP_ID_USER14 = 38
MAV_COMP_ID_USER15 = 39
MAV_COMP_ID_USER16 = 40
MAV_COMP_ID_USER17 = 41
MAV_COMP_ID_USER18 = 42
MAV_COMP_ID_USER19 = 43
MAV_COMP_ID_USER20 = 44
MAV_COMP_ID_USER21 = 45
MAV_COMP_ID_USER22 = 46
MAV_COMP_ID_USER23 = 47
MAV_COMP_ID_USER24 = 48
MAV_COMP_ID_USER25 = 49
MAV_COMP_ID_USER26 = 50
MAV_COMP_ID_USER27 = 51
MAV_COMP_ID_USER28 = 52
MAV_COMP_ID_USER29 = 53
MAV_COMP_ID_USER30 = 54
MAV_COMP_ID_USER31 = 55
MAV_COMP_ID_USER32 = 56
MAV_COMP_ID_USER33 = 57
MAV_COMP_ID_USER34 = 58
MAV_COMP_ID_USER35 = 59
MAV_COMP_ID_USER36 = 60
MAV_COMP_ID_USER37 = 61
MAV_COMP_ID_USER38 = 62
MAV_COMP_ID_USER39 = 63
MAV_COMP_ID_USER40 = 64
MAV_COMP_ID_USER41 = 65
MAV_COMP_ID_USER42 = 66
MAV_COMP_ID_USER43 = 67
MAV_COMP_ID_TELEMETRY_RADIO = 68
MAV_COMP_ID_USER45 = 69
MAV_COMP_ID_USER46 = 70
MAV_COMP_ID_USER47 = 71
MAV_COMP_ID_USER48 = 72
MAV_COMP_ID_USER49 = 73
MAV_COMP_ID_USER50 = 74
MAV_COMP_ID_USER51 = 75
MAV_COMP_ID_USER52 = 76
MAV_COMP_ID_USER53 = 77
MAV_COMP_ID_USER54 = 78
MAV_COMP_ID_USER55 = 79
MAV_COMP_ID_USER56 = 80
MAV_COMP_ID_USER57 = 81
MAV_COMP_ID_USER58 = 82
MAV_COMP_ID_USER59 = 83
MAV_COMP_ID_USER60 = 84
MAV_COMP_ID_USER61 = 85
MAV_COMP_ID_USER62 = 86
MAV_COMP_ID_USER63 = 87
MAV_COMP_ID_USER64 = 88
MAV_COMP_ID_USER65 = 89
MAV_COMP_ID_USER66 = 90
MAV_COMP_ID_USER67 = 91
MAV_COMP_ID_USER68 = 92
MAV_COMP_ID_USER69 = 93
MAV_COMP_ID_USER70 = 94
MAV_COMP_ID_USER71 = 95
MAV_COMP_ID_USER72 = 96
MAV_COMP_ID_USER73 = 97
MAV_COMP_ID_USER74 = 98
MAV_COMP_ID_USER75 = 99
MAV_COMP_ID_CAMERA = 100
MAV_COMP_ID_CAMERA2 = 101
MAV_COMP_ID_CAMERA3 = 102
MAV_COMP_ID_CAMERA4 = 103
MAV_COMP_ID_CAMERA5 = 104
MAV_COMP_ID_CAMERA6 = 105
MAV_COMP_ID_SERVO1 = 140
MAV_COMP_ID_SERVO2 = 141
MAV_COMP_ID_SERVO3 = 142
MAV_COMP_ID_SERVO4 = 143
MAV_COMP_ID_SERVO5 = 144
MAV_COMP_ID_SERVO6 = 145
MAV_COMP_ID_SERVO7 = 146
MAV_COMP_ID_SERVO8 = 147
MAV_COMP_ID_SERVO9 = 148
MAV_COMP_ID_SERVO10 = 149
MAV_COMP_ID_SERVO11 = 150
MAV_COMP_ID_SERVO12 = 151
MAV_COMP_ID_SERVO13 = 152
MAV_COMP_ID_SERVO14 = 153
MAV_COMP_ID_GIMBAL = 154
MAV_COMP_ID_LOG = 155
MAV_COMP_ID_ADSB = 156
MAV_COMP_ID_OSD = 157
MAV_COMP_ID_PERIPHERAL = 158
MAV_COMP_ID_QX1_GIMBAL = 159
MAV_COMP_ID_FLARM = 160
MAV_COMP_ID_PARACHUTE = 161
MAV_COMP_ID_WINCH = 169
MAV_COMP_ID_GIMBAL2 = 171
MAV_COMP_ID_GIMBAL3 = 172
MAV_COMP_ID_GIMBAL4 = 173
MAV_COMP_ID_GIMBAL5 = 174
MAV_COMP_ID_GIMBAL6 = 175
MAV_COMP_ID_BATTERY = 180
MAV_COMP_ID_BATTERY2 = 181
MAV_COMP_ID_MAVCAN = 189
MAV_COMP_ID_MISSIONPLANNER = 190
MAV_COMP_ID_ONBOARD_COMPUTER = 191
MAV_COMP_ID_ONBOARD_COMPUTER2 = 192
MAV_COMP_ID_ONBOARD_COMPUTER3 = 193
MAV_COMP_ID_ONBOARD_COMPUTER4 = 194
MAV_COMP_ID_PATHPLANNER = 195
MAV_COMP_ID_OBSTACLE_AVOIDANCE = 196
MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY = 197
MAV_COMP_ID_PAIRING_MANAGER = 198
MAV_COMP_ID_IMU = 200
MAV_COMP_ID_IMU_2 = 201
MAV_COMP_ID_IMU_3 = 202
MAV_COMP_ID_GPS = 220
MAV_COMP_ID_GPS2 = 221
MAV_COMP_ID_ODID_TXRX_1 = 236
MAV_COMP_ID_ODID_TXRX_2 = 237
MAV_COMP_ID_ODID_TXRX_3 = 238
MAV_COMP_ID_UDP_BRIDGE = 240
MAV_COMP_ID_UART_BRIDGE = 241
MAV_COMP_ID_TUNNEL_NODE = 242
MAV_COMP_ID_ILLUMINATOR = 243
MAV_COMP_ID_SYSTEM_CONTROL = 250

# MAV_STATE
MAV_STATE_UNINIT = 0
MAV_STATE_BOOT = 1
MAV_STATE_CALIBRATING = 2
MAV_STATE_STANDBY = 3
MAV_STATE_ACTIVE = 4
MAV_STATE_CRITICAL = 5
MAV_STATE_EMERGENCY = 6
MAV_STATE_POWEROFF = 7
MAV_STATE_FLIGHT_TERMINATION = 8

# MAV_MODE_FLAG
MAV_MODE_FLAG_CUSTOM_MODE_ENABLED = 1
MAV_MODE_FLAG_TEST_ENABLED = 2
MAV_MODE_FLAG_AUTO_ENABLED = 4
MAV_MODE_FLAG_GUIDED_ENABLED = 8
MAV_MODE_FLAG_STABILIZE_ENABLED = 16
MAV_MODE_FLAG_HIL_ENABLED = 32
MAV_MODE_FLAG_MANUAL_INPUT_ENABLED = 64
MAV_MODE_FLAG_SAFETY_ARMED = 128

# MAV_LANDED_STATE
MAV_LANDED_STATE_UNDEFINED = 0
MAV_LANDED_STATE_ON_GROUND = 1
MAV_LANDED_STATE_IN_AIR = 2
MAV_LANDED_STATE_TAKEOFF = 3
MAV_LANDED_STATE_LANDING = 4

# MAV_SEVERITY
MAV_SEVERITY_EMERGENCY = 0
MAV_SEVERITY_ALERT = 1
MAV_SEVERITY_CRITICAL = 2
MAV_SEVERITY_ERROR = 3
MAV_SEVERITY_WARNING = 4
MAV_SEVERITY_NOTICE = 5
MAV_SEVERITY_INFO = 6
MAV_SEVERITY_DEBUG = 7

# COPTER_MODE
COPTER_MODE_STABILIZE = 0
COPTER_MODE_ACRO = 1
COPTER_MODE_ALT_HOLD = 2
COPTER_MODE_AUTO = 3
COPTER_MODE_GUIDED = 4
COPTER_MODE_LOITER = 5
COPTER_MODE_RTL = 6
COPTER_MODE_CIRCLE = 7
COPTER_MODE_LAND = 9
COPTER_MODE_DRIFT = 11
COPTER_MODE_SPORT = 13
COPTER_MODE_FLIP = 14
COPTER_MODE_AUTOTUNE = 15
COPTER_MODE_POSHOLD = 16
COPTER_MODE_BRAKE = 17
COPTER_MODE_THROW = 18
COPTER_MODE_AVOID_ADSB = 19
COPTER_MODE_GUIDED_NOGPS = 20
COPTER_MODE_SMART_RTL = 21
COPTER_MODE_FLOWHOLD = 22
COPTER_MODE_FOLLOW = 23
COPTER_MODE_ZIGZAG = 24
COPTER_MODE_SYSTEMID = 25
COPTER_MODE_AUTOROTATE = 26
COPTER_MODE_AUTO_RTL = 27
COPTER_MODE_TURTLE = 28

# ROVER_MODE
ROVER_MODE_MANUAL = 0
ROVER_MODE_ACRO = 1
ROVER_MODE_STEERING = 3
ROVER_MODE_HOLD = 4
ROVER_MODE_LOITER = 5
ROVER_MODE_FOLLOW = 6
ROVER_MODE_SIMPLE = 7
ROVER_MODE_DOCK = 8
ROVER_MODE_CIRCLE = 9
ROVER_MODE_AUTO = 10
ROVER_MODE_RTL = 11
ROVER_MODE_SMART_RTL = 12
ROVER_MODE_GUIDED = 15
ROVER_MODE_INITIALIZING = 16

# PLANE_MODE
PLANE_MODE_MANUAL = 0
PLANE_MODE_CIRCLE = 1
PLANE_MODE_STABILIZE = 2
PLANE_MODE_TRAINING = 3
PLANE_MODE_ACRO = 4
PLANE_MODE_FLY_BY_WIRE_A = 5
PLANE_MODE_FLY_BY_WIRE_B = 6
PLANE_MODE_CRUISE = 7
PLANE_MODE_AUTOTUNE = 8
PLANE_MODE_AUTO = 10
PLANE_MODE_RTL = 11
PLANE_MODE_LOITER = 12
PLANE_MODE_TAKEOFF = 13
PLANE_MODE_AVOID_ADSB = 14
PLANE_MODE_GUIDED = 15
PLANE_MODE_INITIALIZING = 16
PLANE_MODE_QSTABILIZE = 17
PLANE_MODE_QHOVER = 18
PLANE_MODE_QLOITER = 19
PLANE_MODE_QLAND = 20
PLANE_MODE_QRTL = 21
PLANE_MODE_QAUTOTUNE = 22
PLANE_MODE_QACRO = 23
PLANE_MODE_THERMAL = 24
PLANE_MODE_LOITER_ALT_QLAND = 25
PLANE_MODE_AUTOLAND = 26

# MAV_CMD
MAV_CMD_NAV_WAYPOINT = 16
MAV_CMD_NAV_LOITER_UNLIM = 17
MAV_CMD_NAV_LOITER_TURNS = 18
MAV_CMD_NAV_LOITER_TIME = 19
MAV_CMD_NAV_RETURN_TO_LAUNCH = 20
MAV_CMD_NAV_LAND = 21
MAV_CMD_NAV_TAKEOFF = 22
MAV_CMD_NAV_LAND_LOCAL = 23
MAV_CMD_NAV_TAKEOFF_LOCAL = 24
MAV_CMD_NAV_FOLLOW = 25
MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT = 30
MAV_CMD_NAV_LOITER_TO_ALT = 31
MAV_CMD_DO_FOLLOW = 32
MAV_CMD_DO_FOLLOW_REPOSITION = 33
MAV_CMD_DO_ORBIT = 34
MAV_CMD_DO_FIGURE_EIGHT = 35
MAV_CMD_NAV_ARC_WAYPOINT = 36
MAV_CMD_NAV_ROI = 80
MAV_CMD_NAV_PATHPLANNING = 81
MAV_CMD_NAV_SPLINE_WAYPOINT = 82
MAV_CMD_NAV_ALTITUDE_WAIT = 83
MAV_CMD_NAV_VTOL_TAKEOFF = 84
MAV_CMD_NAV_VTOL_LAND = 85
MAV_CMD_NAV_GUIDED_ENABLE = 92
MAV_CMD_NAV_DELAY = 93
MAV_CMD_NAV_PAYLOAD_PLACE = 94
MAV_CMD_NAV_LAST = 95
MAV_CMD_CONDITION_DELAY = 112
MAV_CMD_CONDITION_CHANGE_ALT = 113
MAV_CMD_CONDITION_DISTANCE = 114
MAV_CMD_CONDITION_YAW = 115
MAV_CMD_CONDITION_LAST = 159
MAV_CMD_DO_SET_MODE = 176
MAV_CMD_DO_JUMP = 177
MAV_CMD_DO_CHANGE_SPEED = 178
MAV_CMD_DO_SET_HOME = 179
MAV_CMD_DO_SET_PARAMETER = 180
MAV_CMD_DO_SET_RELAY = 181
MAV_CMD_DO_REPEAT_RELAY = 182
MAV_CMD_DO_SET_SERVO = 183
MAV_CMD_DO_REPEAT_SERVO = 184
MAV_CMD_DO_FLIGHTTERMINATION = 185
MAV_CMD_DO_CHANGE_ALTITUDE = 186
MAV_CMD_DO_SET_ACTUATOR = 187
MAV_CMD_DO_RETURN_PATH_START = 188
MAV_CMD_DO_LAND_START = 189
MAV_CMD_DO_RALLY_LAND = 190
MAV_CMD_DO_GO_AROUND = 191
MAV_CMD_DO_REPOSITION = 192
MAV_CMD_DO_PAUSE_CONTINUE = 193
MAV_CMD_DO_SET_REVERSE = 194
MAV_CMD_DO_SET_ROI_LOCATION = 195
MAV_CMD_DO_SET_ROI_WPNEXT_OFFSET = 196
MAV_CMD_DO_SET_ROI_NONE = 197
MAV_CMD_DO_SET_ROI_SYSID = 198
MAV_CMD_DO_CONTROL_VIDEO = 200
MAV_CMD_DO_SET_ROI = 201
MAV_CMD_DO_DIGICAM_CONFIGURE = 202
MAV_CMD_DO_DIGICAM_CONTROL = 203
MAV_CMD_DO_MOUNT_CONFIGURE = 204
MAV_CMD_DO_MOUNT_CONTROL = 205
MAV_CMD_DO_SET_CAM_TRIGG_DIST = 206
MAV_CMD_DO_FENCE_ENABLE = 207
MAV_CMD_DO_PARACHUTE = 208
MAV_CMD_DO_MOTOR_TEST = 209
MAV_CMD_DO_INVERTED_FLIGHT = 210
MAV_CMD_DO_GRIPPER = 211
MAV_CMD_DO_AUTOTUNE_ENABLE = 212
MAV_CMD_NAV_SET_YAW_SPEED = 213
MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL = 214
MAV_CMD_DO_SET_RESUME_REPEAT_DIST = 215
MAV_CMD_DO_SPRAYER = 216
MAV_CMD_DO_SEND_SCRIPT_MESSAGE = 217
MAV_CMD_DO_AUX_FUNCTION = 218
MAV_CMD_DO_MOUNT_CONTROL_QUAT = 220
MAV_CMD_DO_GUIDED_MASTER = 221
MAV_CMD_DO_GUIDED_LIMITS = 222
MAV_CMD_DO_ENGINE_CONTROL = 223
MAV_CMD_DO_SET_MISSION_CURRENT = 224
MAV_CMD_DO_LAST = 240
MAV_CMD_PREFLIGHT_CALIBRATION = 241
MAV_CMD_PREFLIGHT_SET_SENSOR_OFFSETS = 242
MAV_CMD_PREFLIGHT_UAVCAN = 243
MAV_CMD_PREFLIGHT_STORAGE = 245
MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN = 246
MAV_CMD_OVERRIDE_GOTO = 252
MAV_CMD_OBLIQUE_SURVEY = 260
MAV_CMD_DO_SET_STANDARD_MODE = 262
MAV_CMD_MISSION_START = 300
MAV_CMD_ACTUATOR_TEST = 310
MAV_CMD_CONFIGURE_ACTUATOR = 311
MAV_CMD_COMPONENT_ARM_DISARM = 400
MAV_CMD_RUN_PREARM_CHECKS = 401
MAV_CMD_ILLUMINATOR_ON_OFF = 405
MAV_CMD_DO_ILLUMINATOR_CONFIGURE = 406
MAV_CMD_GET_HOME_POSITION = 410
MAV_CMD_INJECT_FAILURE = 420
MAV_CMD_START_RX_PAIR = 500
MAV_CMD_GET_MESSAGE_INTERVAL = 510
MAV_CMD_SET_MESSAGE_INTERVAL = 511
MAV_CMD_REQUEST_MESSAGE = 512
MAV_CMD_REQUEST_PROTOCOL_VERSION = 519
MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES = 520
MAV_CMD_REQUEST_CAMERA_INFORMATION = 521
MAV_CMD_REQUEST_CAMERA_SETTINGS = 522
MAV_CMD_REQUEST_STORAGE_INFORMATION = 525
MAV_CMD_STORAGE_FORMAT = 526
MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS = 527
MAV_CMD_REQUEST_FLIGHT_INFORMATION = 528
MAV_CMD_RESET_CAMERA_SETTINGS = 529
MAV_CMD_SET_CAMERA_MODE = 530
MAV_CMD_SET_CAMERA_ZOOM = 531
MAV_CMD_SET_CAMERA_FOCUS = 532
MAV_CMD_SET_STORAGE_USAGE = 533
MAV_CMD_SET_CAMERA_SOURCE = 534
MAV_CMD_JUMP_TAG = 600
MAV_CMD_DO_JUMP_TAG = 601
MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW = 1000
MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE = 1001
MAV_CMD_IMAGE_START_CAPTURE = 2000
MAV_CMD_IMAGE_STOP_CAPTURE = 2001
MAV_CMD_REQUEST_CAMERA_IMAGE_CAPTURE = 2002
MAV_CMD_DO_TRIGGER_CONTROL = 2003
MAV_CMD_CAMERA_TRACK_POINT = 2004
MAV_CMD_CAMERA_TRACK_RECTANGLE = 2005
MAV_CMD_CAMERA_STOP_TRACKING = 2010
MAV_CMD_VIDEO_START_CAPTURE = 2500
MAV_CMD_VIDEO_STOP_CAPTURE = 2501
MAV_CMD_VIDEO_START_STREAMING = 2502
MAV_CMD_VIDEO_STOP_STREAMING = 2503
MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION = 2504
MAV_CMD_REQUEST_VIDEO_STREAM_STATUS = 2505
MAV_CMD_LOGGING_START = 2510
MAV_CMD_LOGGING_STOP = 2511
MAV_CMD_AIRFRAME_CONFIGURATION = 2520
MAV_CMD_CONTROL_HIGH_LATENCY = 2600
MAV_CMD_PANORAMA_CREATE = 2800
MAV_CMD_DO_VTOL_TRANSITION = 3000
MAV_CMD_ARM_AUTHORIZATION_REQUEST = 3001
MAV_CMD_SET_GUIDED_SUBMODE_STANDARD = 4000
MAV_CMD_SET_GUIDED_SUBMODE_CIRCLE = 4001
MAV_CMD_CONDITION_GATE = 4501
MAV_CMD_NAV_FENCE_RETURN_POINT = 5000
MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001
MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5002
MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION = 5003
MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION = 5004
MAV_CMD_NAV_RALLY_POINT = 5100
MAV_CMD_UAVCAN_GET_NODE_INFO = 5200
MAV_CMD_DO_SET_SAFETY_SWITCH_STATE = 5300
MAV_CMD_DO_ADSB_OUT_IDENT = 10001
MAV_CMD_LOWEHEISER_SET_STATE = 10151
MAV_CMD_PAYLOAD_PREPARE_DEPLOY = 30001
MAV_CMD_PAYLOAD_CONTROL_DEPLOY = 30002
MAV_CMD_WAYPOINT_USER_1 = 31000
MAV_CMD_WAYPOINT_USER_2 = 31001
MAV_CMD_WAYPOINT_USER_3 = 31002
MAV_CMD_WAYPOINT_USER_4 = 31003
MAV_CMD_WAYPOINT_USER_5 = 31004
MAV_CMD_SPATIAL_USER_1 = 31005
MAV_CMD_SPATIAL_USER_2 = 31006
MAV_CMD_SPATIAL_USER_3 = 31007
MAV_CMD_SPATIAL_USER_4 = 31008
MAV_CMD_SPATIAL_USER_5 = 31009
MAV_CMD_USER_1 = 31010
MAV_CMD_USER_2 = 31011
MAV_CMD_USER_3 = 31012
MAV_CMD_USER_4 = 31013
MAV_CMD_USER_5 = 31014
MAV_CMD_CAN_FORWARD = 32000
MAV_CMD_POWER_OFF_INITIATED = 42000
MAV_CMD_SOLO_BTN_FLY_CLICK = 42001
MAV_CMD_SOLO_BTN_FLY_HOLD = 42002
MAV_CMD_SOLO_BTN_PAUSE_CLICK = 42003
MAV_CMD_FIXED_MAG_CAL = 42004
MAV_CMD_FIXED_MAG_CAL_FIELD = 42005
MAV_CMD_FIXED_MAG_CAL_YAW = 42006
MAV_CMD_SET_EKF_SOURCE_SET = 42007
MAV_CMD_DO_START_MAG_CAL = 42424
MAV_CMD_DO_ACCEPT_MAG_CAL = 42425
MAV_CMD_DO_CANCEL_MAG_CAL = 42426
MAV_CMD_SET_FACTORY_TEST_MODE = 42427
MAV_CMD_DO_SEND_BANNER = 42428
MAV_CMD_ACCELCAL_VEHICLE_POS = 42429
MAV_CMD_GIMBAL_RESET = 42501
MAV_CMD_GIMBAL_AXIS_CALIBRATION_STATUS = 42502
MAV_CMD_GIMBAL_REQUEST_AXIS_CALIBRATION = 42503
MAV_CMD_GIMBAL_FULL_RESET = 42505
MAV_CMD_DO_WINCH = 42600
MAV_CMD_FLASH_BOOTLOADER = 42650
MAV_CMD_BATTERY_RESET = 42651
MAV_CMD_DEBUG_TRAP = 42700
MAV_CMD_SCRIPTING = 42701
MAV_CMD_NAV_SCRIPT_TIME = 42702
MAV_CMD_NAV_ATTITUDE_TIME = 42703
MAV_CMD_GUIDED_CHANGE_SPEED = 43000
MAV_CMD_GUIDED_CHANGE_ALTITUDE = 43001
MAV_CMD_GUIDED_CHANGE_HEADING = 43002
MAV_CMD_EXTERNAL_POSITION_ESTIMATE = 43003
MAV_CMD_SET_HAGL = 43005

# MAV_RESULT
MAV_RESULT_ACCEPTED = 0
MAV_RESULT_TEMPORARILY_REJECTED = 1
MAV_RESULT_DENIED = 2
MAV_RESULT_UNSUPPORTED = 3
MAV_RESULT_FAILED = 4
MAV_RESULT_IN_PROGRESS = 5
MAV_RESULT_COMMAND_LONG_ONLY = 7
MAV_RESULT_COMMAND_INT_ONLY = 8

# MAV_FRAME
MAV_FRAME_GLOBAL = 0
MAV_FRAME_LOCAL_NED = 1
MAV_FRAME_MISSION = 2
MAV_FRAME_GLOBAL_RELATIVE_ALT = 3
MAV_FRAME_LOCAL_ENU = 4
MAV_FRAME_GLOBAL_INT = 5
MAV_FRAME_GLOBAL_RELATIVE_ALT_INT = 6
MAV_FRAME_LOCAL_OFFSET_NED = 7
MAV_FRAME_BODY_NED = 8
MAV_FRAME_BODY_OFFSET_NED = 9
MAV_FRAME_GLOBAL_TERRAIN_ALT = 10
MAV_FRAME_GLOBAL_TERRAIN_ALT_INT = 11
MAV_FRAME_BODY_FRD = 12
MAV_FRAME_RESERVED_13 = 13
MAV_FRAME_RESERVED_14 = 14
MAV_FRAME_RESERVED_15 = 15
MAV_FRAME_RESERVED_16 = 16
MAV_FRAME_RESERVED_17 = 17
MAV_FRAME_RESERVED_18 = 18
MAV_FRAME_RESERVED_19 = 19
MAV_FRAME_LOCAL_FRD = 20
MAV_FRAME_LOCAL_FLU = 21

# MAV_DATA_STREAM
MAV_DATA_STREAM_ALL = 0
MAV_DATA_STREAM_RAW_SENSORS = 1
MAV_DATA_STREAM_EXTENDED_STATUS = 2
MAV_DATA_STREAM_RC_CHANNELS = 3
MAV_DATA_STREAM_RAW_CONTROLLER = 4
MAV_DATA_STREAM_POSITION = 6
MAV_DATA_STREAM_EXTRA1 = 10
MAV_DATA_STREAM_EXTRA2 = 11
MAV_DATA_STREAM_EXTRA3 = 12

# MAV_SYS_STATUS_SENSOR
MAV_SYS_STATUS_SENSOR_3D_GYRO = 1
MAV_SYS_STATUS_SENSOR_3D_ACCEL = 2
MAV_SYS_STATUS_SENSOR_3D_MAG = 4
MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE = 8
MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE = 16
MAV_SYS_STATUS_SENSOR_GPS = 32
MAV_SYS_STATUS_SENSOR_OPTICAL_FLOW = 64
MAV_SYS_STATUS_SENSOR_VISION_POSITION = 128
MAV_SYS_STATUS_SENSOR_LASER_POSITION = 256
MAV_SYS_STATUS_SENSOR_EXTERNAL_GROUND_TRUTH = 512
MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL = 1024
MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION = 2048
MAV_SYS_STATUS_SENSOR_YAW_POSITION = 4096
MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL = 8192
MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL = 16384
MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS = 32768
MAV_SYS_STATUS_SENSOR_RC_RECEIVER = 65536
MAV_SYS_STATUS_SENSOR_3D_GYRO2 = 131072
MAV_SYS_STATUS_SENSOR_3D_ACCEL2 = 262144
MAV_SYS_STATUS_SENSOR_3D_MAG2 = 524288
MAV_SYS_STATUS_GEOFENCE = 1048576
MAV_SYS_STATUS_AHRS = 2097152
MAV_SYS_STATUS_TERRAIN = 4194304
MAV_SYS_STATUS_REVERSE_MOTOR = 8388608
MAV_SYS_STATUS_LOGGING = 16777216
MAV_SYS_STATUS_SENSOR_BATTERY = 33554432
MAV_SYS_STATUS_SENSOR_PROXIMITY = 67108864
MAV_SYS_STATUS_SENSOR_SATCOM = 134217728
MAV_SYS_STATUS_PREARM_CHECK = 268435456
MAV_SYS_STATUS_OBSTACLE_AVOIDANCE = 536870912
MAV_SYS_STATUS_SENSOR_PROPULSION = 1073741824
MAV_SYS_STATUS_EXTENSION_USED = 2147483648

# MAV_PROTOCOL_CAPABILITY
MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT = 1
MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT = 2
MAV_PROTOCOL_CAPABILITY_MISSION_INT = 4
MAV_PROTOCOL_CAPABILITY_COMMAND_INT = 8
MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE = 16
MAV_PROTOCOL_CAPABILITY_FTP = 32
MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET = 64
MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED = 128
MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT = 256
MAV_PROTOCOL_CAPABILITY_TERRAIN = 512
MAV_PROTOCOL_CAPABILITY_RESERVED3 = 1024
MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION = 2048
MAV_PROTOCOL_CAPABILITY_COMPASS_CALIBRATION = 4096
MAV_PROTOCOL_CAPABILITY_MAVLINK2 = 8192
MAV_PROTOCOL_CAPABILITY_MISSION_FENCE = 16384
MAV_PROTOCOL_CAPABILITY_MISSION_RALLY = 32768
MAV_PROTOCOL_CAPABILITY_RESERVED2 = 65536
MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST = 131072
MAV_PROTOCOL_CAPABILITY_COMPONENT_IMPLEMENTS_GIMBAL_MANAGER = 262144
MAV_PROTOCOL_CAPABILITY_COMPONENT_ACCEPTS_GCS_CONTROL = 524288
MAV_PROTOCOL_CAPABILITY_GRIPPER = 1048576

# EKF_STATUS_FLAGS
EKF_ATTITUDE = 1
EKF_VELOCITY_HORIZ = 2
EKF_VELOCITY_VERT = 4
EKF_POS_HORIZ_REL = 8
EKF_POS_HORIZ_ABS = 16
EKF_POS_VERT_ABS = 32
EKF_POS_VERT_AGL = 64
EKF_CONST_POS_MODE = 128
EKF_PRED_POS_HORIZ_REL = 256
EKF_PRED_POS_HORIZ_ABS = 512
EKF_UNINITIALIZED = 1024
EKF_GPS_GLITCHING = 32768

# GPS_FIX_TYPE
GPS_FIX_TYPE_NO_GPS = 0
GPS_FIX_TYPE_NO_FIX = 1
GPS_FIX_TYPE_2D_FIX = 2
GPS_FIX_TYPE_3D_FIX = 3
GPS_FIX_TYPE_DGPS = 4
GPS_FIX_TYPE_RTK_FLOAT = 5
GPS_FIX_TYPE_RTK_FIXED = 6
GPS_FIX_TYPE_STATIC = 7
GPS_FIX_TYPE_PPP = 8

# POSITION_TARGET_TYPEMASK
POSITION_TARGET_TYPEMASK_X_IGNORE = 1
POSITION_TARGET_TYPEMASK_Y_IGNORE = 2
POSITION_TARGET_TYPEMASK_Z_IGNORE = 4
POSITION_TARGET_TYPEMASK_VX_IGNORE = 8
POSITION_TARGET_TYPEMASK_VY_IGNORE = 16
POSITION_TARGET_TYPEMASK_VZ_IGNORE = 32
POSITION_TARGET_TYPEMASK_AX_IGNORE = 64
POSITION_TARGET_TYPEMASK_AY_IGNORE = 128
POSITION_TARGET_TYPEMASK_AZ_IGNORE = 256
POSITION_TARGET_TYPEMASK_FORCE_SET = 512
POSITION_TARGET_TYPEMASK_YAW_IGNORE = 1024
POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE = 2048

# ATTITUDE_TARGET_TYPEMASK
ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE = 1
ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE = 2
ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE = 4
ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE = 64
ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE = 128

# MAV_PARAM_TYPE
MAV_PARAM_TYPE_UINT8 = 1
MAV_PARAM_TYPE_INT8 = 2
MAV_PARAM_TYPE_UINT16 = 3
MAV_PARAM_TYPE_INT16 = 4
MAV_PARAM_TYPE_UINT32 = 5
MAV_PARAM_TYPE_INT32 = 6
MAV_PARAM_TYPE_UINT64 = 7
MAV_PARAM_TYPE_INT64 = 8
MAV_PARAM_TYPE_REAL32 = 9
MAV_PARAM_TYPE_REAL64 = 10

# MAV_MISSION_RESULT
MAV_MISSION_ACCEPTED = 0
MAV_MISSION_ERROR = 1
MAV_MISSION_UNSUPPORTED_FRAME = 2
MAV_MISSION_UNSUPPORTED = 3
MAV_MISSION_NO_SPACE = 4
MAV_MISSION_INVALID = 5
MAV_MISSION_INVALID_PARAM1 = 6
MAV_MISSION_INVALID_PARAM2 = 7
MAV_MISSION_INVALID_PARAM3 = 8
MAV_MISSION_INVALID_PARAM4 = 9
MAV_MISSION_INVALID_PARAM5_X = 10
MAV_MISSION_INVALID_PARAM6_Y = 11
MAV_MISSION_INVALID_PARAM7 = 12
MAV_MISSION_INVALID_SEQUENCE = 13
MAV_MISSION_DENIED = 14
MAV_MISSION_OPERATION_CANCELLED = 15

# MAV_MISSION_TYPE
MAV_MISSION_TYPE_MISSION = 0
MAV_MISSION_TYPE_FENCE = 1
MAV_MISSION_TYPE_RALLY = 2
MAV_MISSION_TYPE_ALL = 255

# MAV_DO_REPOSITION_FLAGS
MAV_DO_REPOSITION_FLAGS_CHANGE_MODE = 1
MAV_DO_REPOSITION_FLAGS_RELATIVE_YAW = 2
