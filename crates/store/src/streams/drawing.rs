//! Drawings for 3-D panels: the vehicle with its rotors, and the path flown.

use crate::spool::SpoolHeader;
use crate::summary::verdict_text;
use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY};
use rotortwin_proto::foxglove::{
    self, ArrowPrimitive, Color, CylinderPrimitive, LinePrimitive, Point3, Pose, Quaternion, SceneEntity, SceneUpdate,
    SpherePrimitive, TextPrimitive, Vector3,
};
use rotortwin_proto::google::protobuf::{Duration, Timestamp};

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

/// A time in these messages.
pub(super) fn stamp(time_ns: u64) -> Option<Timestamp> {
    Some(Timestamp {
        seconds: (time_ns / 1_000_000_000) as i64,
        nanos: (time_ns % 1_000_000_000) as i32,
    })
}

/// Drawing of a rotor.
pub(super) struct DrawnRotor {
    pub(super) thrust_n: f64,
    pub(super) faulty: bool,
    pub(super) suspected: bool,
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

/// Places of the rotors, forward-left-up, and sizes that follow from them.
struct Layout {
    places_m: Vec<[f64; 3]>,
    /// The longest arm, m.
    arm_m: f64,
    /// Diameter of a disc, m: neighbours do not touch.
    disc_m: f64,
}

impl Layout {
    fn new(rotor_positions_body_m: &[[f64; 3]]) -> Self {
        // FRD → FLU.
        let places: Vec<[f64; 3]> = rotor_positions_body_m.iter().map(|[x, y, z]| [*x, -y, -z]).collect();
        let arm = places.iter().map(|[x, y, _]| x.hypot(*y)).fold(0.0, f64::max);
        let nearest = places.iter().enumerate().flat_map(|(i, [x, y, _])| {
            let others = places[..i].iter();
            others.map(move |[u, v, _]| (x - u).hypot(y - v))
        });
        let disc_m = 0.9 * nearest.fold(arm, f64::min);
        Self {
            places_m: places,
            arm_m: arm,
            disc_m,
        }
    }

    fn disc(&self, [x, y, z]: [f64; 3], rotor: &DrawnRotor) -> CylinderPrimitive {
        CylinderPrimitive {
            pose: pose(x, y, z, LEVEL),
            size: Some(Vector3 {
                x: self.disc_m,
                y: self.disc_m,
                z: 0.03 * self.arm_m,
            }),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: Some(if rotor.faulty { FAULTY_ROTOR } else { HEALTHY_ROTOR }),
        }
    }

    fn thrust_arrow(&self, [x, y, z]: [f64; 3], rotor: &DrawnRotor, hover_thrust_n: f64) -> ArrowPrimitive {
        let length = self.arm_m * rotor.thrust_n.max(0.0) / hover_thrust_n;
        let head = length.min(0.15 * self.arm_m);
        ArrowPrimitive {
            pose: pose(x, y, z, UP),
            shaft_length: length - head,
            shaft_diameter: 0.05 * self.arm_m,
            head_length: head,
            head_diameter: 0.12 * self.arm_m,
            color: Some(if rotor.suspected { SUSPECTED } else { THRUST }),
        }
    }

    fn arms(&self) -> LinePrimitive {
        LinePrimitive {
            r#type: foxglove::line_primitive::Type::LineList.into(),
            pose: pose(0.0, 0.0, 0.0, LEVEL),
            thickness: 0.06 * self.arm_m,
            points: self
                .places_m
                .iter()
                .flat_map(|[x, y, z]| {
                    let tip = Point3 { x: *x, y: *y, z: *z };
                    [Point3::default(), tip]
                })
                .collect(),
            color: Some(FRAME),
            ..LinePrimitive::default()
        }
    }

    fn body(&self) -> Vec<SpherePrimitive> {
        let arm = self.arm_m;
        let size = |x: f64, y: f64, z: f64| Some(Vector3 { x, y, z });
        let spheres = [
            // The nose is elongated.
            (0.0, size(0.35 * arm, 0.35 * arm, 0.2 * arm)),
            (0.2 * arm, size(0.3 * arm, 0.1 * arm, 0.1 * arm)),
        ];
        spheres
            .map(|(x, size)| SpherePrimitive {
                pose: pose(x, 0.0, 0.0, LEVEL),
                size,
                color: Some(FRAME),
            })
            .into()
    }

    fn verdict(&self, sequential: i32, probability: f64) -> TextPrimitive {
        let words = match sequential {
            NOT_READY => verdict_text(sequential),
            _ if probability.is_finite() => format!("{} (p {probability:.2})", verdict_text(sequential)),
            _ => verdict_text(sequential),
        };
        TextPrimitive {
            pose: pose(0.0, 0.0, 2.0 * self.arm_m, LEVEL),
            billboard: true,
            font_size: 0.3 * self.arm_m,
            color: Some(if matches!(sequential, HEALTHY | NOT_READY) {
                FRAME
            } else {
                SUSPECTED
            }),
            text: words,
            ..TextPrimitive::default()
        }
    }
}

/// The vehicle in its own frame: arms, a disc per rotor (red while faulty), an arrow proportional to its thrust (one arm length at hover;
/// orange while suspected by the sequential detector), the verdict as text.
pub(super) fn scene(
    header: &SpoolHeader,
    time_ns: u64,
    rotors: &[DrawnRotor],
    sequential: i32,
    probability: f64,
) -> SceneUpdate {
    let layout = Layout::new(&header.rotor_positions_body_m);
    let placed = || layout.places_m.iter().copied().zip(rotors);
    let arrows = placed()
        .filter(|(_, rotor)| rotor.thrust_n.is_finite() && header.hover_thrust_n > 0.0)
        .map(|(place, rotor)| layout.thrust_arrow(place, rotor, header.hover_thrust_n));
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
            cylinders: placed().map(|(place, rotor)| layout.disc(place, rotor)).collect(),
            lines: vec![layout.arms()],
            spheres: layout.body(),
            texts: vec![layout.verdict(sequential, probability)],
            ..SceneEntity::default()
        }],
    }
}

/// The path flown, latest point first.
pub(super) fn trail(time_ns: u64, points: Vec<Point3>) -> SceneUpdate {
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
