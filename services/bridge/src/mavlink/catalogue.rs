//! Ids of the supported messages, and the initial bytes of their checksums.

/// HEARTBEAT.
pub const HEARTBEAT: u32 = 0;
/// SYS_STATUS.
pub const SYS_STATUS: u32 = 1;
/// GPS_RAW_INT.
pub const GPS_RAW_INT: u32 = 24;
/// ATTITUDE.
pub const ATTITUDE: u32 = 30;
/// LOCAL_POSITION_NED.
pub const LOCAL_POSITION_NED: u32 = 32;
/// GLOBAL_POSITION_INT.
pub const GLOBAL_POSITION_INT: u32 = 33;
/// SERVO_OUTPUT_RAW.
pub const SERVO_OUTPUT_RAW: u32 = 36;
/// COMMAND_LONG.
pub const COMMAND_LONG: u32 = 76;
/// COMMAND_ACK.
pub const COMMAND_ACK: u32 = 77;
/// SET_POSITION_TARGET_LOCAL_NED.
pub const SET_POSITION_TARGET_LOCAL_NED: u32 = 84;
/// HIL_ACTUATOR_CONTROLS.
pub const HIL_ACTUATOR_CONTROLS: u32 = 93;
/// HIL_SENSOR.
pub const HIL_SENSOR: u32 = 107;
/// HIL_GPS.
pub const HIL_GPS: u32 = 113;
/// BATTERY_STATUS.
pub const BATTERY_STATUS: u32 = 147;
/// AUTOPILOT_VERSION.
pub const AUTOPILOT_VERSION: u32 = 148;
/// STATUSTEXT.
pub const STATUSTEXT: u32 = 253;

/// CRC extra of a message; `None` for an unsupported one.
pub fn crc_extra(message: u32) -> Option<u8> {
    Some(match message {
        HEARTBEAT => 50,
        SYS_STATUS => 124,
        GPS_RAW_INT => 24,
        ATTITUDE => 39,
        LOCAL_POSITION_NED => 185,
        GLOBAL_POSITION_INT => 104,
        SERVO_OUTPUT_RAW => 222,
        COMMAND_LONG => 152,
        COMMAND_ACK => 143,
        SET_POSITION_TARGET_LOCAL_NED => 143,
        HIL_ACTUATOR_CONTROLS => 47,
        HIL_SENSOR => 108,
        HIL_GPS => 124,
        BATTERY_STATUS => 154,
        AUTOPILOT_VERSION => 178,
        STATUSTEXT => 83,
        _ => return None,
    })
}
