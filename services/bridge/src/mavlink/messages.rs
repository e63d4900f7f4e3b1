//! Supported messages, with their fields in wire order. Units and frames are those of the common dialect.

pub use super::catalogue::{COMMAND_LONG, HEARTBEAT, HIL_ACTUATOR_CONTROLS, HIL_GPS, HIL_SENSOR, STATUSTEXT};
use super::frame::Frame;
use super::reader::Reader;

/// HIL_SENSOR: readings of an inertial unit, a compass and a barometer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HilSensor {
    /// µs; PX4 uses it as its clock.
    pub time_usec: u64,
    /// Specific force, m/s², FRD.
    pub acceleration: [f32; 3],
    /// rad/s, FRD.
    pub gyro: [f32; 3],
    /// Gauss, FRD.
    pub magnetic: [f32; 3],
    /// hPa.
    pub absolute_pressure: f32,
    /// hPa.
    pub differential_pressure: f32,
    /// m.
    pub pressure_altitude: f32,
    /// °C.
    pub temperature: f32,
    /// Bit mask of updated fields.
    pub fields_updated: u32,
    /// Number of the unit.
    pub id: u8,
}

impl HilSensor {
    /// New acceleration.
    pub const ACCELERATION: u32 = 0x07;
    /// New rates.
    pub const GYRO: u32 = 0x38;
    /// New magnetic field.
    pub const MAGNETIC: u32 = 0x1c0;
    /// New pressure, altitude and temperature.
    pub const BAROMETER: u32 = 0x1a00;

    /// The payload.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = self.time_usec.to_le_bytes().to_vec();
        let floats = self.acceleration.iter().chain(&self.gyro).chain(&self.magnetic).chain([
            &self.absolute_pressure,
            &self.differential_pressure,
            &self.pressure_altitude,
            &self.temperature,
        ]);
        for float in floats {
            bytes.extend(float.to_le_bytes());
        }
        bytes.extend(self.fields_updated.to_le_bytes());
        bytes.push(self.id);
        bytes
    }

    /// Decodes a frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == HIL_SENSOR).then_some(Reader::of(frame))?;
        let time_usec = u64::from_le_bytes(reader.take());
        let mut float = || f32::from_le_bytes(reader.take());
        let mut vector = || [float(), float(), float()];
        Some(Self {
            time_usec,
            acceleration: vector(),
            gyro: vector(),
            magnetic: vector(),
            absolute_pressure: float(),
            differential_pressure: float(),
            pressure_altitude: float(),
            temperature: float(),
            fields_updated: u32::from_le_bytes(reader.take()),
            id: u8::from_le_bytes(reader.take()),
        })
    }
}

/// HIL_GPS: a fix.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HilGps {
    /// µs.
    pub time_usec: u64,
    /// 1e-7 degrees.
    pub latitude: i32,
    /// 1e-7 degrees.
    pub longitude: i32,
    /// mm.
    pub altitude: i32,
    /// cm.
    pub horizontal_error: u16,
    /// cm.
    pub vertical_error: u16,
    /// cm/s over ground.
    pub speed: u16,
    /// cm/s, NED.
    pub velocity: [i16; 3],
    /// Course, 0.01 degrees; 65535: unknown.
    pub course: u16,
    /// 3: three dimensions.
    pub fix_type: u8,
    /// Satellites seen.
    pub satellites: u8,
}

impl HilGps {
    /// The payload.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = self.time_usec.to_le_bytes().to_vec();
        for number in [self.latitude, self.longitude, self.altitude] {
            bytes.extend(number.to_le_bytes());
        }
        for number in [self.horizontal_error, self.vertical_error, self.speed] {
            bytes.extend(number.to_le_bytes());
        }
        for number in self.velocity {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend(self.course.to_le_bytes());
        bytes.extend([self.fix_type, self.satellites]);
        bytes
    }

    /// Decodes a frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == HIL_GPS).then_some(Reader::of(frame))?;
        let time_usec = u64::from_le_bytes(reader.take());
        let mut long = || i32::from_le_bytes(reader.take());
        let (latitude, longitude, altitude) = (long(), long(), long());
        let mut short = || u16::from_le_bytes(reader.take());
        Some(Self {
            time_usec,
            latitude,
            longitude,
            altitude,
            horizontal_error: short(),
            vertical_error: short(),
            speed: short(),
            velocity: [short(), short(), short()].map(u16::cast_signed),
            course: short(),
            fix_type: u8::from_le_bytes(reader.take()),
            satellites: u8::from_le_bytes(reader.take()),
        })
    }
}

/// HIL_ACTUATOR_CONTROLS: motor commands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HilActuatorControls {
    /// Time of the sample answered, µs.
    pub time_usec: u64,
    /// Bit 0: lockstep.
    pub flags: u64,
    /// Fractions.
    pub controls: [f32; 16],
    /// 128: armed.
    pub mode: u8,
}

impl HilActuatorControls {
    /// Bit of `mode`.
    pub const ARMED: u8 = 128;
    /// Bytes of a payload whose mode is not 0; the mode is the last of them.
    pub const LENGTH: usize = 81;

    /// The payload.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = self.time_usec.to_le_bytes().to_vec();
        bytes.extend(self.flags.to_le_bytes());
        for control in self.controls {
            bytes.extend(control.to_le_bytes());
        }
        bytes.push(self.mode);
        bytes
    }

    /// Decodes a frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == HIL_ACTUATOR_CONTROLS).then_some(Reader::of(frame))?;
        let (time_usec, flags) = (u64::from_le_bytes(reader.take()), u64::from_le_bytes(reader.take()));
        Some(Self {
            time_usec,
            flags,
            controls: std::array::from_fn(|_| f32::from_le_bytes(reader.take())),
            mode: u8::from_le_bytes(reader.take()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::encode;
    use super::super::hex::{bytes, frame};
    use super::*;

    /// Encoding of the same messages by pymavlink 2.4.50, from system 1, component 1, with the sequence numbers 7, 8 and 9.
    const SENSOR: &str = "fd3e00000701016b000087d61200000000000000003f000080be00001cc10000003e000000bf0000c03f0000803e0000003c0000e03e00e06e4400000000\
                          00a0f54300003841ff1fe1e7";
    const GPS: &str =
        "fd24000008010171000087d61200000000004c52401c44f41705bb7207001e00280000029cffc800d4feffff030ad943";
    const ACTUATORS: &str = "fd5100000901015d000087d612000000000001000000000000000000003f0000803e0000403f0000803f000000000000003e0000000000000000000000000000\
                             000000000000000000000000000000000000000000000000000081e551";

    #[test]
    fn val_sensors_are_pymavlink_s() {
        let sensor = HilSensor {
            time_usec: 1_234_567,
            acceleration: [0.5, -0.25, -9.75],
            gyro: [0.125, -0.5, 1.5],
            magnetic: [0.25, 0.007_812_5, 0.4375],
            absolute_pressure: 955.5,
            differential_pressure: 0.0,
            pressure_altitude: 491.25,
            temperature: 11.5,
            fields_updated: 0x1fff,
            id: 0,
        };
        assert_eq!(encode(7, 1, 1, HIL_SENSOR, &sensor.encode()), bytes(SENSOR));
        assert_eq!(HilSensor::read(&frame(SENSOR)), Some(sensor));
        assert_eq!(HilSensor::read(&frame(GPS)), None);
    }

    #[test]
    fn val_fixes_are_pymavlink_s() {
        let fix = HilGps {
            time_usec: 1_234_567,
            latitude: 473_977_420,
            longitude: 85_455_940,
            altitude: 488_123,
            horizontal_error: 30,
            vertical_error: 40,
            speed: 512,
            velocity: [-100, 200, -300],
            course: 65_535,
            fix_type: 3,
            satellites: 10,
        };
        assert_eq!(encode(8, 1, 1, HIL_GPS, &fix.encode()), bytes(GPS));
        assert_eq!(HilGps::read(&frame(GPS)), Some(fix));
    }

    #[test]
    fn val_actuators_are_pymavlink_s() {
        let mut controls = [0.0; 16];
        controls[..6].copy_from_slice(&[0.5, 0.25, 0.75, 1.0, 0.0, 0.125]);
        let answer = HilActuatorControls {
            time_usec: 1_234_567,
            flags: 1,
            controls,
            mode: 129,
        };
        assert_eq!(
            encode(9, 1, 1, HIL_ACTUATOR_CONTROLS, &answer.encode()),
            bytes(ACTUATORS)
        );
        assert_eq!(answer.encode().len(), HilActuatorControls::LENGTH);
        assert_eq!(frame(ACTUATORS).length, HilActuatorControls::LENGTH);
        assert_eq!(HilActuatorControls::read(&frame(ACTUATORS)), Some(answer));
    }
}
