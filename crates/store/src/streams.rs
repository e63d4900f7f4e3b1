//! A row of telemetry → messages for Foxglove, Lichtblick and PlotJuggler: in [`run.mcap`](crate::mcap), and live.
//!
//! | topic | message (protobuf) | rate |
//! |---|---|---|
//! | `/nav` `/reference` `/command` `/truth` `/battery` `/fdi` | `rotortwin.v1.*Telemetry` (`proto/rotortwin/v1/telemetry.proto`) | each row |
//! | `/tf` | `foxglove.FrameTransform`: `world` → `vehicle`, `world` → `reference` | 40 Hz |
//! | `/pose` `/reference_pose` | `foxglove.PoseInFrame` in `world`: true pose of the vehicle, reference pose | 40 Hz |
//! | `/scene` | `foxglove.SceneUpdate` in `vehicle`: arms, rotors, thrust, verdict | 20 Hz |
//! | `/trail` | `foxglove.SceneUpdate` in `world`: path flown in the last 15 s | 2 Hz |
//! | `/log` | `foxglove.Log`: start and end of faults, every change of the sequential detector's verdict | on occurrence |
//!
//! 3-D panels expect z up: these messages are in north-west-up, the body frame is forward-left-up; the `rotortwin.v1` messages are NED and
//! FRD. A pose that is not finite is not sent: the viewer keeps the last one. Without rotor positions (a spool of an older version) there is
//! no `/scene`.

use crate::analysis::column;
use crate::spool::SpoolHeader;
use crate::summary::{Evaluator, verdict_text};
use crate::telemetry::Column;
use prost::Message;
use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY};
use rotortwin_proto::foxglove::{
    self, ArrowPrimitive, Color, CylinderPrimitive, FrameTransform, LinePrimitive, Log, Point3, Pose, PoseInFrame,
    Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, TextPrimitive, Vector3,
};
use rotortwin_proto::google::protobuf::{Duration, Timestamp};
use rotortwin_proto::{
    BatteryTelemetry, BodyVector, CommandTelemetry, EulerAngles, FdiTelemetry, NavTelemetry, NedVector,
    ReferenceTelemetry, TruthTelemetry,
};
use std::collections::VecDeque;

/// Time between two poses, ns.
const POSE_EVERY_NS: u64 = 25_000_000;
/// Time between two scenes, ns.
const SCENE_EVERY_NS: u64 = 50_000_000;
/// Time between two points of the trail, ns, and their number: 15 s.
const TRAIL_POINT_EVERY_NS: u64 = 100_000_000;
const TRAIL_POINTS: usize = 150;
/// Time between two messages of the trail, ns.
const TRAIL_EVERY_NS: u64 = 500_000_000;

/// Colours: a healthy rotor, a faulty one (the truth), thrust, thrust of a rotor suspected by the sequential detector, arms and body, trail.
const HEALTHY_ROTOR: Color = color(0.45, 0.50, 0.55, 0.55);
const FAULTY_ROTOR: Color = color(0.84, 0.15, 0.16, 0.85);
const THRUST: Color = color(0.12, 0.47, 0.71, 0.9);
const SUSPECTED: Color = color(1.0, 0.50, 0.05, 0.95);
const FRAME: Color = color(0.30, 0.32, 0.35, 1.0);
const TRAIL: Color = color(0.12, 0.47, 0.71, 0.8);

const fn color(r: f64, g: f64, b: f64, a: f64) -> Color {
    Color { r, g, b, a }
}

/// A stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// Sensed state.
    Nav,
    /// Trajectory reference.
    Reference,
    /// Controller command.
    Command,
    /// Simulated truth.
    Truth,
    /// Battery.
    Battery,
    /// Residuals and verdicts.
    Fdi,
    /// Transforms between frames.
    Transform,
    /// Pose of the vehicle.
    Pose,
    /// Reference pose.
    ReferencePose,
    /// Drawing of the vehicle.
    Scene,
    /// Path flown.
    Trail,
    /// Text messages.
    Log,
}

impl Topic {
    /// All topics, in the order of their channel ids.
    pub const ALL: [Self; 12] = [
        Self::Nav,
        Self::Reference,
        Self::Command,
        Self::Truth,
        Self::Battery,
        Self::Fdi,
        Self::Transform,
        Self::Pose,
        Self::ReferencePose,
        Self::Scene,
        Self::Trail,
        Self::Log,
    ];

    /// Name of the topic.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nav => "/nav",
            Self::Reference => "/reference",
            Self::Command => "/command",
            Self::Truth => "/truth",
            Self::Battery => "/battery",
            Self::Fdi => "/fdi",
            Self::Transform => "/tf",
            Self::Pose => "/pose",
            Self::ReferencePose => "/reference_pose",
            Self::Scene => "/scene",
            Self::Trail => "/trail",
            Self::Log => "/log",
        }
    }

    /// Full name of its protobuf message, and a serialized `FileDescriptorSet` that contains it.
    pub const fn schema(self) -> (&'static str, &'static [u8]) {
        let name = match self {
            Self::Nav => "rotortwin.v1.NavTelemetry",
            Self::Reference => "rotortwin.v1.ReferenceTelemetry",
            Self::Command => "rotortwin.v1.CommandTelemetry",
            Self::Truth => "rotortwin.v1.TruthTelemetry",
            Self::Battery => "rotortwin.v1.BatteryTelemetry",
            Self::Fdi => "rotortwin.v1.FdiTelemetry",
            Self::Transform => "foxglove.FrameTransform",
            Self::Pose | Self::ReferencePose => "foxglove.PoseInFrame",
            Self::Scene | Self::Trail => "foxglove.SceneUpdate",
            Self::Log => "foxglove.Log",
        };
        match self {
            Self::Nav | Self::Reference | Self::Command | Self::Truth | Self::Battery | Self::Fdi => {
                (name, rotortwin_proto::FILE_DESCRIPTOR_SET)
            }
            _ => (name, foxglove::FILE_DESCRIPTOR_SET),
        }
    }
}

/// Indices of the columns read.
#[derive(Clone, Copy, Debug)]
struct Places {
    time: usize,
    nav: usize,
    duty: usize,
    battery_voltage: usize,
    reference: usize,
    truth: usize,
    label: usize,
    setpoint: usize,
    residuals: usize,
}

/// Fires at most once per period of simulated time.
#[derive(Debug)]
struct Every {
    period_ns: u64,
    due_ns: u64,
    last_ns: u64,
}

impl Every {
    const fn new(period_ns: u64) -> Self {
        Self {
            period_ns,
            due_ns: 0,
            last_ns: 0,
        }
    }

    fn is_due(&mut self, now_ns: u64) -> bool {
        // A repeated run restarts the clock.
        let due = now_ns >= self.due_ns || now_ns < self.last_ns;
        if due {
            self.due_ns = (now_ns / self.period_ns + 1) * self.period_ns;
        }
        self.last_ns = now_ns;
        due
    }
}

/// Creates the messages of one run.
#[derive(Debug)]
pub struct Streams {
    header: SpoolHeader,
    places: Places,
    buffer: Vec<u8>,
    /// Truth and sequential verdict of the previous row, for the log.
    before: Option<(Vec<i32>, u64, i32)>,
    pose: Every,
    scene: Every,
    trail_point: Every,
    trail: Every,
    /// North-west-up.
    points: VecDeque<Point3>,
}

impl Streams {
    /// * `columns`: columns of the rows to come: [`telemetry_columns`](crate::telemetry::telemetry_columns)
    pub fn new(header: &SpoolHeader, columns: &[Column]) -> Self {
        let place = |name: &str| column(columns, name);
        Self {
            header: header.clone(),
            places: Places {
                time: place("time_s"),
                nav: place("position_north_m"),
                duty: place("duty_1"),
                battery_voltage: place("battery_voltage_v"),
                reference: place("reference_north_m"),
                truth: place("true_position_north_m"),
                label: place("fault_label"),
                setpoint: place("roll_setpoint_rad"),
                residuals: place("residual_1_arm_nms"),
            },
            buffer: Vec::with_capacity(1024),
            before: None,
            pose: Every::new(POSE_EVERY_NS),
            scene: Every::new(SCENE_EVERY_NS),
            trail_point: Every::new(TRAIL_POINT_EVERY_NS),
            trail: Every::new(TRAIL_EVERY_NS),
            points: VecDeque::new(),
        }
    }

    /// Writes the messages of a row, in order; returns its simulated time, ns.
    ///
    /// * `at`: value of a column, by its index   * `write`: receives topic, simulated time and encoded message
    ///
    /// # Errors
    /// The first error of `write`; the rest of the row is skipped.
    pub fn row<E>(
        &mut self,
        at: impl Fn(usize) -> f64,
        mut write: impl FnMut(Topic, u64, &[u8]) -> Result<(), E>,
    ) -> Result<u64, E> {
        let n = self.header.rotor_count;
        let f = |place: usize| at(place) as f32;
        let many = |place: usize, count: usize, stride: usize| -> Vec<f32> {
            (0..count).map(|i| f(place + i * stride)).collect()
        };
        let ned = |p: usize| {
            Some(NedVector {
                north: f(p),
                east: f(p + 1),
                down: f(p + 2),
            })
        };
        let body = |p: usize| {
            Some(BodyVector {
                forward: f(p),
                right: f(p + 1),
                down: f(p + 2),
            })
        };
        let euler = |p: usize| {
            Some(EulerAngles {
                roll_rad: f(p),
                pitch_rad: f(p + 1),
                yaw_rad: f(p + 2),
            })
        };
        let Places {
            time,
            nav,
            duty,
            battery_voltage,
            reference,
            truth,
            label,
            setpoint,
            residuals,
        } = self.places;
        let thrust = truth + 12;
        let charge = thrust + n;
        let conditions = label + 2;
        let sensor_faults = conditions + n;
        let wrench = residuals + 3 * n;
        let verdicts = wrench + 4;
        let time_ns = (at(time) * 1e9).round() as u64;

        let message = NavTelemetry {
            position_ned_m: ned(nav),
            velocity_ned_m_s: ned(nav + 3),
            attitude: euler(nav + 6),
            body_rates_rad_s: body(nav + 9),
        };
        self.say(&message, Topic::Nav, time_ns, &mut write)?;
        let message = ReferenceTelemetry {
            position_ned_m: ned(reference),
            velocity_ned_m_s: ned(reference + 3),
            yaw_rad: f(reference + 6),
            attitude_setpoint: euler(setpoint),
        };
        self.say(&message, Topic::Reference, time_ns, &mut write)?;
        let message = CommandTelemetry {
            duty: many(duty, n, 1),
            saturated_rotors: at(setpoint + 3) as u32,
        };
        self.say(&message, Topic::Command, time_ns, &mut write)?;
        let codes: Vec<i32> = (0..n).map(|i| at(conditions + i) as i32).collect();
        let message = TruthTelemetry {
            position_ned_m: ned(truth),
            velocity_ned_m_s: ned(truth + 3),
            attitude: euler(truth + 6),
            body_rates_rad_s: body(truth + 9),
            thrust_n: many(thrust, n, 1),
            wind_ned_m_s: ned(charge + 3),
            fault_label: at(label) as i32,
            faulty_rotors: at(label + 1) as u32,
            rotor_condition: codes.clone(),
            sensor_faults: at(sensor_faults) as u32,
        };
        self.say(&message, Topic::Truth, time_ns, &mut write)?;
        let message = BatteryTelemetry {
            voltage_v: f(battery_voltage),
            current_a: f(battery_voltage + 1),
            true_voltage_v: f(charge + 2),
            open_circuit_voltage_v: f(charge + 1),
            state_of_charge: f(charge),
        };
        self.say(&message, Topic::Battery, time_ns, &mut write)?;
        let sequential = at(verdicts + 2) as i32;
        let message = FdiTelemetry {
            residual_arm_nms: many(residuals, n, 3),
            residual_lever_nms: many(residuals + 1, n, 3),
            residual_yaw_nms: many(residuals + 2, n, 3),
            wrench_residual: many(wrench, 4, 1),
            verdict_t_test: at(verdicts) as i32,
            verdict_network: at(verdicts + 1) as i32,
            verdict_sequential: sequential,
            sequential_probability: f(verdicts + 3),
            thrust_loss_n: f(verdicts + 4),
            thrust_loss_low_n: f(verdicts + 5),
            thrust_loss_high_n: f(verdicts + 6),
            thrust_loss_share: f(verdicts + 7),
            thrust_loss_share_low: f(verdicts + 8),
            thrust_loss_share_high: f(verdicts + 9),
            second_thrust_loss_n: f(verdicts + 10),
            second_thrust_loss_low_n: f(verdicts + 11),
            second_thrust_loss_high_n: f(verdicts + 12),
            second_thrust_loss_share: f(verdicts + 13),
            second_thrust_loss_share_low: f(verdicts + 14),
            second_thrust_loss_share_high: f(verdicts + 15),
            hypothesis_count: at(verdicts + 16) as u32,
            suspect_rotors: at(verdicts + 17) as u32,
            window_end: at(verdicts + 18) > 0.5,
        };
        self.say(&message, Topic::Fdi, time_ns, &mut write)?;

        let triple = |p: usize| [at(p), at(p + 1), at(p + 2)];
        let flown = flu_in_nwu(triple(truth), triple(truth + 6));
        let asked = flu_in_nwu(triple(reference), [0.0, 0.0, at(reference + 6)]);
        if self.pose.is_due(time_ns) {
            for (child, topic, pose) in [
                ("vehicle", Topic::Pose, flown),
                ("reference", Topic::ReferencePose, asked),
            ] {
                let Some(pose) = pose else { continue };
                self.say(&transform(child, time_ns, pose), Topic::Transform, time_ns, &mut write)?;
                let message = PoseInFrame {
                    timestamp: stamp(time_ns),
                    frame_id: "world".to_owned(),
                    pose: Some(pose),
                };
                self.say(&message, topic, time_ns, &mut write)?;
            }
        }
        if self.scene.is_due(time_ns) && !self.header.rotor_positions_body_m.is_empty() {
            let rotors: Vec<DrawnRotor> = (0..n)
                .map(|i| DrawnRotor {
                    thrust_n: at(thrust + i),
                    faulty: codes[i] != 0,
                    suspected: sequential != HEALTHY && at(verdicts + 17) as u64 >> i & 1 == 1,
                })
                .collect();
            let scene = scene(&self.header, time_ns, &rotors, sequential, at(verdicts + 3));
            self.say(&scene, Topic::Scene, time_ns, &mut write)?;
        }
        if time_ns < self.trail.last_ns {
            self.points.clear();
        }
        if self.trail_point.is_due(time_ns)
            && let Some(Pose {
                position: Some(Vector3 { x, y, z }),
                ..
            }) = flown
        {
            self.points.truncate(TRAIL_POINTS - 1);
            self.points.push_front(Point3 { x, y, z });
        }
        if self.trail.is_due(time_ns) {
            let trail = trail(time_ns, self.points.iter().copied().collect());
            self.say(&trail, Topic::Trail, time_ns, &mut write)?;
        }
        self.log_changes((codes, at(sensor_faults) as u64, sequential), time_ns, &mut write)?;
        Ok(time_ns)
    }

    /// The last message of a failed run.
    ///
    /// # Errors
    /// Errors of `write`.
    pub fn end<E>(
        &mut self,
        time_ns: u64,
        sentence: &str,
        mut write: impl FnMut(Topic, u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let line = log_line(time_ns, foxglove::log::Level::Fatal, "run", sentence.to_owned());
        self.say(&line, Topic::Log, time_ns, &mut write)
    }

    fn say<E>(
        &mut self,
        message: &impl Message,
        topic: Topic,
        time_ns: u64,
        write: &mut impl FnMut(Topic, u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        self.buffer.clear();
        message.encode(&mut self.buffer).expect("a Vec grows as needed");
        write(topic, time_ns, &self.buffer)
    }

    /// * `now`: condition of each rotor, sensor faults, verdict of the sequential detector
    fn log_changes<E>(
        &mut self,
        (conditions, sensor_faults, sequential): (Vec<i32>, u64, i32),
        time_ns: u64,
        write: &mut impl FnMut(Topic, u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        use foxglove::log::Level::{Info, Warning};
        let n = self.header.rotor_count;
        let first = (vec![0; n], 0, NOT_READY);
        let (old_conditions, old_sensor_faults, old_sequential) = self.before.take().unwrap_or(first);
        let mut lines = Vec::new();
        for rotor in (0..n).filter(|rotor| conditions[*rotor] != old_conditions[*rotor]) {
            let code = conditions[rotor];
            let name = match self.header.conditions.get(&code) {
                Some(name) => name.clone(),
                None if code == 0 => "healthy".to_owned(),
                None => format!("condition {code}"),
            };
            lines.push((Warning, "truth", format!("rotor {}: {name}", rotor + 1)));
        }
        for bit in (0..64).filter(|bit| (sensor_faults ^ old_sensor_faults) >> bit & 1 == 1) {
            let name = match self.header.sensor_faults.get(bit) {
                Some(name) => name.clone(),
                None => format!("sensor fault {}", bit + 1),
            };
            let verb = if sensor_faults >> bit & 1 == 1 {
                "begins"
            } else {
                "ends"
            };
            lines.push((Warning, "truth", format!("{name} {verb}")));
        }
        if sequential != old_sequential {
            let level = if sequential == HEALTHY { Info } else { Warning };
            lines.push((level, Evaluator::Sequential.title(), verdict_text(sequential)));
        }
        for (level, name, text) in lines {
            self.say(&log_line(time_ns, level, name, text), Topic::Log, time_ns, write)?;
        }
        self.before = Some((conditions, sensor_faults, sequential));
        Ok(())
    }
}

fn log_line(time_ns: u64, level: foxglove::log::Level, name: &str, message: String) -> Log {
    Log {
        timestamp: stamp(time_ns),
        level: level.into(),
        message,
        name: name.to_owned(),
        ..Log::default()
    }
}

fn stamp(time_ns: u64) -> Option<Timestamp> {
    Some(Timestamp {
        seconds: (time_ns / 1_000_000_000) as i64,
        nanos: (time_ns % 1_000_000_000) as i32,
    })
}

/// Pose in north-west-up of a forward-left-up body, from a position in NED and ZYX Euler angles of an FRD body; `None` if not finite.
fn flu_in_nwu([north, east, down]: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Option<Pose> {
    if ![north, east, down, roll, pitch, yaw]
        .iter()
        .all(|value| value.is_finite())
    {
        return None;
    }
    let ((sr, cr), (sp, cp), (sy, cy)) = ((roll / 2.0).sin_cos(), (pitch / 2.0).sin_cos(), (yaw / 2.0).sin_cos());
    // ned_from_body as a quaternion; half a turn about the x axis on both sides only flips the signs of y and z.
    Some(Pose {
        position: Some(Vector3 {
            x: north,
            y: -east,
            z: -down,
        }),
        orientation: Some(Quaternion {
            w: cr * cp * cy + sr * sp * sy,
            x: sr * cp * cy - cr * sp * sy,
            y: -(cr * sp * cy + sr * cp * sy),
            z: -(cr * cp * sy - sr * sp * cy),
        }),
    })
}

fn transform(child: &str, time_ns: u64, pose: Pose) -> FrameTransform {
    FrameTransform {
        timestamp: stamp(time_ns),
        parent_frame_id: "world".to_owned(),
        child_frame_id: child.to_owned(),
        translation: pose.position,
        rotation: pose.orientation,
    }
}

/// Drawing of a rotor.
struct DrawnRotor {
    thrust_n: f64,
    faulty: bool,
    suspected: bool,
}

const LEVEL: Quaternion = Quaternion {
    x: 0.0,
    y: 0.0,
    z: 0.0,
    w: 1.0,
};

/// Arrows point along x: a quarter turn about −y turns that up.
const UP: Quaternion = Quaternion {
    x: 0.0,
    y: -std::f64::consts::FRAC_1_SQRT_2,
    z: 0.0,
    w: std::f64::consts::FRAC_1_SQRT_2,
};

const fn pose(x: f64, y: f64, z: f64, orientation: Quaternion) -> Option<Pose> {
    Some(Pose {
        position: Some(Vector3 { x, y, z }),
        orientation: Some(orientation),
    })
}

/// The vehicle in its own frame: arms, a disc per rotor (red while faulty), an arrow proportional to its thrust (one arm length at hover;
/// orange while suspected by the sequential detector), the verdict as text.
fn scene(header: &SpoolHeader, time_ns: u64, rotors: &[DrawnRotor], sequential: i32, probability: f64) -> SceneUpdate {
    // FRD → FLU.
    let places: Vec<[f64; 3]> = header
        .rotor_positions_body_m
        .iter()
        .map(|[x, y, z]| [*x, -y, -z])
        .collect();
    let arm = places.iter().map(|[x, y, _]| x.hypot(*y)).fold(0.0, f64::max);
    let nearest = places.iter().enumerate().flat_map(|(i, [x, y, _])| {
        let others = places[..i].iter();
        others.map(move |[u, v, _]| (x - u).hypot(y - v))
    });
    let disc = 0.9 * nearest.fold(arm, f64::min);
    let cylinders = places.iter().zip(rotors).map(|([x, y, z], rotor)| CylinderPrimitive {
        pose: pose(*x, *y, *z, LEVEL),
        size: Some(Vector3 {
            x: disc,
            y: disc,
            z: 0.03 * arm,
        }),
        bottom_scale: 1.0,
        top_scale: 1.0,
        color: Some(if rotor.faulty { FAULTY_ROTOR } else { HEALTHY_ROTOR }),
    });
    let arrows = places
        .iter()
        .zip(rotors)
        .filter(|(_, rotor)| rotor.thrust_n.is_finite() && header.hover_thrust_n > 0.0)
        .map(|([x, y, z], rotor)| {
            let length = arm * rotor.thrust_n.max(0.0) / header.hover_thrust_n;
            let head = length.min(0.15 * arm);
            ArrowPrimitive {
                pose: pose(*x, *y, *z, UP),
                shaft_length: length - head,
                shaft_diameter: 0.05 * arm,
                head_length: head,
                head_diameter: 0.12 * arm,
                color: Some(if rotor.suspected { SUSPECTED } else { THRUST }),
            }
        });
    let arms = LinePrimitive {
        r#type: foxglove::line_primitive::Type::LineList.into(),
        pose: pose(0.0, 0.0, 0.0, LEVEL),
        thickness: 0.06 * arm,
        points: places
            .iter()
            .flat_map(|[x, y, z]| {
                let tip = Point3 { x: *x, y: *y, z: *z };
                [Point3::default(), tip]
            })
            .collect(),
        color: Some(FRAME),
        ..LinePrimitive::default()
    };
    let size = |x: f64, y: f64, z: f64| Some(Vector3 { x, y, z });
    let body = [
        // The nose is elongated.
        (0.0, size(0.35 * arm, 0.35 * arm, 0.2 * arm)),
        (0.2 * arm, size(0.3 * arm, 0.1 * arm, 0.1 * arm)),
    ];
    let words = match sequential {
        NOT_READY => verdict_text(sequential),
        _ if probability.is_finite() => format!("{} (p {probability:.2})", verdict_text(sequential)),
        _ => verdict_text(sequential),
    };
    let verdict = TextPrimitive {
        pose: pose(0.0, 0.0, 2.0 * arm, LEVEL),
        billboard: true,
        font_size: 0.3 * arm,
        color: Some(if matches!(sequential, HEALTHY | NOT_READY) {
            FRAME
        } else {
            SUSPECTED
        }),
        text: words,
        ..TextPrimitive::default()
    };
    SceneUpdate {
        deletions: Vec::new(),
        entities: vec![SceneEntity {
            timestamp: stamp(time_ns),
            frame_id: "vehicle".to_owned(),
            id: "vehicle".to_owned(),
            // Until the next one.
            lifetime: Some(Duration::default()),
            frame_locked: true,
            arrows: arrows.collect(),
            cylinders: cylinders.collect(),
            lines: vec![arms],
            spheres: body
                .map(|(x, size)| SpherePrimitive {
                    pose: pose(x, 0.0, 0.0, LEVEL),
                    size,
                    color: Some(FRAME),
                })
                .into(),
            texts: vec![verdict],
            ..SceneEntity::default()
        }],
    }
}

fn trail(time_ns: u64, points: Vec<Point3>) -> SceneUpdate {
    SceneUpdate {
        deletions: Vec::new(),
        entities: vec![SceneEntity {
            timestamp: stamp(time_ns),
            frame_id: "world".to_owned(),
            id: "trail".to_owned(),
            lifetime: Some(Duration::default()),
            lines: vec![LinePrimitive {
                r#type: foxglove::line_primitive::Type::LineStrip.into(),
                pose: pose(0.0, 0.0, 0.0, LEVEL),
                // Pixels.
                thickness: 2.0,
                scale_invariant: true,
                points,
                color: Some(TRAIL),
                ..LinePrimitive::default()
            }],
            ..SceneEntity::default()
        }],
    }
}
