//! The sixteen residual channels: names, units, groups.

use rotortwin_plant::effects::ChannelGroup;

/// Number of channels.
pub const CHANNELS: usize = 16;

/// First channel of F: accelerometer against force/mass, m/s², body x, y, z.
pub const F: usize = 0;
/// First channel of KV: derivative of the velocity against accelerometer and attitude, m/s², NED.
pub const KV: usize = 3;
/// First channel of M: angular acceleration against torque, rad/s², body x, y, z.
pub const M: usize = 6;
/// First channel of KA: derivative of the Euler angles against the gyroscope, rad/s.
pub const KA: usize = 9;
/// First channel of KP: derivative of the position against the velocity, m/s, NED.
pub const KP: usize = 12;
/// Battery voltage, V.
pub const V: usize = 15;

/// Short names, in order.
pub const NAMES: [&str; CHANNELS] = [
    "fx", "fy", "fz", "kv_north", "kv_east", "kv_down", "mx", "my", "mz", "ka_roll", "ka_pitch", "ka_yaw", "kp_north",
    "kp_east", "kp_down", "v",
];

/// What each compares, in words, in order.
pub const TITLES: [&str; CHANNELS] = [
    "forward force",
    "sideways force",
    "vertical force",
    "velocity north",
    "velocity east",
    "velocity down",
    "roll moment",
    "pitch moment",
    "yaw moment",
    "roll angle",
    "pitch angle",
    "yaw angle",
    "position north",
    "position east",
    "position down",
    "voltage",
];

/// Units of the residuals, in order.
pub const UNITS: [&str; CHANNELS] = [
    "m/s²", "m/s²", "m/s²", "m/s²", "m/s²", "m/s²", "rad/s²", "rad/s²", "rad/s²", "rad/s", "rad/s", "rad/s", "m/s",
    "m/s", "m/s", "V",
];

/// Group of a channel.
pub fn group(channel: usize) -> ChannelGroup {
    match channel {
        F..KV => ChannelGroup::Force,
        KV..M => ChannelGroup::VelocityKinematics,
        M..KA => ChannelGroup::Moment,
        KA..KP => ChannelGroup::AttitudeKinematics,
        KP..V => ChannelGroup::PositionKinematics,
        _ => ChannelGroup::Voltage,
    }
}

/// One number a channel, for each of the sixteen; empty where a channel is not available.
pub type PerChannel = [Vec<f64>; CHANNELS];
