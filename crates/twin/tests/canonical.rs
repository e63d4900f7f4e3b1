//! Canonical CSV and Parquet: read, written, refused.

use proptest::prelude::*;
use rotortwin_twin::log::{FlightLog, ReadOptions, SourceKind};
use std::path::PathBuf;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder can be made"))
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, text).expect("the file can be written");
        path
    }
}

fn refusal(text: &str) -> String {
    let folder = Folder::new();
    let path = folder.write("flight.csv", text);
    let sentence = FlightLog::read(&path).expect_err(text).to_string();
    assert!(sentence.contains("flight.csv: "), "{sentence}");
    assert!(!sentence.contains('\n'), "{sentence}");
    sentence.split_once("flight.csv: ").expect("checked").1.to_owned()
}

#[test]
fn val_each_refusal_of_the_format_names_row_and_column() {
    let cases = [
        ("", "the file is empty"),
        ("time_s\n0\n", "1 rows; a log has at least two"),
        (
            "time_s,roll_rad\n0,0\n0,0\n",
            "row 2, column time_s: the previous row has 0 s",
        ),
        (
            "time_s,roll_rad\n0,0\n1,0\n0.5,0\n",
            "row 3, column time_s: 0.5 s after 1 s",
        ),
        ("time_s,roll_rad\n0,0\n,0\n", "row 2, column time_s: empty"),
        (
            "time_s,roll_rad\n0,0\n1,abc\n",
            "row 2, column roll_rad: 'abc' is not a number",
        ),
        (
            "time_s,roll_rad\n0,0\n1,NaN\n",
            "row 2, column roll_rad: 'NaN' is not a finite number",
        ),
        (
            "time_s,roll_rad\n0,-inf\n1,0\n",
            "row 1, column roll_rad: '-inf' is not a finite number",
        ),
        (
            "time_s,duty_1\n0,0.5\n1,1.2\n",
            "row 2, column duty_1: 1.2 is not a duty",
        ),
        (
            "time_s,duty_1\n0,-0.1\n1,0.2\n",
            "row 1, column duty_1: -0.1 is not a duty",
        ),
        (
            "time_s,duty_1,duty_3\n0,0,0\n1,0,0\n",
            "column duty_2: missing, but duty_3 is there",
        ),
        (
            "time_s,accel_z_m_s2\n0,-1.0\n1,-1.01\n",
            "column accel_z_m_s2: the median of accel_z_m_s2 is 1.010",
        ),
        (
            "time_s,pitch_rad\n0,0\n1,12\n",
            "row 2, column pitch_rad: 12 cannot be a pitch in radians",
        ),
        (
            "time_s,quat_w,quat_x,quat_y,quat_z\n0,1,0,0,0\n1,0.5,0,0,0\n",
            "row 2, column quat_w: the quaternion has length 0.5",
        ),
        ("time_s,roll_rad\n0,0\n1\n", "row 2 has 1 cells; the header has 2"),
        ("time_s,a,a\n0,0,0\n1,0,0\n", "column a: duplicate column name"),
        (
            "time_s;roll_rad\n0;0\n1;0\n",
            "the cells of the header are separated by ';'",
        ),
        ("0,0\n1,0\n", "the first line holds numbers"),
        (
            "t,roll_rad\n0,0\n1,0\n",
            "column time_s is missing (found: roll_rad, t)",
        ),
    ];
    for (text, expected) in cases {
        let sentence = refusal(text);
        assert!(sentence.starts_with(expected), "{text:?}: {sentence}");
    }
}

#[test]
fn val_unknown_and_text_columns_are_never_an_error() {
    let folder = Folder::new();
    let path = folder.write(
        "a.csv",
        "\u{feff}time_s,mode,\"esc, temp\"\r\n0,HOLD,40\r\n0.5,HOLD,nan\r\n",
    );
    let log = FlightLog::read(&path).expect("accepted");
    assert_eq!(log.time_s, [0.0, 0.5]);
    assert_eq!(log.report.unused_columns[0].column, "mode");
    assert_eq!(log.report.unknown_columns, ["esc, temp"]);
    assert_eq!(log.report.notes.len(), 1, "{:?}", log.report.notes);
}

#[test]
fn val_quaternion_becomes_euler_angles() {
    // 90° about z, then nothing: yaw π/2. Hand: q = (cos 45°, 0, 0, sin 45°).
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let folder = Folder::new();
    let text = format!("time_s,quat_w,quat_x,quat_y,quat_z\n0,{half},0,0,{half}\n1,1,0,0,0\n");
    let log = FlightLog::read(&folder.write("a.csv", &text)).expect("accepted");
    let yaw = log.column("yaw_rad").expect("from the quaternion");
    assert!((yaw[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-12 && yaw[1] == 0.0);
}

#[test]
fn val_side_file_names_vehicle_and_segments() {
    let folder = Folder::new();
    let path = folder.write("a.csv", "time_s,roll_rad\n0,0\n1,0\n");
    folder.write(
        "a.toml",
        "vehicle = \"f550.toml\"\nlicence = \"MIT\"\n[[segment]]\nname = \"hover\"\nstart_s = 0.0\nend_s = 0.5\n",
    );
    let log = FlightLog::read(&path).expect("accepted");
    assert_eq!(log.vehicle.as_deref(), Some("f550.toml"));
    assert_eq!(log.segments[0].name, "hover");
    folder.write("a.toml", "vehicel = 1\n");
    let sentence = FlightLog::read(&path).expect_err("a misspelt key").to_string();
    assert!(
        sentence.contains("a.toml: line 1: unknown field `vehicel`"),
        "{sentence}"
    );
}

#[test]
fn regress_a_vehicle_file_that_is_called_like_a_log_is_no_side_file() {
    let folder = Folder::new();
    let path = folder.write("a.csv", "time_s,roll_rad\n0,0\n1,0\n");
    folder.write("a.toml", "name = \"a\"\n[body]\nmass_kg = 1.0\n");
    let log = FlightLog::read(&path).expect("accepted");
    assert_eq!((log.vehicle, log.segments.len()), (None, 0));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn prop_csv_and_parquet_keep_every_bit(
        cells in proptest::collection::vec((proptest::num::f64::NORMAL, proptest::option::of(proptest::num::f64::NORMAL)), 2..40),
    ) {
        let time_s: Vec<f64> = (0..cells.len()).map(|row| row as f64 * 0.0025).collect();
        let north = cells.iter().map(|cell| cell.0).collect();
        let other = cells.iter().map(|cell| cell.1.unwrap_or(f64::NAN)).collect();
        let columns = [("position_north_m".to_owned(), north), ("other".to_owned(), other)];
        let log = FlightLog::from_columns("memory", time_s, columns).expect("finite cells");
        let folder = Folder::new();
        let bits = |log: &FlightLog| -> Vec<Vec<u64>> {
            let of = |values: &[f64]| values.iter().map(|value| if value.is_nan() { 0 } else { value.to_bits() }).collect();
            std::iter::once(of(&log.time_s)).chain(log.columns.values().map(|values| of(values))).collect()
        };
        for (name, kind) in [("a.csv", SourceKind::Csv), ("a.parquet", SourceKind::Parquet)] {
            let path = folder.0.path().join(name);
            if kind == SourceKind::Csv { log.write_csv(&path) } else { log.write_parquet(&path) }.expect("can be written");
            let read = FlightLog::read(&path).expect("what was written can be read");
            prop_assert_eq!(read.source.kind, kind);
            // A column of empty cells only is kept as well.
            prop_assert_eq!(bits(&read), bits(&log));
        }
    }
}

fn remapped(text: &str, rows: &str) -> Result<FlightLog, String> {
    let folder = Folder::new();
    let mapping = folder.write("mapping.toml", &format!("source = \"canonical\"\n{rows}"));
    let options = ReadOptions {
        mapping: Some(mapping),
        ..ReadOptions::default()
    };
    FlightLog::read_with(&folder.write("flight.csv", text), &options).map_err(|error| error.to_string())
}

#[test]
fn val_a_mapping_exchanges_and_scales_columns_of_a_canonical_file() {
    let text = "time_s,roll_rate_rad_s,pitch_rate_rad_s,yaw_rate_rad_s,duty_1,duty_2,note\n0,1,2,3,10,20,7\n2000,4,5,6,30,40,8\n";
    let log = remapped(
        text,
        "[[column]]\nto = \"time_s\"\nfrom = \"file:time_s\"\nfactor = 0.001\n\
         [[column]]\nto = \"roll_rate_rad_s\"\nfrom = \"file:pitch_rate_rad_s\"\nunit = \"rad/s\"\n\
         [[column]]\nto = \"pitch_rate_rad_s\"\nfrom = \"file:roll_rate_rad_s\"\nunit = \"rad/s\"\nfactor = -1.0\n\
         [[column]]\nto = \"yaw_rate_rad_s\"\nfrom = \"file:yaw_rate_rad_s\"\nunit = \"deg/s\"\n\
         [[column]]\nto = \"duty\"\nfrom = \"file:duty_2,duty_1\"\nunit = \"percent\"\n",
    )
    .expect("accepted");
    assert_eq!(log.time_s, [0.0, 2.0]);
    assert_eq!(log.column("roll_rate_rad_s"), Some(&[2.0, 5.0][..]));
    assert_eq!(log.column("pitch_rate_rad_s"), Some(&[-1.0, -4.0][..]));
    let degree = std::f64::consts::PI / 180.0;
    assert_eq!(log.column("yaw_rate_rad_s"), Some(&[3.0 * degree, 6.0 * degree][..]));
    assert_eq!(log.column("duty_1"), Some(&[0.2, 0.4][..]));
    assert_eq!(log.column("duty_2"), Some(&[0.1, 0.3][..]));
    assert_eq!(log.column("note"), Some(&[7.0, 8.0][..]), "what no row writes stays");
    assert_eq!(log.report.conversions.len(), 5, "{:?}", log.report.conversions);
}

#[test]
fn val_a_mapping_that_does_not_fit_a_canonical_file_is_refused() {
    let text = "time_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\n0,0,0,-1\n1,NaN,0,-1\n";
    let row = |to: &str, from: &str, more: &str| format!("[[column]]\nto = \"{to}\"\nfrom = \"{from}\"\n{more}");
    let all = "file:accel_x_m_s2,accel_y_m_s2,accel_z_m_s2";
    for (rows, expected) in [
        (row("accel", all, "unit = \"g\"\n"), "row 2, column accel_x_m_s2: 'NaN'"),
        (
            row("accel", "file:accel_x_m_s2", "unit = \"g\"\n"),
            "'accel' is 3 columns, from names 1",
        ),
        (
            row("duty", "file:pwm_1", ""),
            "from names pwm_1, a column that the file does not have",
        ),
        (
            row("accel", "imu:x,y,z", "unit = \"g\"\n"),
            "expected \"file:column,column\"",
        ),
        (
            row("duty", "file:accel_x_m_s2", "order = [1]\n"),
            "low, high, order and valid are for",
        ),
        (
            row("duty", "file:accel_x_m_s2,accel_y_m_s2,accel_x_m_s2", ""),
            "names accel_x_m_s2 in places 1 and 3; expected another field for each rotor",
        ),
    ] {
        let sentence = remapped(text, &rows).expect_err(&rows);
        assert!(sentence.contains(expected), "{sentence}");
    }
    let folder = Folder::new();
    let options = ReadOptions {
        mapping: Some(folder.write("mapping.toml", "source = \"px4-ulog\"\n")),
        ..ReadOptions::default()
    };
    let refused = FlightLog::read_with(&folder.write("flight.csv", text), &options).expect_err("another source");
    assert!(
        refused.to_string().contains("expected source = \"canonical\""),
        "{refused}"
    );
}

/// An empty accelerometer must not take the place of the force that follows from the velocity.
#[test]
fn regress_a_column_without_a_value_is_no_column() {
    let folder = Folder::new();
    let path = folder.write(
        "flight.csv",
        "time_s,roll_rad,accel_x_m_s2\n0,0.1,\n0.1,,\n0.2,0.1,\n0.3,0.1,\n",
    );
    let log = FlightLog::read(&path).expect("it is a log");
    assert!(log.column("accel_x_m_s2").is_none() && log.column("roll_rad").is_some());
    let unused = &log.report.unused_columns;
    assert!(unused.len() == 1 && unused[0].column == "accel_x_m_s2", "{unused:?}");
}
