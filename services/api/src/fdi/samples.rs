//! Samples received over HTTP: a JSON array, JSON lines, or CSV with the canonical columns of a flight log.
//!
//! Only syntax errors are rejected here, naming the sample; the session checks the values.

use crate::problem::Problem;
use rotortwin_fdi_session::session::LONGEST_CHUNK;
use rotortwin_fdi_session::{Chunk, Sample};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_twin::log::names;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// One sample of a flight, 2.5 ms after the one before: SI units, world NED, body FRD.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SampleBody {
    /// North, east, down, m. Not used by the detectors.
    #[serde(default)]
    #[schema(min_items = 3, max_items = 3)]
    pub(crate) position_ned_m: [f32; 3],
    /// North, east, down, m/s.
    #[schema(min_items = 3, max_items = 3)]
    pub(crate) velocity_ned_m_s: [f32; 3],
    /// Roll, pitch, yaw (ZYX), rad, body in NED.
    #[schema(min_items = 3, max_items = 3)]
    pub(crate) attitude_rad: [f32; 3],
    /// p, q, r, rad/s, forward, right, down.
    #[schema(min_items = 3, max_items = 3)]
    pub(crate) body_rates_rad_s: [f32; 3],
    /// Duty of each rotor, held from this sample to the next, fraction; rotor 1 first.
    #[schema(max_items = 16)]
    pub(crate) duty: Vec<f32>,
    /// Voltage at the battery's terminals, V.
    pub(crate) battery_voltage_v: f32,
    /// When it was taken, s, by any clock; used to detect wrong rates and gaps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) time_s: Option<f64>,
}

/// A chunk as a text message of the WebSocket.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ChunkBody {
    pub(crate) first_step: u64,
    #[serde(default)]
    pub(crate) after_gap: bool,
    pub(crate) samples: Vec<SampleBody>,
}

impl ChunkBody {
    /// # Errors
    /// A sample has a wrong number of duties.
    pub(crate) fn chunk(self, rotor_count: usize) -> Result<Chunk, String> {
        Ok(Chunk {
            first_step: self.first_step,
            after_gap: self.after_gap,
            samples: taken(self.samples, rotor_count)?,
        })
    }
}

fn taken(bodies: Vec<SampleBody>, rotor_count: usize) -> Result<Vec<Sample>, String> {
    let sample = |(index, body): (usize, SampleBody)| {
        if body.duty.len() != rotor_count {
            let (sample, found) = (index + 1, body.duty.len());
            return Err(format!(
                "sample {sample}: duty has {found} entries, expected one for each of the {rotor_count} rotors"
            ));
        }
        let mut duty = [0.0; MAX_ROTORS];
        duty[..rotor_count].copy_from_slice(&body.duty);
        Ok(Sample {
            position_ned_m: body.position_ned_m,
            velocity_ned_m_s: body.velocity_ned_m_s,
            attitude_rad: body.attitude_rad,
            body_rates_rad_s: body.body_rates_rad_s,
            duty,
            battery_voltage_v: body.battery_voltage_v,
            time_s: body.time_s,
        })
    };
    bodies.into_iter().enumerate().map(sample).collect()
}

/// Format of a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    Json,
    Lines,
    Csv,
}

impl Form {
    /// From a content type.
    ///
    /// # Errors
    /// 415.
    pub(crate) fn of(content_type: Option<&str>) -> Result<Self, Problem> {
        let kind = content_type.unwrap_or_default();
        match kind
            .split(';')
            .next()
            .unwrap_or_default()
            .trim()
            .to_ascii_lowercase()
            .as_str()
        {
            "application/json" => Ok(Self::Json),
            "application/x-ndjson" => Ok(Self::Lines),
            "text/csv" => Ok(Self::Csv),
            _ => Err(Problem::unsupported(format!(
                "Content-Type is '{kind}'; expected application/json (an array of samples), application/x-ndjson (a sample a line) or \
                 text/csv (canonical columns of a flight log)"
            ))),
        }
    }
}

/// Reads the samples of a chunk.
///
/// # Errors
/// 400: not text. 422, with the first unreadable sample.
pub(crate) fn read(form: Form, body: &[u8], rotor_count: usize) -> Result<Vec<Sample>, Problem> {
    let text = std::str::from_utf8(body)
        .map_err(|error| Problem::bad_request(format!("the chunk is not UTF-8 text: {error}")))?;
    let samples = match form {
        Form::Json => from_json(text).and_then(|bodies| taken(bodies, rotor_count)),
        Form::Lines => from_lines(text).and_then(|bodies| taken(bodies, rotor_count)),
        Form::Csv => from_csv(text, rotor_count),
    };
    samples.map_err(Problem::unprocessable)
}

fn from_json(text: &str) -> Result<Vec<SampleBody>, String> {
    serde_json::from_str(text).map_err(|error| match first_unreadable(text) {
        Some((sample, error)) => format!("sample {sample}: {error}"),
        None => format!("the chunk is not an array of samples: {error}"),
    })
}

/// Index of the first unreadable sample of an array.
fn first_unreadable(text: &str) -> Option<(usize, serde_json::Error)> {
    let values: Vec<serde_json::Value> = serde_json::from_str(text).ok()?;
    values.into_iter().enumerate().find_map(|(index, value)| {
        serde_json::from_value::<SampleBody>(value)
            .err()
            .map(|error| (index + 1, error))
    })
}

fn from_lines(text: &str) -> Result<Vec<SampleBody>, String> {
    let lines = text.lines().filter(|line| !line.trim().is_empty());
    lines
        .take(LONGEST_CHUNK + 1)
        .enumerate()
        .map(|(index, line)| serde_json::from_str(line).map_err(|error| format!("sample {}: {error}", index + 1)))
        .collect()
}

/// Column indices of a sample's fields.
struct Places {
    velocity: [usize; 3],
    attitude: [usize; 3],
    rates: [usize; 3],
    duty: Vec<usize>,
    voltage: usize,
    position: Option<[usize; 3]>,
    time: Option<usize>,
}

impl Places {
    fn of(header: &[&str], rotor_count: usize) -> Result<Self, String> {
        let find = |name: &str| header.iter().position(|column| *column == name);
        let need = |name: &str| find(name).ok_or_else(|| format!("the header has no column {name}"));
        let three = |names: [&str; 3]| -> Result<[usize; 3], String> {
            Ok([need(names[0])?, need(names[1])?, need(names[2])?])
        };
        Ok(Self {
            velocity: three(names::VELOCITY)?,
            attitude: three(names::ATTITUDE)?,
            rates: three(names::RATES)?,
            duty: (1..=rotor_count)
                .map(|rotor| need(&names::duty(rotor)))
                .collect::<Result<_, _>>()?,
            voltage: need(names::BATTERY_VOLTAGE)?,
            position: three(names::POSITION).ok(),
            time: find(names::TIME),
        })
    }
}

fn from_csv(text: &str, rotor_count: usize) -> Result<Vec<Sample>, String> {
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
    let places = Places::of(&header, rotor_count)?;
    let row = |(index, line): (usize, &str)| {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        if cells.len() != header.len() {
            let (row, found) = (index + 1, cells.len());
            return Err(format!(
                "sample {row} has {found} cells, the header has {}",
                header.len()
            ));
        }
        let refuse = |place: usize| {
            let (row, column, cell) = (index + 1, header[place], cells[place]);
            format!("sample {row}: {column} is '{cell}', expected a number")
        };
        let number = |place: usize| cells[place].parse::<f32>().map_err(|_no_number| refuse(place));
        let three = |places: [usize; 3]| -> Result<[f32; 3], String> {
            Ok([number(places[0])?, number(places[1])?, number(places[2])?])
        };
        let mut duty = [0.0; MAX_ROTORS];
        for (slot, place) in duty.iter_mut().zip(&places.duty) {
            *slot = number(*place)?;
        }
        Ok(Sample {
            position_ned_m: places.position.map_or(Ok([0.0; 3]), three)?,
            velocity_ned_m_s: three(places.velocity)?,
            attitude_rad: three(places.attitude)?,
            body_rates_rad_s: three(places.rates)?,
            duty,
            battery_voltage_v: number(places.voltage)?,
            time_s: places
                .time
                .map(|place| cells[place].parse().map_err(|_no_number| refuse(place)))
                .transpose()?,
        })
    };
    lines.take(LONGEST_CHUNK + 1).enumerate().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const JSON: &str = r#"{"velocity_ned_m_s":[1,2,3],"attitude_rad":[0.1,0.2,0.3],"body_rates_rad_s":[4,5,6],"duty":[0.25,0.5],"battery_voltage_v":15.5,"time_s":7.5}"#;
    const CSV: &str = "time_s,velocity_north_m_s,velocity_east_m_s,velocity_down_m_s,roll_rad,pitch_rad,yaw_rad,roll_rate_rad_s,\
                       pitch_rate_rad_s,yaw_rate_rad_s,duty_1,duty_2,battery_voltage_v\n7.5,1,2,3,0.1,0.2,0.3,4,5,6,0.25,0.5,15.5\n";

    #[test]
    fn val_three_forms_of_the_same_sample() {
        let array = read(Form::Json, format!("[{JSON}]").as_bytes(), 2).expect("JSON");
        assert_eq!(array.len(), 1);
        assert_eq!((array[0].duty[1], array[0].body_rates_rad_s), (0.5, [4.0, 5.0, 6.0]));
        assert_eq!(
            read(Form::Lines, format!("{JSON}\n\n").as_bytes(), 2),
            Ok(array.clone())
        );
        assert_eq!(read(Form::Csv, CSV.as_bytes(), 2), Ok(array));
        assert_eq!(Form::of(Some("Text/CSV; charset=utf-8")), Ok(Form::Csv));
        assert_eq!(Form::of(None).map_err(|problem| problem.status), Err(415));
    }

    #[test]
    fn val_refusals_name_the_sample() {
        let null = JSON.replace("15.5", "null");
        for (form, body, words) in [
            (Form::Json, format!("[{JSON},{null}]"), "sample 2: invalid type: null"),
            (Form::Json, "{}".to_owned(), "not an array of samples"),
            (Form::Lines, format!("{JSON}\n{null}\n"), "sample 2: invalid type: null"),
            (
                Form::Lines,
                JSON.replace("duty", "dutie"),
                "sample 1: unknown field `dutie`",
            ),
            (
                Form::Json,
                format!("[{}]", JSON.replace("0.25,", "")),
                "sample 1: duty has 1 entries, expected one for each of the 2",
            ),
            (
                Form::Csv,
                CSV.replace("15.5", ""),
                "sample 1: battery_voltage_v is '', expected a number",
            ),
            (Form::Csv, CSV.replace("duty_2", "duty_3"), "no column duty_2"),
            (Form::Csv, format!("{CSV}1,2\n"), "sample 2 has 2 cells"),
        ] {
            let problem = read(form, body.as_bytes(), 2).expect_err(words);
            assert!(
                problem.status == 422 && problem.detail.contains(words),
                "{}",
                problem.detail
            );
        }
    }
}
