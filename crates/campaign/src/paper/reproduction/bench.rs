//! What the paper's test bench shows, computed: Figures 3 to 5 from the motor's equations (4, 7 to 17), and the coefficients of Eq. 19
//! identified from one flight on a battery that discharges (§2.6).
//!
//! The paper's measurements are not published, nor are the motor's resistance, idle current and inertia. The motor is that of `f550-motors`;
//! the lift coefficient of each blade follows from its row of Table 1 at hover. So the figures show what the paper's model says, not
//! what its bench measured. Figures 2 and 6 are photographs.

use crate::result_table::ResultTable;
use rotortwin_flight::stepped::SteppedFlight;
use rotortwin_plant::STEP_S;
use rotortwin_plant::motors;
use rotortwin_plant::powertrain::battery::Battery;
use rotortwin_plant::powertrain::blades::Blade;
use rotortwin_plant::powertrain::motor::MotorModel;
use rotortwin_scenario::Scenario;

/// Inner resistance of the bench's battery, Ω (§3.2).
const BENCH_RESISTANCE_OHM: f64 = 0.080;
/// Open-circuit voltages of Figures 4 and 5, V: from 40 to 95 % charge (§3.1).
const OPEN_CIRCUIT_V: [f64; 4] = [15.2, 15.7, 16.1, 16.6];

/// One line of a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchCurve {
    /// What it is.
    pub name: String,
    /// Lines of one group have one colour.
    pub group: usize,
    /// Abscissa and ordinate.
    pub points: Vec<(f64, f64)>,
}

/// One figure of the bench.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchFigure {
    /// Number in the paper.
    pub number: u8,
    /// Title.
    pub title: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// Axes.
    pub labels: [&'static str; 2],
    /// Lines.
    pub curves: Vec<BenchCurve>,
}

/// Figures 3, 4 and 5; empty if the motor cannot turn the vehicle's blade.
pub fn figures(base: &Scenario) -> Vec<BenchFigure> {
    let bench = Bench::new(base);
    let Some(healthy) = bench.lift_coefficient(base.nominal_blade()) else {
        return Vec::new();
    };
    vec![
        BenchFigure {
            number: 3,
            title: "Battery voltage while the duty steps up",
            about: "Computed from Eqs. 7 to 14, one motor on a battery of 80 mΩ at 95 % charge; the paper's figure is measured.",
            labels: ["time, s", "voltage, V"],
            curves: bench.voltage_drop(healthy),
        },
        BenchFigure {
            number: 4,
            title: "Speed over duty, healthy blade",
            about: "Computed from Eq. 16 at four open-circuit voltages; the paper's figure is measured.",
            labels: ["duty, %", "speed, 1/min"],
            curves: bench.speed_over_duty(healthy),
        },
        BenchFigure {
            number: 5,
            title: "Lift over speed, all blades",
            about: "Computed from Eq. 4: lift depends on the speed and the blade, not on the voltage.",
            labels: ["speed, 1/min", "lift, N"],
            curves: base
                .blades()
                .blade
                .iter()
                .enumerate()
                .filter_map(|(group, (name, blade))| {
                    let coefficient = bench.lift_coefficient(blade)?;
                    let point = |step: u32| {
                        let rpm = 100.0 * f64::from(step);
                        let speed = rpm * std::f64::consts::TAU / 60.0;
                        (rpm, coefficient * speed * speed)
                    };
                    Some(BenchCurve {
                        name: format!("blade {name}"),
                        group,
                        points: (0..=88).map(point).collect(),
                    })
                })
                .collect(),
        },
    ]
}

/// One motor on the bench.
struct Bench<'a> {
    base: &'a Scenario,
    motor: MotorModel,
    /// c_D/c_L, m.
    moment_ratio: f64,
}

impl<'a> Bench<'a> {
    fn new(base: &'a Scenario) -> Self {
        let placements = base.vehicle().rotors.layout.placements();
        Self {
            base,
            motor: base.vehicle().rotors.motor.unwrap_or(MotorModel::AIR_GEAR_350),
            moment_ratio: placements[0].moment_ratio,
        }
    }

    fn lift_coefficient(&self, blade: &Blade) -> Option<f64> {
        motors::lift_coefficient(&self.motor, self.base.vehicle(), self.base.nominal_blade(), blade)
    }

    /// Steady speed, rad/s, on a battery of `open` V that this motor alone loads.
    fn steady_speed(&self, duty: f64, open: f64, drag: f64) -> f64 {
        let mut voltage = open;
        let mut speed = 0.0;
        // The voltage falls with the current by some per cent, the current with the voltage: each round is as much more exact.
        for _ in 0..40 {
            speed = self.motor.steady_speed(duty, voltage, drag);
            voltage = open - BENCH_RESISTANCE_OHM * duty * self.motor.current(duty, voltage, speed);
        }
        speed
    }

    fn speed_over_duty(&self, lift_coefficient: f64) -> Vec<BenchCurve> {
        let drag = self.moment_ratio * lift_coefficient;
        let rpm = 60.0 / std::f64::consts::TAU;
        let curve = |(group, open): (usize, f64)| BenchCurve {
            name: format!("{open:.1} V open circuit"),
            group,
            points: (0..=100)
                .map(|percent| {
                    let duty = f64::from(percent) / 100.0;
                    (f64::from(percent), rpm * self.steady_speed(duty, open, drag))
                })
                .collect(),
        };
        OPEN_CIRCUIT_V.into_iter().enumerate().map(curve).collect()
    }

    /// Duties of 20, 40, 60 and 80 % for 5 s each, with 5 s of rest between them.
    fn voltage_drop(&self, lift_coefficient: f64) -> Vec<BenchCurve> {
        let battery = Battery::new(&self.base.vehicle().battery);
        let drag = self.moment_ratio * lift_coefficient;
        let (mut charge, mut speed, mut points) = (0.95, 0.0, Vec::new());
        for step in 0..16_000u32 {
            let time = f64::from(step) * STEP_S;
            let (period, within) = ((time / 10.0).floor(), time % 10.0);
            let duty = if within < 5.0 { 0.0 } else { 0.2 * (period + 1.0) };
            let open = battery.open_circuit_voltage(charge);
            let voltage = self
                .motor
                .terminal_voltage(open, BENCH_RESISTANCE_OHM, std::iter::once((duty, speed)));
            let current = duty * self.motor.current(duty, voltage, speed);
            charge += STEP_S * battery.charge_rate(current);
            let load = drag * speed * speed;
            speed = (speed + STEP_S * self.motor.acceleration(duty, voltage, speed, load)).max(0.0);
            if step % 20 == 0 {
                points.push((time, voltage));
            }
        }
        vec![BenchCurve {
            name: "terminals, duty 0, 20, 0, 40, 0, 60, 0, 80 %".to_owned(),
            group: 0,
            points,
        }]
    }
}

/// Eq. 19 identified from a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// a₀ … a₃ and v₀.
    pub blade: Blade,
    /// Half-second means that it was fitted to.
    pub windows: usize,
    /// Duty flown, fraction.
    pub duty: [f64; 2],
    /// Voltage flown, V.
    pub voltage: [f64; 2],
}

/// Length of a window, steps.
const WINDOW_STEPS: u64 = 200;

/// Flies a healthy vehicle with motors up and down until the battery has gone from 95 to 40 %, and fits Eq. 19 to its
/// sensor readings.
///
/// Duty and voltage are means of half a second; the lift of a rotor is m (g − v̇)/(n cos φ cos θ) with v̇ from the
/// velocities at the ends of the window. For each v₀ the coefficients are linear, and v₀ is the one with the smallest
/// squares.
///
/// # Errors
/// The flight cannot be flown, or ends before the battery has reached 40 %.
pub fn identify(motors: &Scenario, seed: u64) -> Result<Identified, String> {
    let mut flight = SteppedFlight::new(motors, seed)?;
    let n = flight.rotor_count();
    let body = &motors.vehicle().body;
    let mut windows: Vec<[f64; 3]> = Vec::new();
    let (mut duty, mut voltage, mut begin) = (0.0, 0.0, None);
    while !flight.done() && flight.truth().state_of_charge > 0.40 {
        let sample = flight.step(None).map_err(|failure| failure.sentence)?;
        let nav = sample.sensors.nav();
        if flight.steps() % WINDOW_STEPS == 1 {
            if let Some(before) = begin.replace(f64::from(nav.velocity_ned.z)) {
                let seconds = WINDOW_STEPS as f64 * STEP_S;
                let rate = (f64::from(nav.velocity_ned.z) - before) / seconds;
                let upright = f64::from(nav.attitude.roll).cos() * f64::from(nav.attitude.pitch).cos();
                let lift = body.mass_kg * (body.gravity_m_s2 - rate) / (n as f64 * upright);
                let per = 1.0 / WINDOW_STEPS as f64;
                windows.push([duty * per, voltage * per, lift]);
            }
            (duty, voltage) = (0.0, 0.0);
        }
        duty += sample.command.duty[..n].iter().map(|u| f64::from(*u)).sum::<f64>() / n as f64;
        voltage += f64::from(sample.sensors.battery_voltage_v);
    }
    if flight.truth().state_of_charge > 0.41 {
        return Err(format!(
            "the battery is at {:.0} % when the flight ends, 40 % are needed",
            100.0 * flight.truth().state_of_charge
        ));
    }
    // The start is not steady flight.
    let settled = windows.split_off(windows.len().min(10));
    fit(&settled).ok_or_else(|| "the flight does not determine Eq. 19".to_owned())
}

/// Least squares of Eq. 19 over windows of duty, voltage and lift.
fn fit(windows: &[[f64; 3]]) -> Option<Identified> {
    let at = |offset: f64| -> Option<(f64, [f64; 4])> {
        let row = |window: &[f64; 3]| {
            let u = 100.0 * window[0];
            let drive = window[1] - offset;
            [u.sqrt(), u, u * u, u * u * u].map(|power| drive * power)
        };
        let columns = nalgebra::DMatrix::from_row_iterator(windows.len(), 4, windows.iter().flat_map(row));
        // Powers of the duty differ by orders of magnitude.
        let scales: Vec<f64> = columns.column_iter().map(|column| column.norm()).collect();
        let mut scaled = columns;
        for (mut column, scale) in scaled.column_iter_mut().zip(&scales) {
            column /= *scale;
        }
        let lift = nalgebra::DVector::from_iterator(windows.len(), windows.iter().map(|window| window[2]));
        let solution = scaled.clone().svd(true, true).solve(&lift, 1e-12).ok()?;
        let squares = (scaled * &solution - lift).norm_squared();
        Some((squares, std::array::from_fn(|i| solution[i] / scales[i])))
    };
    // The sum of squares is smooth in v₀ with one minimum: thirds of the interval until a millivolt is left.
    let (mut low, mut high) = (0.0, 12.0);
    while high - low > 1e-3 {
        let (left, right) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if at(left)?.0 < at(right)?.0 {
            high = right;
        } else {
            low = left;
        }
    }
    let voltage_offset_v = 0.5 * (low + high);
    // What was flown, but for the outermost hundredths.
    let range = |entry: usize| {
        let mut values: Vec<f64> = windows.iter().map(|window| window[entry]).collect();
        values.sort_by(f64::total_cmp);
        let last = values.len().checked_sub(1)?;
        Some([values[last / 100], values[last - last / 100]])
    };
    Some(Identified {
        blade: Blade {
            coefficients: at(voltage_offset_v)?.1,
            voltage_offset_v,
            moment_ratio_factor: 1.0,
        },
        windows: windows.len(),
        duty: range(0)?,
        voltage: range(1)?,
    })
}

impl Identified {
    /// Error against the motors' own Eq. 18 over the duties and voltages flown: root mean square, N, and R².
    ///
    /// `None` if the motor cannot turn the vehicle's blade.
    pub fn error(&self, motors: &Scenario) -> Option<(f64, f64)> {
        let bench = Bench::new(motors);
        let coefficient = bench.lift_coefficient(motors.nominal_blade())?;
        let mut pairs = Vec::new();
        for i in 0..=20 {
            for j in 0..=20 {
                let between = |range: [f64; 2], step: u32| range[0] + (range[1] - range[0]) * f64::from(step) / 20.0;
                let (duty, voltage) = (between(self.duty, i), between(self.voltage, j));
                let speed = bench
                    .motor
                    .steady_speed(duty, voltage, bench.moment_ratio * coefficient);
                pairs.push((self.blade.lift(duty, voltage), coefficient * speed * speed));
            }
        }
        let count = pairs.len() as f64;
        let mean = pairs.iter().map(|pair| pair.1).sum::<f64>() / count;
        let squares: f64 = pairs.iter().map(|pair| (pair.0 - pair.1).powi(2)).sum();
        let spread: f64 = pairs.iter().map(|pair| (pair.1 - mean).powi(2)).sum();
        Some(((squares / count).sqrt(), 1.0 - squares / spread))
    }
}

/// The flight of [`identify`]: up and down by 20 m in 11 s each time, smoothly, 95 % charge at the start.
///
/// # Errors
/// The vehicle document is invalid.
pub fn discharging_flight(vehicle: &std::path::Path) -> Result<Scenario, String> {
    let vehicle = toml::Value::String(vehicle.display().to_string());
    let text = format!(
        "name = 'discharging-flight'\ndescription = 'up and down until the battery is empty'\nvehicle = {vehicle}\nduration_s = 3000.0\n\
         initial = {{ state_of_charge = 0.95 }}\nmismatch = {{ preset = 'none' }}\n\
         [trajectory]\nkind = 'helix'\nradius_m = 1.0\nturn_s = 20.0\nstart_height_m = 5.0\nclimb_amplitude_m = 10.0\nclimb_period_s = 11.0\n\
         yaw_amplitude_rad = 0.0\n"
    );
    Scenario::parse(&text, "").map_err(|error| error.to_string())
}

/// The identified coefficients next to those of Table 1, and the error of each over the flight's duties and voltages.
pub fn table(motors: &Scenario, identified: &Identified) -> ResultTable {
    let printed = motors.nominal_blade();
    let mut rows: Vec<Vec<String>> = (0..4)
        .map(|i| {
            let of = |blade: &Blade| format!("{:.4e}", blade.coefficients[i]);
            vec![format!("a_L{i}"), of(printed), of(&identified.blade)]
        })
        .collect();
    let offset = |blade: &Blade| format!("{:.4}", blade.voltage_offset_v);
    rows.push(vec!["v_L0, V".to_owned(), offset(printed), offset(&identified.blade)]);
    if let Some((rms, r_squared)) = identified.error(motors) {
        rows.push(vec![
            "RMSE, mN".to_owned(),
            "10.756".to_owned(),
            format!("{:.3}", 1e3 * rms),
        ]);
        rows.push(vec!["R²".to_owned(), "0.99999".to_owned(), format!("{r_squared:.5}")]);
    }
    ResultTable {
        key: "eq19",
        title: "Eq. 19 identified from one discharging flight (§2.6)".to_owned(),
        columns: ["", "paper (bench)", "here (one flight)"].map(str::to_owned).to_vec(),
        rows,
        notes: vec![
            format!(
                "fitted to {} half-second means of duty ({:.0} to {:.0} %), voltage ({:.2} to {:.2} V) and lift from the vertical acceleration; its error is that \
                 against the motors' own Eqs. 15 to 18 over those duties and voltages",
                identified.windows,
                100.0 * identified.duty[0],
                100.0 * identified.duty[1],
                identified.voltage[0],
                identified.voltage[1]
            ),
            "the motors are those of `f550-motors`, which meet Table 1 at hover only: coefficients need not agree, and single ones mean little \
             beyond the duties flown"
                .to_owned(),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rotortwin_scenario::names::{self, Kind};

    fn motors() -> Scenario {
        let path = names::find(Kind::Vehicle, "f550-motors").expect("it is shipped");
        discharging_flight(&path.canonicalize().expect("it is there")).expect("it can be flown")
    }

    #[test]
    fn val_eq_19_is_found_from_one_flight() {
        let motors = motors();
        let identified = identify(&motors, 1).expect("the battery empties");
        let (rms, r_squared) = identified.error(&motors).expect("the motor turns");
        // The paper's fit of its bench has 10.756 mN and 0.99999.
        assert!(rms < 0.015 && r_squared > 0.999, "{rms} N, {r_squared}: {identified:?}");
        // Without the voltage as a variable, a discharged battery would lift as much as a full one.
        let duty = 0.5 * (identified.duty[0] + identified.duty[1]);
        let [empty, full] = identified.voltage.map(|voltage| identified.blade.lift(duty, voltage));
        assert!(full / empty > 1.05, "{empty} {full}");
    }

    #[test]
    fn val_figures_of_the_bench_say_what_the_paper_says_of_its_own() {
        let motors = motors();
        let figures = figures(&motors);
        assert_eq!(
            figures.iter().map(|figure| figure.number).collect::<Vec<_>>(),
            [3, 4, 5]
        );
        // §3.3: the speed rises with V_oc, and less than in proportion with the duty.
        let speed = &figures[1].curves;
        for percent in 20..=100 {
            for pair in speed.windows(2) {
                assert!(pair[1].points[percent].1 > pair[0].points[percent].1);
            }
        }
        let at = |percent: usize| speed[0].points[percent].1;
        assert!(
            at(100) < 2.0 * at(50) && at(50) < 2.0 * at(25),
            "{} {} {}",
            at(25),
            at(50),
            at(100)
        );
        // §3.2: a notable drop with the duty, which goes with it.
        let voltage = &figures[0].curves[0].points;
        let near = |time: f64| {
            let found = voltage.iter().find(|point| point.0 >= time);
            found.expect("drawn").1
        };
        assert!(
            near(4.9) - near(9.9) > 0.01 && near(34.9) - near(39.9) > 0.5,
            "{} {}",
            near(34.9),
            near(39.9)
        );
        // §3.4: blade a lifts most at a speed.
        let lift = |group: usize| figures[2].curves[group].points[60].1;
        assert!((1..4).all(|group| lift(group) < lift(0)), "{} {}", lift(0), lift(1));
    }
}
