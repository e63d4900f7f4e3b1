//! Blackbox fields in units: the meaning of the numbers depends on header lines and firmware.
//!
//! Body axes of the family are forward, left, up. Added to the stream: `gyro[i]` (deg/s), `acc[i]` (g), `rpm[i]` (min⁻¹), `voltage_v`, `current_a`,
//! and of INAV `position[i]` (m, NED), `velocity[i]` (m/s, NED), `euler[i]` (deg, FRD in NED). Parameters `motor_low` and `motor_high` are the
//! motor values of duty 0 and 1, `acc_lpf_hz` and `gyro_lowpass_hz` (Hz) the lowest low-pass of either sensor, if any.

use super::super::{RawStream, SourceLog};
use super::Header;
use crate::log::low_pass::{BLACKBOX_ACCELEROMETER, BLACKBOX_GYRO};
use rotortwin_flight_core::MAX_ROTORS;

/// DShot: 48 is the least throttle, 2047 the most.
const DSHOT: (f64, f64) = (48.0, 2047.0);
/// Electrical revolutions per minute in one count of `eRPM` (Betaflight, `ERPM_PER_LSB` of drivers/dshot.c).
const ERPM_PER_COUNT: f64 = 100.0;
/// Magnet poles of a motor where nothing says how many: the firmware's default.
const USUAL_POLES: f64 = 14.0;

pub(super) fn in_units(header: &Header, stream: &mut RawStream, log: &mut SourceLog) {
    let firmware = header.text("Firmware revision").to_owned();
    let is_inav = firmware.starts_with("INAV");
    let (low, high) = motor_range(header);
    log.parameters.insert("motor_low".to_owned(), low);
    log.parameters.insert("motor_high".to_owned(), high);
    if !firmware.is_empty() {
        log.notes.push(format!("firmware: {firmware}"));
    }
    // High resolution: ten times the usual numbers.
    let fine = if header.number("blackbox_high_resolution") == Some(1.0) {
        0.1
    } else {
        1.0
    };
    let gyro_scale = gyro_scale(header) * fine;
    add(stream, "gyroADC", "gyro", &[gyro_scale; 3]);
    let one_g = header
        .number("acc_1G")
        .filter(|one_g| *one_g > 0.0)
        .unwrap_or_else(|| rest_level(stream));
    add(stream, "accSmooth", "acc", &[1.0 / one_g; 3]);
    let filters = low_passes(header, &firmware);
    log.parameters.extend(filters.map(|(name, hz)| (name.to_owned(), hz)));
    rotor_speeds(header.number("motor_poles"), stream, log);
    battery(&firmware, stream, log);
    if is_inav {
        // Tenths of degrees; nose down is positive there. Centimetres, up.
        add(stream, "attitude", "euler", &[0.1, -0.1, 0.1]);
        add(stream, "navPos", "position", &[0.01, 0.01, -0.01]);
        add(stream, "navVel", "velocity", &[0.01, 0.01, -0.01]);
    }
}

/// Corners of the low-pass filters, Hz; off (0) is left out.
fn low_passes(header: &Header, firmware: &str) -> impl Iterator<Item = (&'static str, f64)> {
    // Betaflight and Cleanflight write a hundred times its corner, INAV the corner (at most 255 Hz).
    let corner = header.number("acc_lpf_hz").filter(|hz| *hz > 0.0);
    let hundredfold = !firmware.starts_with("INAV");
    let of_accelerometer = corner.map(|hz| if hundredfold && hz > 255.0 { hz / 100.0 } else { hz });
    // The static ones, and the lower end of the one that moves with the throttle; either may be off.
    let of_gyro = [
        "gyro_lowpass_hz",
        "gyro_lowpass2_hz",
        "gyro_lowpass_dyn_hz",
        "gyro_lpf_hz",
    ]
    .into_iter()
    .filter_map(|key| header.number(key))
    .filter(|hz| *hz > 0.0)
    .reduce(f64::min);
    [(BLACKBOX_ACCELEROMETER, of_accelerometer), (BLACKBOX_GYRO, of_gyro)]
        .into_iter()
        .filter_map(|(name, hz)| Some((name, hz?)))
}

/// Rotor speeds from the telemetry of the ESCs (bidirectional DShot), numbered as the outputs `motor[i]` are: a turn of the rotor is one electrical
/// turn for each pair of poles.
pub(super) fn rotor_speeds(poles: Option<f64>, stream: &mut RawStream, log: &mut SourceLog) {
    let motors_of = |field: &str| {
        let has = |motor: &usize| column(stream, &format!("{field}[{motor}]")).is_some();
        (0..MAX_ROTORS).take_while(has).count()
    };
    // The second name is that of some releases and tools.
    let fields = ["eRPM", "eRPM(/100)"].map(|field| (field, motors_of(field)));
    let Some((field, motors)) = fields.into_iter().find(|(_, motors)| *motors > 0) else {
        return;
    };
    let poles = poles.filter(|poles| *poles >= 2.0).unwrap_or_else(|| {
        log.notes.push(format!(
            "eRPM: nothing says how many magnet poles the motors have; {USUAL_POLES} are taken, as the firmware does (for another number N set \
             factor = {USUAL_POLES} / N of rotor_speed in a mapping)"
        ));
        USUAL_POLES
    });
    let factor = ERPM_PER_COUNT / (0.5 * poles);
    add(stream, field, "rpm", &vec![factor; motors]);
}

/// Degrees per second of one count. Firmware before 2016 writes `gyro.scale`; Baseflight's is in radians per microsecond.
fn gyro_scale(header: &Header) -> f64 {
    /// No gyroscope has counts so small in degrees per second.
    const LEAST_DEG_S: f64 = 1e-5;
    let scale = ["gyro_scale", "gyro.scale"]
        .into_iter()
        .find_map(|key| header.number(key));
    match scale.filter(|scale| *scale > 0.0) {
        None => 1.0,
        Some(scale) if scale < LEAST_DEG_S => (scale * 1e6).to_degrees(),
        Some(scale) => scale,
    }
}

/// A group of columns times factors under another name, if all of them are there.
pub(super) fn add(stream: &mut RawStream, from: &str, to: &str, factors: &[f64]) {
    let columns: Option<Vec<Vec<f64>>> = (0..factors.len())
        .map(|index| column(stream, &format!("{from}[{index}]")).map(<[f64]>::to_vec))
        .collect();
    for (index, (column, factor)) in columns.into_iter().flatten().zip(factors).enumerate() {
        let scaled = column.into_iter().map(|value| value * factor).collect();
        stream.fields.push((format!("{to}[{index}]"), scaled));
    }
}

fn column<'a>(stream: &'a RawStream, name: &str) -> Option<&'a [f64]> {
    stream
        .fields
        .iter()
        .find(|(field, _)| field == name)
        .map(|(_, values)| values.as_slice())
}

/// Motor values of duty 0 and 1: DShot's, otherwise PWM from 1000 µs.
fn motor_range(header: &Header) -> (f64, f64) {
    match header.pair("motorOutput") {
        Some((low, high)) if low < 1000.0 && high <= DSHOT.1 => DSHOT,
        Some((low, high)) if high > low => (low.min(1000.0), high),
        _ => (1000.0, header.number("maxthrottle").unwrap_or(2000.0).max(1100.0)),
    }
}

/// Counts of 1 g where the header does not say: the power of two next to the median.
pub(super) fn rest_level(stream: &RawStream) -> f64 {
    let axes: Vec<&[f64]> = (0..3)
        .filter_map(|axis| column(stream, &format!("accSmooth[{axis}]")))
        .collect();
    let [x, y, z] = axes.as_slice() else { return 1.0 };
    let mut sizes: Vec<f64> = (0..x.len())
        .map(|row| (x[row].powi(2) + y[row].powi(2) + z[row].powi(2)).sqrt())
        .collect();
    let median = crate::log::resample::median(&mut sizes).unwrap_or(1.0).max(1.0);
    median.log2().round().exp2()
}

/// Hundredths of volts and amperes since Betaflight 4.0 and in INAV; before, tenths of volts, or a converter's counts.
fn battery(firmware: &str, stream: &mut RawStream, log: &mut SourceLog) {
    let (name, current) = match column(stream, "vbatLatest") {
        Some(_) => ("vbatLatest", "amperageLatest"),
        None => ("vbat", "amperage"),
    };
    let major: Option<f64> = firmware
        .strip_prefix("Betaflight ")
        .and_then(|version| version.split('.').next()?.trim().parse().ok());
    let volt = if firmware.starts_with("INAV")
        || firmware.starts_with("Betaflight 20")
        || major.is_some_and(|major| major >= 4.0)
    {
        0.01
    } else if major == Some(3.0) {
        0.1
    } else {
        if column(stream, name).is_some() {
            log.notes.push(format!(
                "{name}: the unit of the voltage in logs of this firmware depends on the board; left out"
            ));
        }
        return;
    };
    for (from, to, factor) in [(name, "voltage_v", volt), (current, "current_a", 0.01)] {
        if let Some(values) = column(stream, from) {
            let scaled = values.iter().map(|value| value * factor).collect();
            stream.fields.push((to.to_owned(), scaled));
        }
    }
}
