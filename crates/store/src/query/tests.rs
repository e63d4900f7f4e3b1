//! A file as written by [`finalise`](crate::run_folder::finalise), read by the query and by hand.

use super::*;
use crate::parquet::ParquetSink;
use crate::spool::{SpoolHeader, SpoolReader, SpoolWriter};
use crate::summary::Summary;
use crate::synthetic;

/// Rows: two row groups.
const ROWS: u64 = 70_000;

/// A telemetry file of `rows` synthetic rows, and all its values.
fn file(folder: &Path, rows: u64) -> (PathBuf, Vec<Vec<f64>>) {
    let header = SpoolHeader {
        rotor_count: 6,
        step_ns: synthetic::STEP_NS,
        ..SpoolHeader::default()
    };
    let spool_path = folder.join("spool");
    let mut writer = SpoolWriter::create(&spool_path, &header).unwrap();
    for step in 0..rows {
        writer.push(&synthetic::row(step)).unwrap();
    }
    writer.finish().unwrap();
    let mut spool = SpoolReader::open(&spool_path).unwrap();
    let path = folder.join("telemetry.parquet");
    let columns = spool.columns().to_vec();
    let mut sink = ParquetSink::new(
        File::create(&path).unwrap(),
        &path,
        &header,
        &columns,
        &Summary::default(),
    )
    .unwrap();
    let mut all = vec![Vec::new(); columns.len()];
    spool
        .for_each_chunk(|chunk| {
            for (all, some) in all.iter_mut().zip(&chunk.columns) {
                all.extend_from_slice(some);
            }
            sink.push(chunk)
        })
        .unwrap();
    sink.finish().unwrap();
    (path, all)
}

fn values<'a>(file: &TelemetryFile, all: &'a [Vec<f64>], name: &str) -> &'a [f64] {
    &all[file.channels().iter().position(|channel| channel.name == name).unwrap()]
}

#[test]
fn val_answers_are_the_values_that_were_written() {
    let folder = tempfile::tempdir().unwrap();
    let (path, all) = file(folder.path(), ROWS);
    let file = TelemetryFile::open(&path).unwrap();
    assert_eq!(file.rows(), ROWS);
    let duty = file.channels().iter().find(|channel| channel.name == "duty_1").unwrap();
    assert_eq!((duty.kind, duty.unit.as_str()), (ChannelKind::F32, "1"));

    // An interval across the row group boundary, every row.
    let query = Query {
        from_s: Some(163.0),
        to_s: Some(164.5),
        points: 1000,
        ..Query::of(["roll_rad", "duty_1", "faulty_rotors"])
    };
    let table = file.query(&query).unwrap();
    let (first, last) = (65_200, 65_800);
    assert_eq!((table.source_rows, table.decimated), (601, false));
    for column in &table.columns {
        let written = &values(&file, &all, &column.channel.name)[first..=last];
        assert!(
            column
                .values
                .iter()
                .zip(written)
                .all(|(a, b)| a.to_bits() == b.to_bits()),
            "{}",
            column.channel.name
        );
    }

    // The whole run, decimated: the extremes of each channel are there.
    let all_channels = Query {
        points: 501,
        ..Query::of(["*"])
    };
    let table = file.query(&all_channels).unwrap();
    assert_eq!((table.rows(), table.decimated), (500, true));
    assert_eq!(table.columns.len(), file.channels().len());
    assert_eq!(file.query(&Query::of(["duty_*", "duty_2"])).unwrap().columns.len(), 7);
    for column in &table.columns {
        let written = values(&file, &all, &column.channel.name);
        let ends = |values: &[f64]| {
            let values = values.iter().copied();
            (values.clone().fold(f64::NAN, f64::min), values.fold(f64::NAN, f64::max))
        };
        if !decimate::MASKS.contains(&column.channel.name.as_str()) {
            assert_eq!(ends(&column.values), ends(written), "{}", column.channel.name);
        }
    }
}

#[test]
fn val_blocks_give_every_row_once() {
    let folder = tempfile::tempdir().unwrap();
    let (path, all) = file(folder.path(), ROWS);
    let file = TelemetryFile::open(&path).unwrap();
    let mut seen = [Vec::new(), Vec::new()];
    file.for_each_block(&["yaw_rad", "step"], |block| {
        for (seen, some) in seen.iter_mut().zip(block) {
            seen.extend_from_slice(some);
        }
        Ok::<(), QueryError>(())
    })
    .unwrap();
    assert!(seen[0] == values(&file, &all, "yaw_rad") && seen[1] == values(&file, &all, "step"));
}

#[test]
fn val_what_cannot_be_answered_is_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = file(folder.path(), 100);
    let file = TelemetryFile::open(&path).unwrap();
    let refusal = |query: Query| file.query(&query).unwrap_err().to_string();
    let unknown = refusal(Query::of(["rol_rad"]));
    assert!(
        unknown.contains("'rol_rad'") && unknown.contains("'roll_rad'"),
        "{unknown}"
    );
    assert!(refusal(Query::of(["xyzzyxyzzyxyzzy"])).ends_with("'xyzzyxyzzyxyzzy'"));
    assert!(refusal(Query::of(["nothing_*_like_this"])).contains("nothing_*_like_this"));
    let query = Query::of(["roll_rad"]);
    assert!(
        refusal(Query {
            points: 1,
            ..query.clone()
        })
        .contains("at least 2")
    );
    let backwards = Query {
        from_s: Some(2.0),
        to_s: Some(1.0),
        ..query.clone()
    };
    assert!(refusal(backwards).contains("from_s ≤ to_s"));
    let after = Query {
        from_s: Some(1e6),
        ..query
    };
    assert_eq!(file.query(&after).unwrap().rows(), 0);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(matches!(TelemetryFile::open(&path), Err(QueryError::Damaged { .. })));
}

#[test]
fn val_a_question_without_bound_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = file(folder.path(), 30_000);
    let file = TelemetryFile::open(&path).unwrap();
    let query = Query {
        points: usize::MAX,
        ..Query::of(["*"])
    };
    assert!(matches!(file.query(&query), Err(QueryError::TooMany { .. })));
}

#[test]
fn val_formats_say_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = file(folder.path(), 1000);
    let file = TelemetryFile::open(&path).unwrap();
    let query = Query {
        points: 100,
        ..Query::of(["roll_rad", "verdict_t_test", "true_state_of_charge", "accel_x_m_s2"])
    };
    let table = render::RunTable {
        run: "one".to_owned(),
        table: file.query(&query).unwrap(),
    };
    let columns = &table.table.columns;

    let json: serde_json::Value = serde_json::from_slice(&render::one(&table, Format::Json).unwrap()).unwrap();
    let csv = String::from_utf8(render::one(&table, Format::Csv).unwrap()).unwrap();
    let mut lines = csv.lines();
    assert_eq!(
        lines.next(),
        Some("time_s,roll_rad,verdict_t_test,true_state_of_charge,accel_x_m_s2")
    );
    for (row, line) in lines.enumerate() {
        for (column, cell) in columns.iter().zip(line.split(',')) {
            let value = column.values[row];
            let same = |other: f64| match column.channel.kind {
                ChannelKind::F32 => other as f32 == value as f32,
                _ => other == value,
            };
            let in_json = &json["data"][&column.channel.name][row];
            if value.is_nan() {
                assert!(cell.is_empty() && in_json.is_null());
            } else {
                assert!(same(cell.parse().unwrap()) && same(in_json.as_f64().unwrap()), "{line}");
            }
        }
    }

    let again = folder.path().join("again.parquet");
    std::fs::write(
        &again,
        render::several(&[table.clone(), table.clone()], Format::Parquet).unwrap(),
    )
    .unwrap();
    let again = TelemetryFile::open(&again).unwrap();
    assert_eq!((again.rows(), again.channels()[0].name.as_str()), (200, "run"));
    assert_eq!(again.channels()[0].kind, ChannelKind::Text);
    assert_eq!(again.channels()[2], columns[1].channel);
    let mut seen = Vec::new();
    again
        .for_each_block(&["roll_rad"], |block| {
            seen.extend_from_slice(&block[0]);
            Ok::<(), QueryError>(())
        })
        .unwrap();
    assert_eq!(seen[..100], columns[1].values);
    assert_eq!(seen[100..], columns[1].values);
    assert!(matches!(
        again.query(&Query::of(["run"])),
        Err(QueryError::NotNumbers { .. })
    ));
}
