//! Numbers of the messages that are spoken, and what their checksums begin with.

/// HEARTBEAT.
pub const HEARTBEAT: u32 = 0;
/// COMMAND_LONG.
pub const COMMAND_LONG: u32 = 76;
/// HIL_ACTUATOR_CONTROLS.
pub const HIL_ACTUATOR_CONTROLS: u32 = 93;
/// HIL_SENSOR.
pub const HIL_SENSOR: u32 = 107;
/// HIL_GPS.
pub const HIL_GPS: u32 = 113;
/// STATUSTEXT.
pub const STATUSTEXT: u32 = 253;

/// What the checksum of a message begins with besides its bytes; `None`: a message that is not spoken here.
pub fn crc_extra(message: u32) -> Option<u8> {
    Some(match message {
        HEARTBEAT => 50,
        COMMAND_LONG => 152,
        HIL_ACTUATOR_CONTROLS => 47,
        HIL_SENSOR => 108,
        HIL_GPS => 124,
        STATUSTEXT => 83,
        _ => return None,
    })
}
