//! Frames: where the rotor of each motor number is, and how it turns.
//!
//! Angles in degrees from the nose, clockwise seen from above. Numbers are those of the autopilot: ArduPilot's frame classes and types
//! (`AP_MotorsMatrix`), which PX4's fixed airframes share. Those that are flown, too, are in `config/autopilots`, and read from there; the
//! others are here. Of two coaxial rotors (X8, Y6) it is not determined which is the upper one: their columns of the effectiveness matrix do
//! not depend on height.

use rotortwin_plant::vehicle::model::SpinDirection::{self, Ccw, Cw};
use rotortwin_scenario::autopilot_frame::AutopilotFrame;
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// One rotor of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Forward, right: unit of the arm.
    pub position: [f64; 2],
    /// Rotation sense, seen from above.
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
    motors: Vec<(f64, SpinDirection)>,
}

/// FRAME_CLASS of ArduPilot's Y6.
const Y6: u32 = 5;

/// Every frame that can be named.
pub static FRAMES: LazyLock<Vec<Frame>> = LazyLock::new(|| {
    let documents = AutopilotFrame::built_in();
    ENTRIES.iter().map(|entry| entry.frame(&documents)).collect()
});

/// A frame, and where its motors are written.
struct Entry {
    name: &'static str,
    class: u32,
    kind: u32,
    airframe: u32,
    motors: Motors,
}

enum Motors {
    /// In a document of `config/autopilots`, by its name.
    Flown(&'static str),
    /// Angle and spin by motor number: no document has this frame.
    Here(&'static [(f64, SpinDirection)]),
}
use Motors::{Flown, Here};

impl Entry {
    fn frame(&self, documents: &[AutopilotFrame]) -> Frame {
        let motors = match self.motors {
            Here(motors) => motors.to_vec(),
            Flown(name) => {
                let document = documents.iter().find(|document| document.name == name);
                let mut motors = document.expect("a shipped document").motor.clone();
                motors.sort_by_key(|motor| motor.channel);
                motors.iter().map(|motor| (motor.azimuth_deg, motor.spin)).collect()
            }
        };
        Frame {
            name: self.name,
            class: self.class,
            kind: self.kind,
            airframe: self.airframe,
            motors,
        }
    }
}

const ENTRIES: &[Entry] = &[
    frame("quad-x", 1, 1, 4001, Flown("ardupilot-quad-x")),
    frame("quad-plus", 1, 0, 5001, Flown("ardupilot-quad-plus")),
    frame(
        "quad-v",
        1,
        2,
        0,
        Here(&[(45.0, Ccw), (-135.0, Ccw), (-45.0, Cw), (135.0, Cw)]),
    ),
    frame(
        "quad-h",
        1,
        3,
        0,
        Here(&[(45.0, Cw), (-135.0, Cw), (-45.0, Ccw), (135.0, Ccw)]),
    ),
    frame("quad-betaflight-x", 1, 12, 0, Flown("betaflight-quadx")),
    frame(
        "quad-dji-x",
        1,
        13,
        0,
        Here(&[(45.0, Ccw), (-45.0, Cw), (-135.0, Ccw), (135.0, Cw)]),
    ),
    frame(
        "quad-cw-x",
        1,
        14,
        0,
        Here(&[(45.0, Ccw), (135.0, Cw), (-135.0, Ccw), (-45.0, Cw)]),
    ),
    frame(
        "quad-betaflight-x-reversed",
        1,
        18,
        0,
        Here(&[(135.0, Ccw), (45.0, Cw), (-135.0, Cw), (-45.0, Ccw)]),
    ),
    frame("hexa-x", 2, 1, 6001, Flown("ardupilot-hexa-x")),
    frame("hexa-plus", 2, 0, 7001, Flown("ardupilot-hexa-plus")),
    frame(
        "hexa-dji-x",
        2,
        13,
        0,
        Here(&[
            (30.0, Ccw),
            (-30.0, Cw),
            (-90.0, Ccw),
            (-150.0, Cw),
            (150.0, Ccw),
            (90.0, Cw),
        ]),
    ),
    frame(
        "hexa-cw-x",
        2,
        14,
        0,
        Here(&[
            (30.0, Ccw),
            (90.0, Cw),
            (150.0, Ccw),
            (-150.0, Cw),
            (-90.0, Ccw),
            (-30.0, Cw),
        ]),
    ),
    frame("octo-x", 3, 1, 8001, Flown("ardupilot-octo-x")),
    frame("octo-plus", 3, 0, 9001, Flown("ardupilot-octo-plus")),
    frame(
        "octo-dji-x",
        3,
        13,
        0,
        Here(&[
            (22.5, Ccw),
            (-22.5, Cw),
            (-67.5, Ccw),
            (-112.5, Cw),
            (-157.5, Ccw),
            (157.5, Cw),
            (112.5, Ccw),
            (67.5, Cw),
        ]),
    ),
    frame("octo-cw-x", 3, 14, 0, Flown("ardupilot-octo-cw-x")),
    // Coaxial, of PX4 too: pairs on four arms, motors 1 to 4 above.
    frame("octaquad-x", 4, 1, 12_001, Flown("ardupilot-octaquad-x")),
    frame(
        "octaquad-plus",
        4,
        0,
        0,
        Here(&[
            (0.0, Ccw),
            (-90.0, Cw),
            (180.0, Ccw),
            (90.0, Cw),
            (-90.0, Ccw),
            (0.0, Cw),
            (90.0, Ccw),
            (180.0, Cw),
        ]),
    ),
    frame(
        "octaquad-h",
        4,
        3,
        0,
        Here(&[
            (45.0, Cw),
            (-45.0, Ccw),
            (-135.0, Cw),
            (135.0, Ccw),
            (-45.0, Cw),
            (45.0, Ccw),
            (135.0, Cw),
            (-135.0, Ccw),
        ]),
    ),
    // Pairs on three arms; every kind but 10 and 11 is the first.
    frame(
        "y6a",
        Y6,
        1,
        0,
        Here(&[
            (60.0, Ccw),
            (-60.0, Cw),
            (-60.0, Ccw),
            (180.0, Cw),
            (60.0, Cw),
            (180.0, Ccw),
        ]),
    ),
    frame(
        "y6b",
        Y6,
        10,
        11_001,
        Here(&[
            (60.0, Cw),
            (60.0, Ccw),
            (180.0, Cw),
            (180.0, Ccw),
            (-60.0, Cw),
            (-60.0, Ccw),
        ]),
    ),
    frame(
        "y6f",
        Y6,
        11,
        0,
        Here(&[
            (180.0, Ccw),
            (60.0, Ccw),
            (-60.0, Ccw),
            (180.0, Cw),
            (60.0, Cw),
            (-60.0, Cw),
        ]),
    ),
];

const fn frame(name: &'static str, class: u32, kind: u32, airframe: u32, motors: Motors) -> Entry {
    Entry {
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
        // `AP_MotorsMatrix`: a Y6 of any other kind is Y6A.
        let kind = if class == f64::from(Y6) && ![10.0, 11.0].contains(&kind) {
            1.0
        } else {
            kind
        };
        let known = FRAMES
            .iter()
            .find(|frame| f64::from(frame.class) == class && f64::from(frame.kind) == kind);
        match known {
            Some(frame) => Ok(Some(frame)),
            None if class == 0.0 => Ok(None),
            None => Err(format!(
                "FRAME_CLASS {class}, FRAME_TYPE {kind}: this frame is in no table; name another with --frame if its rotors are where that one's \
                 are"
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
        // Plus, X, V, H; later ones were not known then.
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
    // Factory values, never edited, are all zero.
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

/// A set of places over which motors are distributed where no parameter says their order.
pub(crate) struct Ring {
    /// What people call it.
    pub layout: &'static str,
    /// Without an order.
    pub places: Vec<Place>,
    /// With every spin reversed it is another set of places.
    pub has_a_mirror: bool,
}

/// The layouts that wirings are searched over: the even polygons, X and plus, and for six rotors three coaxial pairs.
pub(crate) fn rings(rotors: usize) -> Vec<Ring> {
    let polygon = |layout, offset: f64| {
        let place = |i: usize| {
            let spin = if i.is_multiple_of(2) { Ccw } else { Cw };
            Place::at(360.0 / rotors as f64 * (i as f64 + offset), spin)
        };
        Ring {
            layout,
            places: (0..rotors).map(place).collect(),
            has_a_mirror: true,
        }
    };
    let mut rings = vec![polygon("X", 0.5), polygon("plus", 0.0)];
    if rotors == 6 {
        let y6 = Frame::named("y6b").expect("in the table");
        rings.push(Ring {
            layout: "Y6",
            places: y6.places(),
            has_a_mirror: false,
        });
    }
    rings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_no_thrust_turns_a_frame() {
        for frame in FRAMES.iter() {
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

    /// ArduPilot's parameters of the coaxial frames; an unknown kind of Y6 is treated as Y6A.
    #[test]
    fn val_coaxial_frames_are_pairs_on_three_or_four_arms() {
        let of = |class: f64, kind: f64| {
            let parameters = BTreeMap::from([("FRAME_CLASS".to_owned(), class), ("FRAME_TYPE".to_owned(), kind)]);
            Frame::of_ardupilot(&parameters)
        };
        for (class, kind, name, arms) in [
            (4.0, 1.0, "octaquad-x", 4),
            (4.0, 0.0, "octaquad-plus", 4),
            (4.0, 3.0, "octaquad-h", 4),
            (5.0, 0.0, "y6a", 3),
            (5.0, 1.0, "y6a", 3),
            (5.0, 10.0, "y6b", 3),
            (5.0, 11.0, "y6f", 3),
        ] {
            let frame = of(class, kind).unwrap().unwrap();
            assert_eq!(frame.name, name);
            let places = frame.places();
            assert_eq!(places.len(), 2 * arms, "{name}");
            for place in &places {
                let on_its_arm: Vec<&Place> = places.iter().filter(|other| other.position == place.position).collect();
                assert_eq!(on_its_arm.len(), 2, "{name}");
                assert_ne!(on_its_arm[0].spin, on_its_arm[1].spin, "{name}");
            }
        }
        // OCTAQUAD V has arms of its own, which no table holds.
        assert!(of(4.0, 2.0).unwrap_err().contains("in no table"));
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

    /// Numbers of `AP_MotorsMatrix`, by hand: an error in a document would be one of logs and flights alike.
    #[test]
    fn val_documents_of_frames_have_ardupilot_s_motors() {
        let expected: [(&str, &[(f64, SpinDirection)]); 9] = [
            (
                "quad-betaflight-x",
                &[(135.0, Cw), (45.0, Ccw), (-135.0, Ccw), (-45.0, Cw)],
            ),
            ("quad-x", &[(45.0, Ccw), (-135.0, Ccw), (-45.0, Cw), (135.0, Cw)]),
            ("quad-plus", &[(90.0, Ccw), (-90.0, Ccw), (0.0, Cw), (180.0, Cw)]),
            (
                "hexa-x",
                &[
                    (90.0, Cw),
                    (-90.0, Ccw),
                    (-30.0, Cw),
                    (150.0, Ccw),
                    (30.0, Ccw),
                    (-150.0, Cw),
                ],
            ),
            (
                "hexa-plus",
                &[
                    (0.0, Cw),
                    (180.0, Ccw),
                    (-120.0, Cw),
                    (60.0, Ccw),
                    (-60.0, Ccw),
                    (120.0, Cw),
                ],
            ),
            (
                "octo-x",
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
            (
                "octo-plus",
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
            (
                "octo-cw-x",
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
            (
                "octaquad-x",
                &[
                    (45.0, Ccw),
                    (-45.0, Cw),
                    (-135.0, Ccw),
                    (135.0, Cw),
                    (-45.0, Ccw),
                    (45.0, Cw),
                    (135.0, Ccw),
                    (-135.0, Cw),
                ],
            ),
        ];
        for (name, motors) in expected {
            assert_eq!(Frame::named(name).unwrap().motors, motors, "{name}");
        }
        let flown = ENTRIES.iter().filter(|entry| matches!(entry.motors, Flown(_))).count();
        assert_eq!(flown, expected.len());
    }

    /// Logs are read with this table, flights use `config/autopilots`: the documents of PX4 have the motors of ArduPilot's.
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
        assert_eq!(compared, 12);
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
