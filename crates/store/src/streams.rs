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

mod drawing;
mod row;

use crate::spool::SpoolHeader;
use crate::summary::{Evaluator, verdict_text};
use crate::telemetry::Column;
use drawing::{DrawnRotor, scene, stamp, trail};
use prost::Message;
use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY};
use rotortwin_proto::foxglove::{self, FrameTransform, Log, Point3, Pose, PoseInFrame, Quaternion, Vector3};
use row::{Places, Row};
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
        Self {
            header: header.clone(),
            places: Places::of(columns),
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
        let row = Row::new(at, self.places, self.header.rotor_count);
        let time_ns = row.time_ns();
        self.say(&row.nav(), Topic::Nav, time_ns, &mut write)?;
        self.say(&row.reference(), Topic::Reference, time_ns, &mut write)?;
        self.say(&row.command(), Topic::Command, time_ns, &mut write)?;
        self.say(&row.truth(), Topic::Truth, time_ns, &mut write)?;
        self.say(&row.battery(), Topic::Battery, time_ns, &mut write)?;
        self.say(&row.fdi(), Topic::Fdi, time_ns, &mut write)?;
        let (position, attitude) = row.flown();
        let flown = flu_in_nwu(position, attitude);
        let (position, attitude) = row.asked();
        self.say_poses(flown, flu_in_nwu(position, attitude), time_ns, &mut write)?;
        self.say_scene(&row, time_ns, &mut write)?;
        self.say_trail(flown, time_ns, &mut write)?;
        let now = (row.rotor_conditions(), row.sensor_faults(), row.sequential());
        self.log_changes(now, time_ns, &mut write)?;
        Ok(time_ns)
    }

    /// Poses of vehicle and reference, when they are due.
    fn say_poses<E>(
        &mut self,
        flown: Option<Pose>,
        asked: Option<Pose>,
        time_ns: u64,
        write: &mut impl FnMut(Topic, u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        if !self.pose.is_due(time_ns) {
            return Ok(());
        }
        for (child, topic, pose) in [
            ("vehicle", Topic::Pose, flown),
            ("reference", Topic::ReferencePose, asked),
        ] {
            let Some(pose) = pose else { continue };
            self.say(&transform(child, time_ns, pose), Topic::Transform, time_ns, write)?;
            let message = PoseInFrame {
                timestamp: stamp(time_ns),
                frame_id: "world".to_owned(),
                pose: Some(pose),
            };
            self.say(&message, topic, time_ns, write)?;
        }
        Ok(())
    }

    /// The drawing of the vehicle, when it is due.
    fn say_scene<E>(
        &mut self,
        row: &Row<impl Fn(usize) -> f64>,
        time_ns: u64,
        write: &mut impl FnMut(Topic, u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        if !self.scene.is_due(time_ns) || self.header.rotor_positions_body_m.is_empty() {
            return Ok(());
        }
        let (sequential, suspected) = (row.sequential(), row.suspect_rotors());
        let rotors = row.rotor_conditions().into_iter().enumerate();
        let rotors: Vec<DrawnRotor> = rotors
            .map(|(rotor, condition)| DrawnRotor {
                thrust_n: row.thrust_n(rotor),
                faulty: condition != 0,
                suspected: sequential != HEALTHY && suspected >> rotor & 1 == 1,
            })
            .collect();
        let scene = scene(&self.header, time_ns, &rotors, sequential, row.probability());
        self.say(&scene, Topic::Scene, time_ns, write)
    }

    /// Another point of the path flown, and the path, each when it is due.
    fn say_trail<E>(
        &mut self,
        flown: Option<Pose>,
        time_ns: u64,
        write: &mut impl FnMut(Topic, u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
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
            self.say(&trail, Topic::Trail, time_ns, write)?;
        }
        Ok(())
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
