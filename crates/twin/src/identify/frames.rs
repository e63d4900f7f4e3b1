//! Frames: where the rotor of each motor number is, and how it turns.
//!
//! Angles in degrees from the nose, clockwise seen from above. Numbers are those of the autopilot: ArduPilot's frame classes and types
//! (`AP_MotorsMatrix`), which PX4's fixed airframes share. Coaxial frames (X8, Y6) are not here: a vehicle document cannot hold two rotors
//! on one axis.

use rotortwin_plant::vehicle::model::SpinDirection::{self, Ccw, Cw};
use std::collections::BTreeMap;

/// One rotor of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Forward, right: unit of the arm.
    pub position: [f64; 2],
    /// Seen from above.
    pub spin: SpinDirection,
}

impl Place {
    fn at(degrees: f64, spin: SpinDirection) -> Self {
        let (sin, cos) = libm::sincos(degrees.to_radians());
        Self {
            position: [cos, sin],
            spin,
        }
    }

    /// +1 for a rotor that pushes the nose to the right.
    pub fn yaw_sign(&self) -> f64 {
        if self.spin == Ccw { 1.0 } else { -1.0 }
    }
}

/// A frame of a table.
#[derive(Debug)]
pub struct Frame {
    /// Name on the command line.
    pub name: &'static str,
    /// FRAME_CLASS of ArduPilot.
    class: u32,
    /// FRAME_TYPE of ArduPilot.
    kind: u32,
    /// SYS_AUTOSTART of PX4's generic airframe, 0 where it has none.
    airframe: u32,
    /// Angle and spin by motor number.
    motors: &'static [(f64, SpinDirection)],
}

/// Every frame that can be named.
pub const FRAMES: &[Frame] = &[
    frame(
        "quad-x",
        1,
        1,
        4001,
        &[(45.0, Ccw), (-135.0, Ccw), (-45.0, Cw), (135.0, Cw)],
    ),
    frame(
        "quad-plus",
        1,
        0,
        5001,
        &[(90.0, Ccw), (-90.0, Ccw), (0.0, Cw), (180.0, Cw)],
    ),
    frame(
        "quad-v",
        1,
        2,
        0,
        &[(45.0, Ccw), (-135.0, Ccw), (-45.0, Cw), (135.0, Cw)],
    ),
    frame(
        "quad-h",
        1,
        3,
        0,
        &[(45.0, Cw), (-135.0, Cw), (-45.0, Ccw), (135.0, Ccw)],
    ),
    frame(
        "quad-betaflight-x",
        1,
        12,
        0,
        &[(135.0, Cw), (45.0, Ccw), (-135.0, Ccw), (-45.0, Cw)],
    ),
    frame(
        "quad-dji-x",
        1,
        13,
        0,
        &[(45.0, Ccw), (-45.0, Cw), (-135.0, Ccw), (135.0, Cw)],
    ),
    frame(
        "quad-cw-x",
        1,
        14,
        0,
        &[(45.0, Ccw), (135.0, Cw), (-135.0, Ccw), (-45.0, Cw)],
    ),
    frame(
        "quad-betaflight-x-reversed",
        1,
        18,
        0,
        &[(135.0, Ccw), (45.0, Cw), (-135.0, Cw), (-45.0, Ccw)],
    ),
    frame(
        "hexa-x",
        2,
        1,
        6001,
        &[
            (90.0, Cw),
            (-90.0, Ccw),
            (-30.0, Cw),
            (150.0, Ccw),
            (30.0, Ccw),
            (-150.0, Cw),
        ],
    ),
    frame(
        "hexa-plus",
        2,
        0,
        7001,
        &[
            (0.0, Cw),
            (180.0, Ccw),
            (-120.0, Cw),
            (60.0, Ccw),
            (-60.0, Ccw),
            (120.0, Cw),
        ],
    ),
    frame(
        "hexa-dji-x",
        2,
        13,
        0,
        &[
            (30.0, Ccw),
            (-30.0, Cw),
            (-90.0, Ccw),
            (-150.0, Cw),
            (150.0, Ccw),
            (90.0, Cw),
        ],
    ),
    frame(
        "hexa-cw-x",
        2,
        14,
        0,
        &[
            (30.0, Ccw),
            (90.0, Cw),
            (150.0, Ccw),
            (-150.0, Cw),
            (-90.0, Ccw),
            (-30.0, Cw),
        ],
    ),
    frame(
        "octo-x",
        3,
        1,
        8001,
        &[
            (22.5, Cw),
            (-157.5, Cw),
            (67.5, Ccw),
            (157.5, Ccw),
            (-22.5, Ccw),
            (-112.5, Ccw),
            (-67.5, Cw),
            (112.5, Cw),
        ],
    ),
    frame(
        "octo-plus",
        3,
        0,
        9001,
        &[
            (0.0, Cw),
            (180.0, Cw),
            (45.0, Ccw),
            (135.0, Ccw),
            (-45.0, Ccw),
            (-135.0, Ccw),
            (-90.0, Cw),
            (90.0, Cw),
        ],
    ),
    frame(
        "octo-dji-x",
        3,
        13,
        0,
        &[
            (22.5, Ccw),
            (-22.5, Cw),
            (-67.5, Ccw),
            (-112.5, Cw),
            (-157.5, Ccw),
            (157.5, Cw),
            (112.5, Ccw),
            (67.5, Cw),
        ],
    ),
    frame(
        "octo-cw-x",
        3,
        14,
        0,
        &[
            (22.5, Ccw),
            (67.5, Cw),
            (112.5, Ccw),
            (157.5, Cw),
            (-157.5, Ccw),
            (-112.5, Cw),
            (-67.5, Ccw),
            (-22.5, Cw),
        ],
    ),
];

const fn frame(
    name: &'static str,
    class: u32,
    kind: u32,
    airframe: u32,
    motors: &'static [(f64, SpinDirection)],
) -> Frame {
    Frame {
        name,
        class,
        kind,
        airframe,
        motors,
    }
}

impl Frame {
    /// By its name on the command line.
    pub fn named(name: &str) -> Option<&'static Self> {
        FRAMES.iter().find(|frame| frame.name == name)
    }

    /// The frame whose motor numbers have these places.
    pub(crate) fn of_places(places: &[Place]) -> Option<&'static Self> {
        let same = |a: &Place, b: &Place| {
            a.spin == b.spin && (0..2).all(|axis| (a.position[axis] - b.position[axis]).abs() < 1e-6)
        };
        FRAMES.iter().find(|frame| {
            let own = frame.places();
            own.len() == places.len() && own.iter().zip(places).all(|(a, b)| same(a, b))
        })
    }

    /// The places in the order of motor numbers.
    pub fn places(&self) -> Vec<Place> {
        self.motors
            .iter()
            .map(|&(angle, spin)| Place::at(angle, spin))
            .collect()
    }

    /// The frame of ArduPilot's parameters; an error where they name one that no vehicle document can hold.
    pub(crate) fn of_ardupilot(parameters: &BTreeMap<String, f64>) -> Result<Option<&'static Self>, String> {
        let (Some(&class), Some(&kind)) = (parameters.get("FRAME_CLASS"), parameters.get("FRAME_TYPE")) else {
            return Ok(None);
        };
        let known = FRAMES
            .iter()
            .find(|frame| f64::from(frame.class) == class && f64::from(frame.kind) == kind);
        match known {
            Some(frame) => Ok(Some(frame)),
            None if class == 0.0 => Ok(None),
            None => Err(format!(
                "FRAME_CLASS {class}, FRAME_TYPE {kind}: {}",
                match class as i64 {
                    4 | 5 => "a coaxial frame; a vehicle cannot have two rotors on one axis",
                    _ => "this frame is in no table; name another with --frame if its rotors are where that one's are",
                }
            )),
        }
    }

    /// The frame of ArduPilot before 3.5, whose `FRAME` says the kind and whose firmware the number of rotors.
    pub(crate) fn of_old_ardupilot(parameters: &BTreeMap<String, f64>, rotors: usize) -> Option<&'static Self> {
        let kind = *parameters.get("FRAME")?;
        let class = match rotors {
            4 => 1,
            6 => 2,
            8 => 3,
            _ => return None,
        };
        // Plus, X, V, H; what came later was not known then.
        (0.0..=3.0).contains(&kind).then_some(())?;
        FRAMES
            .iter()
            .find(|frame| frame.class == class && f64::from(frame.kind) == kind)
    }

    /// The frame of PX4's airframes: those of one group (ROMFS/px4fmu_common/init.d/airframes: 4000 to 4999 are X quadrotors, 5000 to 5999
    /// plus quadrotors, and so on) share their motors.
    pub(crate) fn of_px4_airframe(parameters: &BTreeMap<String, f64>) -> Option<&'static Self> {
        let airframe = *parameters.get("SYS_AUTOSTART")?;
        let group = (airframe / f64::from(GROUP)).floor();
        FRAMES
            .iter()
            .find(|frame| frame.airframe != 0 && f64::from(frame.airframe / GROUP) == group)
            .filter(|_| (airframe - REAPER).abs() > 0.5)
    }
}

/// Numbers of PX4's airframes in a group.
const GROUP: u32 = 1000;

/// 4040_reaper, an H frame among the X frames.
const REAPER: f64 = 4040.0;

/// Rotors of PX4's control allocation (`CA_ROTORn_PX`, `_PY`, `_KM`), in units of the longest arm, with that arm, m.
pub(crate) fn of_px4_allocation(parameters: &BTreeMap<String, f64>) -> Option<(Vec<Place>, f64)> {
    if parameters.get("CA_AIRFRAME").is_some_and(|kind| *kind != 0.0) {
        return None;
    }
    let count = *parameters.get("CA_ROTOR_COUNT")?;
    if !(4.0..=16.0).contains(&count) {
        return None;
    }
    let rotors: Vec<[f64; 3]> = (0..count as usize)
        .map(|rotor| {
            let value = |name: &str| parameters.get(&format!("CA_ROTOR{rotor}_{name}")).copied();
            Some([value("PX")?, value("PY")?, value("KM")?])
        })
        .collect::<Option<_>>()?;
    let arm = rotors.iter().map(|[x, y, _]| x.hypot(*y)).fold(0.0, f64::max);
    // Factory values that nobody entered are all zero.
    (arm > 0.0 && rotors.iter().all(|[x, y, km]| x.hypot(*y) > 0.0 && *km != 0.0)).then(|| {
        let places = rotors
            .iter()
            .map(|[x, y, km]| Place {
                position: [x / arm, y / arm],
                spin: if *km > 0.0 { Ccw } else { Cw },
            })
            .collect();
        (places, arm)
    })
}

/// The even polygons that wirings are searched over: rotor angles of the X and the plus layout.
pub(crate) fn polygons(rotors: usize) -> [(&'static str, Vec<Place>); 2] {
    let ring = |offset: f64| {
        (0..rotors)
            .map(|i| {
                let spin = if i % 2 == 0 { Ccw } else { Cw };
                Place::at(360.0 / rotors as f64 * (i as f64 + offset), spin)
            })
            .collect()
    };
    [("X", ring(0.5)), ("plus", ring(0.0))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_every_frame_is_an_even_polygon_that_no_thrust_turns() {
        for frame in FRAMES {
            let places = frame.places();
            for sum in [
                places.iter().map(|p| p.position[0]).sum::<f64>(),
                places.iter().map(|p| p.position[1]).sum::<f64>(),
                places.iter().map(Place::yaw_sign).sum::<f64>(),
                places.iter().map(|p| p.yaw_sign() * p.position[0]).sum::<f64>(),
                places.iter().map(|p| p.yaw_sign() * p.position[1]).sum::<f64>(),
            ] {
                assert!(sum.abs() < 1e-9, "{}: {sum}", frame.name);
            }
        }
    }

    /// 4014 is PX4's S500, 4040 an H frame among the X frames, 13000 a VTOL.
    #[test]
    fn regress_an_airframe_of_px4_has_the_motors_of_its_group() {
        let of = |number: f64| {
            let parameters = BTreeMap::from([("SYS_AUTOSTART".to_owned(), number)]);
            Frame::of_px4_airframe(&parameters).map(|frame| frame.name)
        };
        assert_eq!(of(4001.0), Some("quad-x"));
        assert_eq!(of(4014.0), Some("quad-x"));
        assert_eq!(of(6002.0), Some("hexa-x"));
        for other in [0.0, 1001.0, 4040.0, 13_000.0, 2_147_483_648.0, f64::NAN] {
            assert_eq!(of(other), None, "{other}");
        }
    }

    /// A log is read by this table, a flight goes by `config/autopilots`.
    #[test]
    fn val_logs_and_flights_of_a_frame_have_the_same_outputs() {
        use rotortwin_scenario::autopilot_frame::{AutopilotFrame, AutopilotKind};
        let mut compared = 0;
        for flown in AutopilotFrame::built_in() {
            // What Betaflight logs has no parameter of a frame; ArduPilot's frame of that name is Betaflight's quadrotor.
            if flown.autopilot == AutopilotKind::Betaflight {
                continue;
            }
            let read = FRAMES.iter().find(|frame| frame.name == flown.frame);
            let read = read.unwrap_or_else(|| panic!("{}: no table has the frame {}", flown.name, flown.frame));
            let places = read.places();
            assert_eq!(places.len(), flown.motor.len(), "{}", flown.name);
            for motor in &flown.motor {
                let place = places[motor.channel as usize - 1];
                let expected = Place::at(motor.azimuth_deg, motor.spin);
                let away = (0..2)
                    .map(|axis| (place.position[axis] - expected.position[axis]).abs())
                    .fold(0.0, f64::max);
                assert!(
                    away < 0.02 && place.spin == expected.spin,
                    "{}, channel {}: {place:?}, {expected:?}",
                    flown.name,
                    motor.channel
                );
            }
            compared += 1;
        }
        assert_eq!(compared, 10);
    }

    /// The mappings for logs of PX4 give the rotors of the vehicle that its frame file gives in flight.
    #[test]
    fn val_mappings_of_px4_logs_have_the_order_of_its_frames() {
        use rotortwin_scenario::autopilot_frame::AutopilotFrame;
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
        for (frame, vehicle) in [
            ("hexa-x", "f550-skids"),
            ("quad-x", "quad-x-skids"),
            ("octo-x", "octo-x-skids"),
        ] {
            let name = format!("px4-{frame}");
            let mapping =
                std::fs::read_to_string(folder.join(format!("autopilot-settings/{name}.log-mapping.toml"))).unwrap();
            let mapping: toml::Value = toml::from_str(&mapping).unwrap();
            let order = mapping["column"][0]["order"].as_array().unwrap().iter();
            let order: Vec<usize> = order
                .map(|output| usize::try_from(output.as_integer().unwrap()).unwrap())
                .collect();
            let flown = AutopilotFrame::built_in()
                .into_iter()
                .find(|flown| flown.name == name)
                .unwrap();
            let store = tempfile::tempdir().unwrap();
            let vehicle = crate::model::ModelStore::new(store.path())
                .find(vehicle)
                .unwrap()
                .version
                .vehicle;
            for (output, rotor) in flown.rotors(&vehicle).unwrap().into_iter().enumerate() {
                assert_eq!(order[rotor], output + 1, "{name}: our rotor {}", rotor + 1);
            }
        }
    }
}
