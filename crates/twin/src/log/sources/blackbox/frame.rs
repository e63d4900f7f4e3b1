//! Frames of the main stream: each field against its predictor.

use super::encoding::{Encoding, read, signed, unsigned};
use super::{Cursor, Header};
use crate::log::MAX_COLUMNS;
use std::collections::BTreeMap;

/// Largest jump of a frame's time, µs; beyond it the frame was misread.
const LONGEST_JUMP_US: i64 = 10_000_000;

/// What a value is the difference to, by its number in the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Predictor {
    Zero,
    Previous,
    Line,
    MeanOfTwo,
    MinThrottle,
    Motor0,
    Increment,
    Middle,
    Battery,
    MinMotor,
    /// Of GPS frames, which are skipped.
    NotKept,
}

impl Predictor {
    fn of(number: i64) -> Option<Self> {
        Some(match number {
            0 => Self::Zero,
            1 => Self::Previous,
            2 => Self::Line,
            3 => Self::MeanOfTwo,
            4 => Self::MinThrottle,
            5 => Self::Motor0,
            6 => Self::Increment,
            8 => Self::Middle,
            9 => Self::Battery,
            11 => Self::MinMotor,
            7 | 10 => Self::NotKept,
            _ => return None,
        })
    }
}

/// Fields of a kind of frame.
pub(super) struct Definition {
    pub(super) names: Vec<String>,
    signed: Vec<bool>,
    whole: (Vec<Encoding>, Vec<Predictor>),
    against: (Vec<Encoding>, Vec<Predictor>),
    motor_0: Option<usize>,
}

fn numbers(values: &BTreeMap<String, String>, key: &str) -> Option<Vec<i64>> {
    values
        .get(key)?
        .split(',')
        .map(|text| text.trim().parse().ok())
        .collect()
}

impl Definition {
    /// Of the main stream: `Field I …` and `Field P …`.
    pub(super) fn main(values: &BTreeMap<String, String>) -> Result<Self, String> {
        let mut main =
            Self::of(values, 'I').ok_or("the header of the blackbox log does not define the main frames".to_owned())?;
        let count = main.names.len();
        let encodings = numbers(values, "Field P encoding").unwrap_or_default();
        let predictors = numbers(values, "Field P predictor").unwrap_or_default();
        let encodings: Option<Vec<Encoding>> = encodings.into_iter().map(Encoding::of).collect();
        let predictors: Option<Vec<Predictor>> = predictors.into_iter().map(Predictor::of).collect();
        match (encodings, predictors) {
            (Some(encodings), Some(predictors)) if encodings.len() == count && predictors.len() == count => {
                main.against = (encodings, predictors);
                Ok(main)
            }
            _ => Err(
                "the header of the blackbox log defines P frames of other fields, or in an unknown encoding".to_owned(),
            ),
        }
    }

    /// Of one kind of frame by its letter; `None` where the header has none or one that is not known.
    pub(super) fn of(values: &BTreeMap<String, String>, letter: char) -> Option<Self> {
        let names: Vec<String> = values
            .get(&format!("Field {letter} name"))?
            .split(',')
            .map(|name| name.trim().to_owned())
            .collect();
        let count = names.len();
        let encodings: Vec<Encoding> = numbers(values, &format!("Field {letter} encoding"))?
            .into_iter()
            .map(Encoding::of)
            .collect::<Option<_>>()?;
        let predictors: Vec<Predictor> = numbers(values, &format!("Field {letter} predictor"))?
            .into_iter()
            .map(Predictor::of)
            .collect::<Option<_>>()?;
        let mut signed: Vec<bool> = numbers(values, &format!("Field {letter} signed"))
            .unwrap_or_default()
            .into_iter()
            .map(|flag| flag != 0)
            .collect();
        signed.resize(count, true);
        if encodings.len() != count || predictors.len() != count || count > MAX_COLUMNS {
            return None;
        }
        Some(Self {
            motor_0: names.iter().position(|name| name == "motor[0]"),
            names,
            signed,
            whole: (encodings, predictors),
            against: (Vec::new(), Vec::new()),
        })
    }

    /// Reads over a frame.
    pub(super) fn skip(&self, cursor: &mut Cursor<'_>) -> Option<()> {
        read(cursor, &self.whole.0, &mut Vec::new())
    }
}

/// The frames before the present one.
pub(super) struct History {
    previous: Option<Vec<i64>>,
    before: Option<Vec<i64>>,
    min_throttle: i64,
    min_motor: i64,
    battery: i64,
    /// Of `interval` iterations, whole ones every so many; of the others `kept` of every `of`.
    interval: i64,
    kept: i64,
    of: i64,
    /// Iterations that the logger leaves out before the next frame.
    skipped: i64,
    /// Of the last frame that was kept, µs.
    last_time: Option<i64>,
}

impl History {
    pub(super) fn new(header: &Header) -> Self {
        let whole = |key: &str, default: i64| header.number(key).map_or(default, |number| number as i64);
        let text = header.text("P interval");
        let (kept, of) = match text.split_once('/') {
            Some((kept, of)) => (kept.trim().parse().unwrap_or(1), of.trim().parse().unwrap_or(1)),
            None => (1, text.trim().parse().unwrap_or(1)),
        };
        Self {
            previous: None,
            before: None,
            min_throttle: whole("minthrottle", 1000),
            min_motor: header
                .pair("motorOutput")
                .map_or(whole("minthrottle", 1000), |(low, _)| low as i64),
            battery: whole("vbatref", 4095),
            interval: whole("I interval", 32).max(1),
            kept: i64::max(kept, 1),
            of: i64::max(of, 1),
            skipped: 0,
            last_time: None,
        }
    }

    /// What was read before can no longer be built upon.
    pub(super) fn lose(&mut self) {
        self.previous = None;
        self.before = None;
    }

    /// A whole frame.
    pub(super) fn whole(&mut self, main: &Definition, cursor: &mut Cursor<'_>, out: &mut Vec<i64>) -> Option<()> {
        read(cursor, &main.whole.0, out)?;
        self.lose();
        self.add_predictions(main, &main.whole.1, out)
    }

    /// A frame against those before; without one before it is read over, and no row.
    pub(super) fn against(&mut self, main: &Definition, cursor: &mut Cursor<'_>, out: &mut Vec<i64>) -> Option<()> {
        read(cursor, &main.against.0, out)?;
        if self.previous.is_none() {
            out.clear();
            return Some(());
        }
        self.skipped = self.left_out();
        self.add_predictions(main, &main.against.1, out)
    }

    /// Iterations that the logger leaves out on purpose after the previous frame.
    fn left_out(&self) -> i64 {
        let Some(previous) = self.previous.as_ref().and_then(|previous| previous.first()) else {
            return 0;
        };
        let is_logged = |iteration: i64| {
            let place = iteration.rem_euclid(self.interval);
            place == 0 || (place + self.kept - 1).rem_euclid(self.of) < self.kept
        };
        (0..self.interval)
            .find(|skipped| is_logged(previous.wrapping_add(1 + skipped)))
            .unwrap_or(0)
    }

    fn add_predictions(&self, main: &Definition, predictors: &[Predictor], out: &mut [i64]) -> Option<()> {
        for field in 0..out.len() {
            let previous = self.previous.as_ref().map_or(0, |frame| frame[field]);
            let before = self.before.as_ref().map_or(previous, |frame| frame[field]);
            let predicted = match predictors[field] {
                Predictor::Zero | Predictor::NotKept => 0,
                Predictor::Previous => previous,
                Predictor::Line => 2 * previous - before,
                Predictor::MeanOfTwo => (previous + before) / 2,
                Predictor::MinThrottle => self.min_throttle,
                Predictor::Motor0 => out[main.motor_0.filter(|motor| *motor < field)?],
                Predictor::Increment => previous + 1 + self.skipped,
                Predictor::Middle => 1500,
                Predictor::Battery => self.battery,
                Predictor::MinMotor => self.min_motor,
            };
            let value = predicted.wrapping_add(out[field]);
            // 32 bits on the board.
            out[field] = if main.signed[field] {
                i64::from(value as i32)
            } else {
                i64::from(value as u32)
            };
        }
        Some(())
    }

    /// Keeps a frame that was read; false if it is invalid, or its time is impossible.
    pub(super) fn take(&mut self, main: &Definition, frame: &[i64], time: usize) -> bool {
        if frame.len() != main.names.len() {
            return false;
        }
        let now = frame[time];
        let later = self
            .last_time
            .is_none_or(|last| now > last && now - last < LONGEST_JUMP_US);
        if !later {
            self.lose();
            return false;
        }
        self.last_time = Some(now);
        self.before = Some(match self.previous.take() {
            Some(previous) => previous,
            None => frame.to_vec(),
        });
        self.previous = Some(frame.to_vec());
        true
    }

    /// Reads over an event: true at the end of the log. `None` for an event that is not known, or cut.
    pub(super) fn event(&mut self, cursor: &mut Cursor<'_>) -> Option<bool> {
        const END: &[u8] = b"End of log\0";
        match cursor.u8()? {
            0 | 15 | 40 => {
                unsigned(cursor)?;
            }
            13 => {
                if cursor.u8()? < 128 {
                    signed(cursor)?;
                } else {
                    cursor.take(4)?;
                }
            }
            14 => {
                unsigned(cursor)?;
                // A pause: time continues from here.
                self.last_time = Some(i64::from(unsigned(cursor)?) - 1);
                self.lose();
            }
            30 => {
                unsigned(cursor)?;
                unsigned(cursor)?;
            }
            255 => return cursor.bytes.starts_with(END).then_some(true),
            _ => return None,
        }
        Some(false)
    }
}
