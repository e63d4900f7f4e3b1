//! Recordings of ROS 2: choices, other clocks, damage, and what is rejected. The reference recording is made by
//! `data/make_ros2.py`.

use rotortwin_twin::log::{FlightLog, ReadOptions, SourceKind};
use std::path::{Path, PathBuf};

fn recording() -> Vec<u8> {
    std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/ros2.mcap")).expect("it is in the repository")
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

fn stored(folder: &tempfile::TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("it can be written");
    path
}

fn refusal(name: &str, bytes: &[u8]) -> String {
    let folder = folder();
    FlightLog::read(&stored(&folder, name, bytes))
        .expect_err(name)
        .to_string()
}

/// A record of MCAP.
fn record(opcode: u8, content: &[u8]) -> Vec<u8> {
    let mut out = vec![opcode];
    out.extend((content.len() as u64).to_le_bytes());
    out.extend(content);
    out
}

fn text(text: &str) -> Vec<u8> {
    let mut out = u32::try_from(text.len()).expect("short").to_le_bytes().to_vec();
    out.extend(text.as_bytes());
    out
}

const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// A recording without chunks: (topic, type, encoding, definition), then messages (topic, ns, bytes).
fn made(topics: &[(&str, &str, &str, &str)], messages: &[(u16, u64, Vec<u8>)]) -> Vec<u8> {
    let mut out = MAGIC.to_vec();
    for (id, (topic, kind, encoding, definition)) in (1_u16..).zip(topics) {
        let described = if *encoding == "cdr" { "ros2msg" } else { encoding };
        let schema = [id.to_le_bytes().to_vec(), text(kind), text(described), text(definition)].concat();
        out.extend(record(3, &schema));
        let none = 0_u32.to_le_bytes().to_vec();
        let channel = [
            id.to_le_bytes().to_vec(),
            id.to_le_bytes().to_vec(),
            text(topic),
            text(encoding),
            none,
        ]
        .concat();
        out.extend(record(4, &channel));
    }
    for (topic, recorded_ns, content) in messages {
        let head = [
            &topic.to_le_bytes()[..],
            &[0; 4],
            &recorded_ns.to_le_bytes(),
            &recorded_ns.to_le_bytes(),
        ]
        .concat();
        out.extend(record(5, &[head, content.clone()].concat()));
    }
    out.extend(record(15, &[0; 4]));
    out.extend(MAGIC);
    out
}

/// `timestamp` and three numbers, little endian, as the message below has them.
fn rates(micros: u64, values: [f32; 3]) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    out.extend(micros.to_le_bytes());
    values.iter().for_each(|value| out.extend(value.to_le_bytes()));
    out
}

const RATES: &str = "uint64 timestamp # us since start\nfloat32[3] xyz\n";
const BATTERY: &str = "std_msgs/Header header\nfloat32 voltage\nfloat32 current\n================================================================================\nMSG: \
    std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";

fn battery(time_ns: u64, voltage: f32, current: f32) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    out.extend(
        u32::try_from(time_ns / 1_000_000_000)
            .expect("before 2106")
            .to_le_bytes(),
    );
    out.extend(((time_ns % 1_000_000_000) as u32).to_le_bytes());
    out.extend([1, 0, 0, 0, 0, 0, 0, 0]);
    out.extend(voltage.to_le_bytes());
    out.extend(current.to_le_bytes());
    out
}

#[test]
fn val_a_clock_since_the_start_of_the_autopilot_is_put_onto_that_of_the_recorder() {
    const START_NS: u64 = 1_700_000_000_000_000_000;
    let mut messages = Vec::new();
    for k in 0..100_u64 {
        // Recorded 3 to 5 ms after it was measured, 61 s after the start of the autopilot.
        let measured_ns = START_NS + 10_000_000 * k;
        let late = 3_000_000 + 1_000_000 * (k % 3);
        let angle = 0.1 * k as f32;
        messages.push((
            1,
            measured_ns + late,
            rates(61_000_000 + 10_000 * k, [angle.sin(), angle.cos(), 0.5]),
        ));
        messages.push((
            2,
            measured_ns + 1_000_000,
            battery(measured_ns, 16.0 - 0.01 * k as f32, -9.0),
        ));
    }
    let topics = [
        (
            "/fmu/out/vehicle_angular_velocity",
            "px4_msgs/msg/VehicleAngularVelocity",
            "cdr",
            RATES,
        ),
        ("/battery", "sensor_msgs/msg/BatteryState", "cdr", BATTERY),
    ];
    let folder = folder();
    let log = FlightLog::read(&stored(&folder, "a.mcap", &made(&topics, &messages))).expect("a log");
    let notes = log.report.notes.join("\n");
    assert!(notes.contains("stamps of 2 clocks"), "{notes}");
    assert_eq!(log.time_s.len(), 100);
    assert!((log.time_s[99] - 0.99).abs() < 1e-6);
    // Rows at 3 ms after the measurement, the battery's less its least delay of 1 ms: 2 ms apart.
    let voltage = log.column("battery_voltage_v").expect("it is there");
    let current = log.column("battery_current_a").expect("it is there");
    assert!((voltage[50] - (15.5 - 0.002)).abs() < 1e-4, "{}", voltage[50]);
    assert!((current[50] - 9.0).abs() < 1e-6, "discharge > 0");
    assert!((log.column("roll_rate_rad_s").expect("it is there")[3] - 0.3_f64.sin()).abs() < 1e-6);
}

#[test]
fn val_a_twist_of_the_world_is_told_by_how_the_position_moves() {
    const POSE: &str = "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance \
        twist\n================================================================================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time \
        stamp\nstring frame_id\n================================================================================\nMSG: \
        geometry_msgs/PoseWithCovariance\nPose pose\nfloat64[36] covariance\n================================================================================\nMSG: \
        geometry_msgs/TwistWithCovariance\nTwist twist\nfloat64[36] covariance\n================================================================================\nMSG: \
        geometry_msgs/Pose\nPoint position\nQuaternion orientation\n================================================================================\nMSG: \
        geometry_msgs/Twist\nVector3 linear\nVector3 angular\n================================================================================\nMSG: \
        geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n================================================================================\nMSG: \
        geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n================================================================================\nMSG: \
        geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";
    let message = |k: u64, world: bool| {
        let t = 0.02 * k as f64;
        let mut out = vec![0, 1, 0, 0];
        out.extend((1_700_000_000 + k as u32 / 50).to_le_bytes());
        out.extend((20_000_000 * (k as u32 % 50)).to_le_bytes());
        // frame_id "odom", child_frame_id "base", then doubles at a multiple of eight.
        out.extend([5, 0, 0, 0, b'o', b'd', b'o', b'm', 0, 0, 0, 0]);
        out.extend([5, 0, 0, 0, b'b', b'a', b's', b'e', 0, 0, 0, 0]);
        // East 2 sin t, heading 60° to the left of east.
        let half = 30.0_f64.to_radians();
        let velocity = [2.0 * t.cos(), 0.0, 0.0];
        let (s, c) = 60.0_f64.to_radians().sin_cos();
        let body = [c * velocity[0], -s * velocity[0], 0.0];
        let pose = [2.0 * t.sin(), 0.0, 1.0, 0.0, 0.0, half.sin(), half.cos()];
        let covariance = [0.0; 36];
        let twist = if world { velocity } else { body };
        for value in pose
            .iter()
            .chain(&covariance)
            .chain(&twist)
            .chain(&[0.0, 0.0, 0.1])
            .chain(&covariance)
        {
            out.extend(value.to_le_bytes());
        }
        out
    };
    for world in [false, true] {
        let messages: Vec<(u16, u64, Vec<u8>)> = (0..200)
            .map(|k| (1, 1_700_000_000_000_000_000 + 20_000_000 * k, message(k, world)))
            .collect();
        let folder = folder();
        let file = made(&[("/odom", "nav_msgs/msg/Odometry", "cdr", POSE)], &messages);
        let log = FlightLog::read(&stored(&folder, "a.mcap", &file)).expect("a log");
        let east = log.column("velocity_east_m_s").expect("it is there");
        let north = log.column("velocity_north_m_s").expect("it is there");
        let said = log
            .report
            .notes
            .iter()
            .any(|note| note.contains("as if it were in the world's"));
        assert_eq!(said, world, "{:?}", log.report.notes);
        assert!(
            (east[10] - 2.0 * 0.2_f64.cos()).abs() < 1e-9 && north[10].abs() < 1e-9,
            "{}",
            east[10]
        );
    }
}

#[test]
fn regress_what_is_no_recording_of_ros_2_is_refused_with_what_helps() {
    let said = refusal("a.bag", b"#ROSBAG V2.0\n\x45\0\0\0");
    assert!(said.contains("ROS 1") && said.contains("rosbags-convert"), "{said}");
    let said = refusal("a.db3", b"SQLite format 3\0\x10\0\x01\x01");
    assert!(said.contains("its header alone has 100"), "{said}");
    let said = refusal("a.mcap.zstd", &[0x28, 0xb5, 0x2f, 0xfd, 0, 0]);
    assert!(said.contains("zstd -d"), "{said}");
    let message = |encoding: &'static str| {
        let topics = [("/odom", "nav_msgs/Odometry", encoding, "")];
        refusal("a.mcap", &made(&topics, &[(1, 1, vec![0; 8])]))
    };
    assert!(
        message("ros1").contains("encoded as 'ros1', which ROS 1 has"),
        "{}",
        message("ros1")
    );
    assert!(
        message("protobuf").contains("encoded as 'protobuf'; 'cdr'"),
        "{}",
        message("protobuf")
    );
    assert!(message("json").contains("encoded as 'json'"), "{}", message("json"));
    // A definition that the messages do not fit: topic, message, byte, what was expected.
    let topics = [("/a", "px4_msgs/msg/VehicleAngularVelocity", "cdr", RATES)];
    let said = refusal("a.mcap", &made(&topics, &[(1, 1, vec![0, 1, 0, 0, 9, 9])]));
    assert!(
        said.contains("/a:") && said.contains("message 1 (byte") && said.contains("ends within timestamp"),
        "{said}"
    );
    assert!(refusal("a.mcap", &made(&[], &[])).contains("no message in it"));
    assert!(refusal("a.mcap", MAGIC).contains("no message in it"));
    // A folder of a recording in two files.
    let folder = folder();
    for name in ["metadata.yaml", "a_0.mcap", "a_1.mcap"] {
        stored(&folder, name, b"x");
    }
    let said = FlightLog::read(folder.path()).expect_err("two files").to_string();
    assert!(said.contains("in 2 files"), "{said}");
}

#[test]
fn val_a_mapping_chooses_the_vehicle_and_a_folder_is_its_recording() {
    let folder = folder();
    stored(&folder, "metadata.yaml", b"rosbag2_bagfile_information:\n");
    stored(&folder, "flight_0.mcap", &recording());
    let mapping = stored(&folder, "mine.toml", b"source = \"ros2\"\ntopics = [\"/drone2/\"]\n");
    let options = ReadOptions {
        mapping: Some(mapping),
        ..ReadOptions::default()
    };
    let log = FlightLog::read_with(folder.path(), &options).expect("a log");
    assert!(
        log.column("position_east_m")
            .expect("it is there")
            .iter()
            .all(|value| (*value - 9.0).abs() < 1e-9)
    );
    assert!(log.column("accel_z_m_s2").is_none(), "nothing of the other vehicle");
}

#[test]
fn val_a_stored_import_keeps_what_its_columns_do_not_tell() {
    let folder = folder();
    let log = FlightLog::read(&stored(&folder, "a.mcap", &recording())).expect("a log");
    let path = log.store(&folder.path().join("logs"), "a").expect("it can be written");
    let again = FlightLog::read(&path).expect("a log");
    assert_eq!(again.source.kind, SourceKind::Ros2Bag);
    assert!(again.source.kind.is_of_an_estimator());
    assert_eq!(again.report.streams, log.report.streams);
    assert_eq!(again.report.clock_start_s, log.report.clock_start_s);
    assert_eq!(again.time_s, log.time_s);
    let ulog = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/px4-on-the-ground.ulg");
    let log = FlightLog::read(&ulog).expect("a log");
    let path = log.store(&folder.path().join("logs"), "b").expect("it can be written");
    let again = FlightLog::read(&path).expect("a log");
    assert_eq!(
        (again.source.kind, &again.parameters),
        (SourceKind::Px4Ulog, &log.parameters)
    );
    assert!(!again.parameters.is_empty());
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

#[test]
fn val_a_recording_in_sqlite_is_the_same_flight_as_in_mcap() {
    let log = FlightLog::read(&data("ros2.db3")).expect("a log");
    let same = FlightLog::read(&data("ros2.mcap")).expect("a log");
    assert_eq!(log.source.kind, SourceKind::Ros2Bag);
    assert!(log.time_s.len() > 100 && log.columns.len() > 15);
    assert_eq!(log.time_s, same.time_s);
    assert_eq!(
        log.columns.keys().collect::<Vec<_>>(),
        same.columns.keys().collect::<Vec<_>>()
    );
    for (name, values) in &log.columns {
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(values), bits(&same.columns[name]), "{name}");
    }
    assert_eq!(log.report.notes, same.report.notes);
}

#[test]
fn val_a_recording_without_definitions_is_read_by_those_of_ros_2() {
    let log = FlightLog::read(&data("ros2-humble.db3")).expect("a log");
    let whole = FlightLog::read(&data("ros2.mcap")).expect("a log");
    assert!(log.time_s.len() >= 35 && log.time_s.len() <= 40, "{}", log.time_s.len());
    for name in [
        "roll_rad",
        "velocity_east_m_s",
        "accel_z_m_s2",
        "pitch_rate_rad_s",
        "battery_voltage_v",
        "battery_current_a",
    ] {
        let (own, other) = (log.column(name).expect(name), whole.column(name).expect(name));
        assert_eq!(own[..35], other[..35], "{name}");
    }
    // Rotor outputs are recognised by how they move, and these few rows are not a flight.
    assert!(log.column("duty_1").is_some());
    let notes = log.report.notes.join("\n");
    assert!(
        notes.contains("the recording holds no definitions") && notes.contains("sensor_msgs/BatteryState"),
        "{notes}"
    );
}

#[test]
fn prop_cut_and_damaged_databases_break_nothing() {
    let whole = std::fs::read(data("ros2-humble.db3")).expect("it is in the repository");
    let folder = folder();
    let read = |bytes: &[u8]| FlightLog::read(&stored(&folder, "a.db3", bytes));
    let (mut less, mut refused) = (0, 0);
    for end in (0..whole.len()).step_by(1_021) {
        match read(&whole[..end]) {
            Ok(log) => {
                let said = log.report.notes.iter().any(|note| note.contains("are cut or damaged"));
                assert!(said, "{end}: {:?}", log.report.notes);
                less += 1;
            }
            Err(error) => {
                assert!(!error.to_string().is_empty());
                refused += 1;
            }
        }
    }
    assert!(less > 10 && refused > 2, "{less} read, {refused} refused");
    for at in (16..whole.len()).step_by(499) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x55;
        drop(read(&damaged));
    }
    // A table whose root is the page that says so.
    let said = refusal("a.db3", &[b"SQLite format 3\0".as_slice(), &[0; 200]].concat());
    assert!(said.contains("pages of 0 bytes"), "{said}");
    let other = stored(&folder, "other.db3", &whole);
    let mut bytes = std::fs::read(&other).expect("written");
    // No such tables: their names in the table of tables are others.
    while let Some(at) = bytes.windows(6).position(|window| window == b"topics") {
        bytes[at..at + 6].copy_from_slice(b"copies");
    }
    let said = refusal("a.db3", &bytes);
    assert!(
        said.contains("'topics' and 'messages'") && said.contains("copies"),
        "{said}"
    );
}

#[test]
fn prop_cut_and_damaged_recordings_break_nothing() {
    let whole = recording();
    let folder = folder();
    let read = |bytes: &[u8]| FlightLog::read(&stored(&folder, "a.mcap", bytes));
    for end in (0..whole.len()).step_by(1_499) {
        drop(read(&whole[..end]));
    }
    let cut = read(&made_of_small_messages()[..20_000]).expect("what stands before the cut");
    assert!(
        cut.report.notes.iter().any(|note| note.contains("the file ends early")),
        "{:?}",
        cut.report.notes
    );
    assert!(cut.time_s.len() > 100);
    for at in (8..whole.len()).step_by(997) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x55;
        drop(read(&damaged));
    }
    // A chunk whose content does not fit its checksum is left out.
    let mut damaged = whole.clone();
    damaged[whole.len() / 3] ^= 0x55;
    match read(&damaged) {
        Ok(log) => assert!(log.report.notes.iter().any(|note| note.contains("damaged chunk"))),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn made_of_small_messages() -> Vec<u8> {
    let messages: Vec<(u16, u64, Vec<u8>)> = (0..1000_u64)
        .map(|k| {
            (
                1,
                1_000_000_000 + 5_000_000 * k,
                rates(1 + 5_000 * k, [(0.01 * k as f32).sin(), 0.1, 0.2]),
            )
        })
        .collect();
    made(
        &[("/a", "px4_msgs/msg/VehicleAngularVelocity", "cdr", RATES)],
        &messages,
    )
}

#[test]
fn regress_a_chunk_that_wants_all_memory_is_refused() {
    // Says that ten bytes become 2^60.
    let mut chunk = vec![0; 16];
    chunk.extend((1_u64 << 60).to_le_bytes());
    chunk.extend([1, 2, 3, 4]);
    chunk.extend(text("zstd"));
    chunk.extend(10_u64.to_le_bytes());
    chunk.extend([7; 10]);
    let mut file = MAGIC.to_vec();
    file.extend(record(6, &chunk));
    let said = refusal("a.mcap", &file);
    assert!(said.contains("no message in it"), "{said}");
    let mut lz4 = vec![0; 28];
    lz4.extend(text("lz4"));
    lz4.extend(0_u64.to_le_bytes());
    let mut file = MAGIC.to_vec();
    file.extend(record(6, &lz4));
    let said = refusal("a.mcap", &file);
    assert!(
        said.contains("compressed with 'lz4'") && said.contains("zstd"),
        "{said}"
    );
}
