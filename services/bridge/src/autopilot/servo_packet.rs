//! Encoding of ArduPilot's JSON backend, as observed in flight: servo packets from it, one line of JSON to it.
//!
//! From ArduPilot, little endian, packed: u16 magic | u16 frame rate, Hz | u32 frame count | u16 pulse\[16\], µs: 40 bytes with the magic
//! 18458; with 32 channels 72 bytes and 29569.
//!
//! To it: `\n{"timestamp":…}\n`. Its reader searches for key names and is not a JSON parser: there must be no space between a key's colon and
//! `[`, and no key may contain the name of a later one.

use rotortwin_wire::autopilot::Readings;

const MAGIC_16: u16 = 18458;
const MAGIC_32: u16 = 29569;
const HEADER: usize = 8;

/// Bytes of the longest packet.
pub const LONGEST: usize = HEADER + 2 * 32;
/// Valid pulses of a servo output, µs.
const PULSES_US: std::ops::RangeInclusive<u16> = 400..=2600;

/// One servo packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServoPacket {
    /// Requested rate, Hz.
    pub frame_rate_hz: u16,
    /// Counts from 0 since its start.
    pub frame: u32,
    /// 16 or 32.
    pub channels: usize,
    /// µs; 0: no pulse.
    pub pulses_us: [u16; 32],
}

impl ServoPacket {
    /// Decodes a datagram.
    ///
    /// # Errors
    /// States what was expected, and what was received.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let word = |at: usize| {
            let pair = bytes.get(at..at + 2)?;
            Some(u16::from_le_bytes([pair[0], pair[1]]))
        };
        let (length, magic) = (bytes.len(), word(0));
        let channels = match (length, magic) {
            (40, Some(MAGIC_16)) => 16,
            (72, Some(MAGIC_32)) => 32,
            (40 | 72, Some(magic)) => {
                return Err(format!(
                    "{length} bytes that begin with {magic}, expected {MAGIC_16} (16 channels, 40 bytes) or {MAGIC_32} (32, 72 bytes)"
                ));
            }
            _ => return Err(format!("{length} bytes, expected 40 (16 channels) or 72 (32 channels)")),
        };
        let mut pulses_us = [0; 32];
        for (channel, pulse) in pulses_us.iter_mut().enumerate().take(channels) {
            *pulse = word(HEADER + 2 * channel).unwrap_or(0);
        }
        let frame = word(4)
            .zip(word(6))
            .map_or(0, |(low, high)| u32::from(low) | u32::from(high) << 16);
        Ok(Self {
            frame_rate_hz: word(2).unwrap_or(0),
            frame,
            channels,
            pulses_us,
        })
    }

    /// The packet as ArduPilot sends it.
    pub fn encode(&self) -> Vec<u8> {
        let magic = if self.channels == 32 { MAGIC_32 } else { MAGIC_16 };
        let mut bytes = Vec::with_capacity(LONGEST);
        bytes.extend(magic.to_le_bytes());
        bytes.extend(self.frame_rate_hz.to_le_bytes());
        bytes.extend(self.frame.to_le_bytes());
        for pulse in &self.pulses_us[..self.channels] {
            bytes.extend(pulse.to_le_bytes());
        }
        bytes
    }

    /// The first of some channels with an invalid pulse: channel from 1, and pulse in µs.
    pub fn impossible_pulse(&self, channels: usize) -> Option<(usize, u16)> {
        let wrong = |pulse: &u16| *pulse != 0 && !PULSES_US.contains(pulse);
        let pulses = &self.pulses_us[..channels.min(self.channels)];
        let found = pulses.iter().position(wrong)?;
        Some((found + 1, pulses[found]))
    }
}

/// Channels of a transmitter, with pulses that are held all the time: sticks that somebody has left in place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RcChannels {
    pulses_us: [u16; MOST_RC],
    count: usize,
}

/// Most channels that the JSON backend takes.
const MOST_RC: usize = 12;
/// Pulses of a receiver, µs.
const RC_US: std::ops::RangeInclusive<u16> = 800..=2200;

impl RcChannels {
    /// From channel 1 on, µs; empty if there is no transmitter.
    pub fn pulses_us(&self) -> &[u16] {
        &self.pulses_us[..self.count]
    }
}

/// Pulses with `/` between them, such as 1500/1500/1000/1500.
impl std::str::FromStr for RcChannels {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || {
            format!(
                "'{text}': expected the pulses of 1 to {MOST_RC} channels, {} to {} µs each, such as 1500/1500/1000/1500",
                RC_US.start(),
                RC_US.end()
            )
        };
        let mut channels = Self::default();
        for part in text.split('/') {
            let pulse = part.parse().ok().filter(|pulse| RC_US.contains(pulse));
            let (Some(pulse), Some(place)) = (pulse, channels.pulses_us.get_mut(channels.count)) else {
                return Err(expected());
            };
            *place = pulse;
            channels.count += 1;
        }
        Ok(channels)
    }
}

impl std::fmt::Display for RcChannels {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let words: Vec<String> = self.pulses_us().iter().map(u16::to_string).collect();
        write!(out, "{}", words.join("/"))
    }
}

/// Writes the line that answers a servo packet.
pub fn write_answer(line: &mut String, readings: &Readings, rc: &RcChannels) {
    line.clear();
    let vector = |[x, y, z]: [f64; 3]| format!("[{x},{y},{z}]");
    line.push_str(&format!(
        "\n{{\"timestamp\":{:.9},\"imu\":{{\"gyro\":{},\"accel_body\":{}}},\"position\":{},\"attitude\":{},\"velocity\":{}",
        readings.time_ns as f64 * 1e-9,
        vector(readings.body_rates_rad_s),
        vector(readings.specific_force_m_s2),
        vector(readings.position_ned_m),
        vector(readings.attitude_rad),
        vector(readings.velocity_ned_m_s),
    ));
    if let Some(range) = readings.range_m {
        line.push_str(&format!(",\"rng_1\":{range}"));
    }
    // Builds that do not know these two ignore them.
    if !rc.pulses_us().is_empty() {
        let pulses = rc.pulses_us().iter().enumerate();
        let channels: Vec<String> = pulses
            .map(|(channel, pulse)| format!("\"rc_{}\":{pulse}", channel + 1))
            .collect();
        line.push_str(&format!(",\"rc\":{{{}}}", channels.join(",")));
    }
    if readings.battery_voltage_v > 0.0 {
        line.push_str(&format!(
            ",\"battery\":{{\"voltage\":{:.4},\"current\":{:.4}}}",
            readings.battery_voltage_v, readings.battery_current_a
        ));
    }
    line.push_str("}\n");
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn val_a_packet_by_hand() {
        let mut bytes = vec![0x1a, 0x48, 0xe8, 0x03, 0x39, 0x30, 0x01, 0x00];
        for channel in 0..16u16 {
            bytes.extend((1000 + channel).to_le_bytes());
        }
        let packet = ServoPacket::decode(&bytes).expect("a good packet");
        assert_eq!(
            (packet.frame_rate_hz, packet.frame, packet.channels),
            (1000, 0x1_3039, 16)
        );
        assert_eq!(packet.pulses_us[..3], [1000, 1001, 1002]);
        assert_eq!(packet.encode(), bytes);
        assert_eq!(packet.impossible_pulse(6), None);
    }

    #[test]
    fn val_32_channels() {
        let packet = ServoPacket {
            frame_rate_hz: 400,
            frame: u32::MAX,
            channels: 32,
            pulses_us: std::array::from_fn(|i| if i == 31 { 2000 } else { 0 }),
        };
        let bytes = packet.encode();
        assert_eq!((bytes.len(), &bytes[..2]), (72, &29569_u16.to_le_bytes()[..]));
        assert_eq!(ServoPacket::decode(&bytes), Ok(packet));
    }

    #[test]
    fn val_other_bytes_are_named() {
        let said = |bytes: &[u8]| ServoPacket::decode(bytes).unwrap_err();
        assert_eq!(said(&[]), "0 bytes, expected 40 (16 channels) or 72 (32 channels)");
        assert!(said(&[7; 40]).starts_with("40 bytes that begin with 1799, expected 18458"));
        let mut other = ServoPacket::decode(&good()).expect("good").encode();
        other.resize(72, 0);
        assert!(said(&other).starts_with("72 bytes that begin with 18458"));
    }

    fn good() -> Vec<u8> {
        ServoPacket {
            frame_rate_hz: 1000,
            frame: 1,
            channels: 16,
            pulses_us: [1000; 32],
        }
        .encode()
    }

    #[test]
    fn val_the_answer_is_a_line_that_a_search_for_keys_reads() {
        let readings = Readings {
            time_ns: 1_500_000,
            specific_force_m_s2: [1e-9, 0.0, -9.80665],
            position_ned_m: [1.25, -3.0, -0.179],
            range_m: Some(0.2),
            battery_voltage_v: 15.5,
            battery_current_a: 12.25,
            ..Readings::default()
        };
        let mut line = String::new();
        write_answer(&mut line, &readings, &RcChannels::default());
        assert_eq!(
            line,
            "\n{\"timestamp\":0.001500000,\"imu\":{\"gyro\":[0,0,0],\"accel_body\":[0.000000001,0,-9.80665]},\
             \"position\":[1.25,-3,-0.179],\"attitude\":[0,0,0],\"velocity\":[0,0,0],\"rng_1\":0.2,\"battery\":{\"voltage\":15.5000,\"current\":12.2500}}\n"
        );
        assert!(!line.contains(": ") && serde_json::from_str::<serde_json::Value>(line.trim()).is_ok());
        write_answer(
            &mut line,
            &readings,
            &"1500/1501/1000/2000".parse().expect("four channels"),
        );
        let rc = ",\"rng_1\":0.2,\"rc\":{\"rc_1\":1500,\"rc_2\":1501,\"rc_3\":1000,\"rc_4\":2000},\"battery\":{";
        assert!(line.contains(rc), "{line}");
        // ArduPilot finds the section and its keys by their first occurrence.
        assert_eq!((line.matches("rc\":").count(), line.matches("rc_1\":").count()), (1, 1));
        assert!(serde_json::from_str::<serde_json::Value>(line.trim()).is_ok());
    }

    #[test]
    fn val_channels_of_a_transmitter() {
        let read = |text: &str| text.parse::<RcChannels>();
        let twelve = "1500/1500/1000/1500/1800/800/2200/1000/1100/1200/1300/1400";
        assert_eq!(read(twelve).map(|rc| rc.to_string()), Ok(twelve.to_owned()));
        assert_eq!(read("1500").expect("one channel").pulses_us(), [1500]);
        for wrong in [
            "",
            "1500/",
            "799",
            "2201",
            "1500,1500",
            "1500/x",
            &format!("{twelve}/1500"),
        ] {
            assert_eq!(
                read(wrong),
                Err(format!(
                    "'{wrong}': expected the pulses of 1 to 12 channels, 800 to 2200 µs each, such as 1500/1500/1000/1500"
                ))
            );
        }
    }

    proptest! {
        #[test]
        fn prop_no_bytes_break_the_decoder(bytes in proptest::collection::vec(any::<u8>(), 0..100)) {
            if let Ok(packet) = ServoPacket::decode(&bytes) {
                prop_assert_eq!(packet.encode(), bytes);
            }
        }
    }
}
