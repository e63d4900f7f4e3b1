//! Instruments of a flight controller, in addition to the estimator's output that controller and detectors get:
//! accelerometer, gyroscope, magnetometer, barometer, satellite receiver, range finder.
//!
//! They exist only if requested ([`Instruments::new`]), with random streams of their own, and do not affect the flight.
//! Readings may be taken at any increasing times. Noise of accelerometer and gyroscope is white with a density, so its
//! deviation is density/√Δt over the time Δt since the last reading; their biases walk. The others have white noise per
//! reading. All sit at the centre of mass. Not modelled: misalignment, temperature, multipath, wind on the barometer.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::error::{Refusal, all_in_range, in_range};
use crate::random::NormalStream;
use crate::sensing::home::{Home, pressure_altitude, standard_atmosphere};
use crate::vector::Vector3;

/// `[instruments]` of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InstrumentModel {
    /// Origin of NED on the Earth.
    pub home: Home,
    /// m/s²/√Hz.
    pub accelerometer_noise_m_s2_sqrt_hz: f64,
    /// Random walk of the bias, m/s²·√Hz: grows by this over √(1 s).
    pub accelerometer_bias_walk_m_s2_sqrt_s: f64,
    /// Largest reading, m/s².
    pub accelerometer_range_m_s2: f64,
    /// rad/s/√Hz.
    pub gyroscope_noise_rad_s_sqrt_hz: f64,
    /// Random walk of the bias, rad/s over √(1 s).
    pub gyroscope_bias_walk_rad_s_sqrt_s: f64,
    /// Largest reading, rad/s.
    pub gyroscope_range_rad_s: f64,
    /// The Earth's field at home, gauss, NED.
    pub magnetic_field_ned_gauss: [f64; 3],
    /// Gauss, each axis.
    pub magnetometer_noise_gauss: f64,
    /// hPa.
    pub barometer_noise_hpa: f64,
    /// Fixes a second.
    pub gps_rate_hz: f64,
    /// Age of a fix when it comes, s.
    pub gps_delay_s: f64,
    /// m, north and east.
    pub gps_horizontal_noise_m: f64,
    /// m.
    pub gps_vertical_noise_m: f64,
    /// m/s, each axis.
    pub gps_velocity_noise_m_s: f64,
    /// m.
    pub range_finder_noise_m: f64,
    /// Farthest reading, m.
    pub range_finder_limit_m: f64,
}

impl Default for InstrumentModel {
    /// IMU: ICM-42688-P (data sheet: 70 µg/√Hz, 2.8 mdps/√Hz, ±16 g, ±2000 °/s); barometer: MS5611 (0.012 hPa); receiver: of the order
    /// of one with real-time kinematics; the others of the order of small vehicles'.
    fn default() -> Self {
        Self {
            home: Home::default(),
            accelerometer_noise_m_s2_sqrt_hz: 6.9e-4,
            accelerometer_bias_walk_m_s2_sqrt_s: 1e-4,
            accelerometer_range_m_s2: 156.9,
            gyroscope_noise_rad_s_sqrt_hz: 4.9e-5,
            gyroscope_bias_walk_rad_s_sqrt_s: 4e-6,
            gyroscope_range_rad_s: 34.9,
            magnetic_field_ned_gauss: [0.215_23, 0.007_71, 0.427_41],
            magnetometer_noise_gauss: 0.001,
            barometer_noise_hpa: 0.012,
            gps_rate_hz: 10.0,
            gps_delay_s: 0.1,
            gps_horizontal_noise_m: 0.02,
            gps_vertical_noise_m: 0.04,
            gps_velocity_noise_m_s: 0.05,
            range_finder_noise_m: 0.01,
            range_finder_limit_m: 12.0,
        }
    }
}

impl InstrumentModel {
    /// Readings without noise, bias or delay.
    pub fn exact() -> Self {
        Self {
            accelerometer_noise_m_s2_sqrt_hz: 0.0,
            accelerometer_bias_walk_m_s2_sqrt_s: 0.0,
            gyroscope_noise_rad_s_sqrt_hz: 0.0,
            gyroscope_bias_walk_rad_s_sqrt_s: 0.0,
            magnetometer_noise_gauss: 0.0,
            barometer_noise_hpa: 0.0,
            gps_delay_s: 0.0,
            gps_horizontal_noise_m: 0.0,
            gps_vertical_noise_m: 0.0,
            gps_velocity_noise_m_s: 0.0,
            range_finder_noise_m: 0.0,
            ..Self::default()
        }
    }

    /// Rejects implausible instruments.
    pub fn check(&self) -> Result<(), Refusal> {
        self.home.check().map_err(|r| r.under("home"))?;
        let ranges = [
            (
                "accelerometer_noise_m_s2_sqrt_hz",
                self.accelerometer_noise_m_s2_sqrt_hz,
                0.0,
                1.0,
                "m/s²/√Hz",
            ),
            (
                "accelerometer_bias_walk_m_s2_sqrt_s",
                self.accelerometer_bias_walk_m_s2_sqrt_s,
                0.0,
                0.1,
                "m/s²/√s",
            ),
            (
                "accelerometer_range_m_s2",
                self.accelerometer_range_m_s2,
                15.0,
                10_000.0,
                "m/s²",
            ),
            (
                "gyroscope_noise_rad_s_sqrt_hz",
                self.gyroscope_noise_rad_s_sqrt_hz,
                0.0,
                0.1,
                "rad/s/√Hz",
            ),
            (
                "gyroscope_bias_walk_rad_s_sqrt_s",
                self.gyroscope_bias_walk_rad_s_sqrt_s,
                0.0,
                0.01,
                "rad/s/√s",
            ),
            (
                "gyroscope_range_rad_s",
                self.gyroscope_range_rad_s,
                1.0,
                1000.0,
                "rad/s",
            ),
            (
                "magnetometer_noise_gauss",
                self.magnetometer_noise_gauss,
                0.0,
                0.1,
                "gauss",
            ),
            ("barometer_noise_hpa", self.barometer_noise_hpa, 0.0, 10.0, "hPa"),
            ("gps_rate_hz", self.gps_rate_hz, 1.0, 50.0, "Hz"),
            ("gps_delay_s", self.gps_delay_s, 0.0, 1.0, "s"),
            ("gps_horizontal_noise_m", self.gps_horizontal_noise_m, 0.0, 50.0, "m"),
            ("gps_vertical_noise_m", self.gps_vertical_noise_m, 0.0, 50.0, "m"),
            ("gps_velocity_noise_m_s", self.gps_velocity_noise_m_s, 0.0, 10.0, "m/s"),
            ("range_finder_noise_m", self.range_finder_noise_m, 0.0, 10.0, "m"),
            ("range_finder_limit_m", self.range_finder_limit_m, 0.1, 1000.0, "m"),
        ];
        for (key, value, least, most, unit) in ranges {
            in_range(key, value, least, most, unit)?;
        }
        all_in_range(
            "magnetic_field_ned_gauss",
            &self.magnetic_field_ned_gauss,
            -1.0,
            1.0,
            "gauss",
        )
    }
}

/// Input of the instruments.
#[derive(Debug, Clone, Copy, Default)]
pub struct Scene {
    /// ns since the start of the plant.
    pub time_ns: u64,
    /// m.
    pub position_ned: Vector3,
    /// m/s.
    pub velocity_ned: Vector3,
    /// rad/s.
    pub body_rates: Vector3,
    /// m/s², body.
    pub specific_force: Vector3,
    /// The Earth's field, gauss, body.
    pub magnetic_field: Vector3,
    /// To the ground along the body's down axis, m; infinite without one.
    pub distance: f64,
}

/// One fix of the satellite receiver.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GpsFix {
    /// Instant that it describes, ns since the start of the plant.
    pub time_ns: u64,
    /// Degrees.
    pub latitude_deg: f64,
    /// Degrees.
    pub longitude_deg: f64,
    /// Above mean sea level, m.
    pub altitude_m: f64,
    /// m/s, NED.
    pub velocity_ned_m_s: [f64; 3],
}

/// Readings of the instruments at one instant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct InstrumentSample {
    /// ns since the start of the plant.
    pub time_ns: u64,
    /// Specific force, m/s², body: (0, 0, −g) at rest.
    pub specific_force_m_s2: [f64; 3],
    /// rad/s, body.
    pub body_rates_rad_s: [f64; 3],
    /// Gauss, body.
    pub magnetic_field_gauss: [f64; 3],
    /// Static pressure, hPa.
    pub pressure_hpa: f64,
    /// Altitude of that pressure in the standard atmosphere, m.
    pub pressure_altitude_m: f64,
    /// °C.
    pub temperature_c: f64,
    /// The fix that came since the last sample.
    pub gps: Option<GpsFix>,
    /// Distance to the ground along the body's down axis, m; `None`: out of reach.
    pub range_m: Option<f64>,
}

/// A vector instrument with white noise, a walking bias and a range.
#[derive(Debug, Clone)]
struct Inertial {
    density: f64,
    walk: f64,
    range: f64,
    bias: Vector3,
    noise: NormalStream,
    walking: NormalStream,
}

impl Inertial {
    fn measure(&mut self, truth: Vector3, interval_s: f64) -> Vector3 {
        let (noise, step) = (self.noise.sample3(), self.walking.sample3());
        let root = interval_s.sqrt();
        let mut reading = [0.0; 3];
        for i in 0..3 {
            self.bias[i] += self.walk * root * step[i];
            let noisy = truth[i] + self.bias[i] + self.density / root * noise[i];
            reading[i] = noisy.clamp(-self.range, self.range);
        }
        reading
    }
}

/// The instruments of one flight.
#[derive(Debug, Clone)]
pub struct Instruments {
    model: InstrumentModel,
    accelerometer: Inertial,
    gyroscope: Inertial,
    magnetometer: NormalStream,
    barometer: NormalStream,
    gps: NormalStream,
    range_finder: NormalStream,
    last_ns: Option<u64>,
    next_fix_ns: u64,
    on_the_way: VecDeque<GpsFix>,
}

/// Interval that the first sample is taken to close, s.
const FIRST_INTERVAL_S: f64 = 0.001;

impl Instruments {
    /// Instruments with the noise of `seed`; the biases begin at 0.
    pub fn new(model: &InstrumentModel, seed: u64) -> Self {
        let stream = |name: &str| NormalStream::new(seed, name);
        Self {
            accelerometer: Inertial {
                density: model.accelerometer_noise_m_s2_sqrt_hz,
                walk: model.accelerometer_bias_walk_m_s2_sqrt_s,
                range: model.accelerometer_range_m_s2,
                bias: [0.0; 3],
                noise: stream("instrument/accelerometer"),
                walking: stream("instrument/accel-bias"),
            },
            gyroscope: Inertial {
                density: model.gyroscope_noise_rad_s_sqrt_hz,
                walk: model.gyroscope_bias_walk_rad_s_sqrt_s,
                range: model.gyroscope_range_rad_s,
                bias: [0.0; 3],
                noise: stream("instrument/gyroscope"),
                walking: stream("instrument/gyro-bias"),
            },
            magnetometer: stream("instrument/magnetometer"),
            barometer: stream("instrument/barometer"),
            gps: stream("instrument/gps"),
            range_finder: stream("instrument/range"),
            last_ns: None,
            next_fix_ns: 0,
            on_the_way: VecDeque::new(),
            model: model.clone(),
        }
    }

    /// The Earth's field, gauss, NED.
    pub fn magnetic_field_ned(&self) -> Vector3 {
        self.model.magnetic_field_ned_gauss
    }

    /// Readings of `scene`, which must not be before the last one.
    pub fn measure(&mut self, scene: &Scene) -> InstrumentSample {
        let interval = self.last_ns.map_or(FIRST_INTERVAL_S, |last| {
            (scene.time_ns.saturating_sub(last) as f64 * 1e-9).max(1e-6)
        });
        self.last_ns = Some(scene.time_ns);
        let noise = self.magnetometer.sample3();
        let altitude = self.model.home.altitude_m - scene.position_ned[2];
        let (pressure, temperature_c) = standard_atmosphere(altitude);
        let pressure_hpa = pressure + self.model.barometer_noise_hpa * self.barometer.sample();
        let range = scene.distance + self.model.range_finder_noise_m * self.range_finder.sample();
        InstrumentSample {
            time_ns: scene.time_ns,
            specific_force_m_s2: self.accelerometer.measure(scene.specific_force, interval),
            body_rates_rad_s: self.gyroscope.measure(scene.body_rates, interval),
            magnetic_field_gauss: [0, 1, 2]
                .map(|i| scene.magnetic_field[i] + self.model.magnetometer_noise_gauss * noise[i]),
            pressure_hpa,
            pressure_altitude_m: pressure_altitude(pressure_hpa),
            temperature_c,
            gps: self.fix(scene),
            range_m: (range <= self.model.range_finder_limit_m).then(|| range.max(0.0)),
        }
    }

    fn fix(&mut self, scene: &Scene) -> Option<GpsFix> {
        if scene.time_ns >= self.next_fix_ns {
            self.next_fix_ns += (1e9 / self.model.gps_rate_hz) as u64;
            let (place, speed) = (self.gps.sample3(), self.gps.sample3());
            let deviation = [
                self.model.gps_horizontal_noise_m,
                self.model.gps_horizontal_noise_m,
                self.model.gps_vertical_noise_m,
            ];
            let noisy = [0, 1, 2].map(|i| scene.position_ned[i] + deviation[i] * place[i]);
            let [latitude_deg, longitude_deg, altitude_m] = self.model.home.geodetic(noisy);
            self.on_the_way.push_back(GpsFix {
                time_ns: scene.time_ns,
                latitude_deg,
                longitude_deg,
                altitude_m,
                velocity_ned_m_s: [0, 1, 2]
                    .map(|i| scene.velocity_ned[i] + self.model.gps_velocity_noise_m_s * speed[i]),
            });
        }
        let delay_ns = (self.model.gps_delay_s * 1e9) as u64;
        let first = self.on_the_way.front()?;
        if first.time_ns + delay_ns <= scene.time_ns {
            return self.on_the_way.pop_front();
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn still(time_ns: u64) -> Scene {
        Scene {
            time_ns,
            specific_force: [0.0, 0.0, -9.81],
            magnetic_field: [0.2, 0.0, 0.4],
            position_ned: [0.0, 0.0, -10.0],
            distance: 10.0,
            ..Scene::default()
        }
    }

    #[test]
    fn val_exact_instruments_show_the_truth() {
        let mut instruments = Instruments::new(&InstrumentModel::exact(), 1);
        let sample = instruments.measure(&still(0));
        assert_eq!(sample.specific_force_m_s2, [0.0, 0.0, -9.81]);
        assert_eq!(sample.body_rates_rad_s, [0.0; 3]);
        assert_eq!(sample.range_m, Some(10.0));
        assert!((sample.pressure_altitude_m - 498.0).abs() < 1e-6);
        let fix = sample.gps.expect("no delay");
        assert!((fix.altitude_m - 498.0).abs() < 1e-9 && fix.latitude_deg == Home::default().latitude_deg);
    }

    #[test]
    fn val_noise_and_bias_have_their_densities() {
        const N: u64 = 20_000;
        const INTERVAL_NS: u64 = 4_000_000;
        let model = InstrumentModel {
            accelerometer_bias_walk_m_s2_sqrt_s: 0.0,
            ..InstrumentModel::default()
        };
        let mut instruments = Instruments::new(&model, 3);
        let mut square = 0.0;
        for k in 0..N {
            let x = instruments.measure(&still(k * INTERVAL_NS)).specific_force_m_s2[0];
            square += x * x;
        }
        let deviation = (square / N as f64).sqrt();
        let expected = model.accelerometer_noise_m_s2_sqrt_hz / 0.004_f64.sqrt();
        // The deviation of N normals is known to 1/√(2 N) = 0.5 %; four of these.
        assert!((deviation / expected - 1.0).abs() < 0.02, "{deviation} for {expected}");

        // 400 walks of 10 s each end with the deviation walk · √10.
        let model = InstrumentModel {
            gyroscope_noise_rad_s_sqrt_hz: 0.0,
            gyroscope_bias_walk_rad_s_sqrt_s: 0.001,
            ..InstrumentModel::default()
        };
        let mut square = 0.0;
        for seed in 0..400 {
            let mut instruments = Instruments::new(&model, seed);
            let mut last = InstrumentSample::default();
            for k in 0..=100 {
                last = instruments.measure(&still(k * 100_000_000));
            }
            square += last.body_rates_rad_s.iter().map(|b| b * b).sum::<f64>() / 3.0;
        }
        let deviation = (square / 400.0).sqrt();
        assert!(
            (deviation / (0.001 * 10.0_f64.sqrt()) - 1.0).abs() < 0.12,
            "{deviation}"
        );
    }

    #[test]
    fn val_readings_saturate() {
        let mut instruments = Instruments::new(&InstrumentModel::default(), 1);
        let sample = instruments.measure(&Scene {
            body_rates: [100.0, -100.0, 0.0],
            specific_force: [0.0, 0.0, -1e4],
            ..still(0)
        });
        assert_eq!(sample.body_rates_rad_s[..2], [34.9, -34.9]);
        assert_eq!(sample.specific_force_m_s2[2], -156.9);
    }

    #[test]
    fn val_fixes_come_at_their_rate_and_age() {
        let model = InstrumentModel {
            gps_delay_s: 0.12,
            ..InstrumentModel::exact()
        };
        let mut instruments = Instruments::new(&model, 1);
        let mut fixes = Vec::new();
        for k in 0..500 {
            let time_ns = k * 4_000_000;
            let scene = Scene {
                position_ned: [0.0, 0.0, -(time_ns as f64) * 1e-9],
                ..still(time_ns)
            };
            fixes.extend(instruments.measure(&scene).gps.map(|fix| (time_ns, fix)));
        }
        assert_eq!(fixes.len(), 19, "2 s at 10 Hz, the last on the way");
        for (came_ns, fix) in fixes {
            assert_eq!(came_ns - fix.time_ns, 120_000_000);
            assert!((fix.altitude_m - 488.0 - fix.time_ns as f64 * 1e-9).abs() < 1e-9);
        }
    }

    #[test]
    fn val_the_range_finder_ends_at_its_limit() {
        let mut instruments = Instruments::new(&InstrumentModel::exact(), 1);
        let far = Scene {
            distance: 13.0,
            ..still(0)
        };
        assert_eq!(instruments.measure(&far).range_m, None);
        assert_eq!(
            instruments
                .measure(&Scene {
                    distance: f64::INFINITY,
                    ..far
                })
                .range_m,
            None
        );
    }
}
