//! Queries on the telemetry of a completed run: some channels, an interval, no more rows than a plot needs.
//!
//! ```text
//! telemetry.parquet ─▶ row groups overlapping the interval ─▶ requested columns only ─▶ decimator ─▶ table ─▶ JSON, CSV, Parquet
//! ```
//! * [`TelemetryFile`] opens a file, lists its channels and answers a [`Query`].
//! * [`decimate`] defines the meaning of a row of a decimated table: extremes are never lost.
//! * [`render`] writes a table.
//!
//! Memory: one block of [`BATCH`] rows and the decimated column; the size of a result is bounded by [`MOST_VALUES`]. Time is assumed to
//! increase from row to row, as in the output of [`finalise`](crate::run_folder::finalise).

mod channel;
mod columns;
pub mod decimate;
mod error;
pub mod render;

pub use channel::{Channel, ChannelKind};
pub use error::QueryError;
pub use render::Format;

use columns::ColumnStream;
use decimate::{Decimator, Keep};
use parquet::errors::ParquetError;
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::file::serialized_reader::ReadOptionsBuilder;
use parquet::file::statistics::Statistics;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Rows decoded at a time.
const BATCH: usize = 16_384;
/// Maximum number of values in a result, over all its channels.
pub const MOST_VALUES: u64 = 2_000_000;
/// Default number of rows for a plot.
pub const DEFAULT_POINTS: usize = 2_000;
/// First channel of every table.
pub const TIME: &str = "time_s";

/// A query.
#[derive(Clone, Debug, PartialEq)]
pub struct Query {
    /// Names, or patterns in which one `*` matches anything (`duty_*`); the time is always included and need not be named.
    pub channels: Vec<String>,
    /// First time, s; `None`: from the start.
    pub from_s: Option<f64>,
    /// Last time, s; `None`: to the end.
    pub to_s: Option<f64>,
    /// Maximum number of rows of the result, at least 2.
    pub points: usize,
}

impl Query {
    /// A whole run, in as many rows as a plot needs.
    pub fn of<S: Into<String>>(channels: impl IntoIterator<Item = S>) -> Self {
        Self {
            channels: channels.into_iter().map(Into::into).collect(),
            from_s: None,
            to_s: None,
            points: DEFAULT_POINTS,
        }
    }
}

/// The result.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Rows of the file in the interval.
    pub source_rows: u64,
    /// There are fewer rows than in the file: see [`decimate`].
    pub decimated: bool,
    /// The time, then the channels in the order requested.
    pub columns: Vec<TableColumn>,
}

impl Table {
    /// Rows of the table.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |column| column.values.len())
    }
}

/// One channel of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct TableColumn {
    /// Channel.
    pub channel: Channel,
    /// One value per row; NaN: missing.
    pub values: Vec<f64>,
}

/// A `telemetry.parquet` opened for queries.
pub struct TelemetryFile {
    path: PathBuf,
    reader: SerializedFileReader<File>,
    channels: Vec<Channel>,
}

impl TelemetryFile {
    /// Opens a file; its data are read on demand.
    ///
    /// # Errors
    /// The file is missing or not a Parquet file.
    pub fn open(path: &Path) -> Result<Self, QueryError> {
        let file = File::open(path).map_err(|source| QueryError::Io {
            path: path.to_path_buf(),
            source,
        })?;
        let damaged = |reason: String| QueryError::Damaged {
            path: path.to_path_buf(),
            reason,
        };
        let options = ReadOptionsBuilder::new().with_page_index().build();
        let reader = SerializedFileReader::new_with_options(file, options)
            .map_err(|error| damaged(format!("not a readable Parquet file: {error}")))?;
        let channels = channel::channels(reader.metadata().file_metadata());
        Ok(Self {
            path: path.to_path_buf(),
            reader,
            channels,
        })
    }

    /// All channels, in the order of the file.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Rows of the file.
    pub fn rows(&self) -> u64 {
        u64::try_from(self.reader.metadata().file_metadata().num_rows()).unwrap_or(0)
    }

    /// A fact from the file's metadata, such as `seed`.
    pub fn fact(&self, name: &str) -> Option<&str> {
        let entries = self.reader.metadata().file_metadata().key_value_metadata()?;
        let entry = entries
            .iter()
            .find(|entry| entry.key.strip_prefix("rotortwin.") == Some(name))?;
        entry.value.as_deref()
    }

    /// Index of a numeric channel.
    fn number_channel(&self, name: &str) -> Result<usize, QueryError> {
        number_channel(&self.channels, name)
    }

    /// Answers a query.
    ///
    /// # Errors
    /// An unknown channel, an invalid interval or number of points, more values than [`MOST_VALUES`], a damaged file.
    pub fn query(&self, query: &Query) -> Result<Table, QueryError> {
        // The decoder panics on some damaged pages.
        let answer = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| self.answer(query)));
        answer.unwrap_or_else(|_| Err(self.damaged("its pages cannot be decoded")))
    }

    fn answer(&self, query: &Query) -> Result<Table, QueryError> {
        if query.points < 2 {
            return Err(QueryError::Points { points: query.points });
        }
        let places = self.places(&query.channels)?;
        let ranges = self.rows_between(query.from_s, query.to_s)?;
        let source_rows = ranges.iter().map(|(_, rows)| rows.len() as u64).sum::<u64>();
        let rows = source_rows.min(query.points as u64);
        let values = rows.saturating_mul(places.len() as u64);
        if values > MOST_VALUES {
            return Err(QueryError::TooMany { values });
        }
        let mut columns = Vec::with_capacity(places.len());
        for place in places {
            let channel = self.channels[place].clone();
            let keep = if place == self.time()? {
                Keep::Ends
            } else {
                Keep::of(&channel.name)
            };
            let mut decimator = Decimator::new(source_rows, query.points, keep);
            self.read(place, &ranges, |values| decimator.push(values))?;
            columns.push(TableColumn {
                channel,
                values: decimator.finish(),
            });
        }
        Ok(Table {
            source_rows,
            decimated: rows < source_rows,
            columns,
        })
    }

    fn time(&self) -> Result<usize, QueryError> {
        self.number_channel(TIME)
    }

    /// The time, then the requested channels, each once.
    fn places(&self, names: &[String]) -> Result<Vec<usize>, QueryError> {
        let mut places = vec![self.time()?];
        for name in names {
            for place in self.matching(name)? {
                if !places.contains(&place) {
                    places.push(place);
                }
            }
        }
        Ok(places)
    }

    /// Indices of a channel or of all that match a pattern.
    fn matching(&self, name: &str) -> Result<Vec<usize>, QueryError> {
        matching(&self.channels, name)
    }

    /// Row groups that overlap the interval, with the range of rows inside it.
    fn rows_between(&self, from_s: Option<f64>, to_s: Option<f64>) -> Result<Vec<(usize, Range<usize>)>, QueryError> {
        let (from, to) = (from_s.unwrap_or(f64::NEG_INFINITY), to_s.unwrap_or(f64::INFINITY));
        if from.is_nan() || to.is_nan() || from > to {
            return Err(QueryError::Interval { from, to });
        }
        let time = self.time()?;
        let mut ranges = Vec::new();
        for index in 0..self.reader.num_row_groups() {
            let metadata = self.reader.metadata().row_group(index);
            let rows = usize::try_from(metadata.num_rows()).unwrap_or(0);
            let range = match time_bounds(metadata, time) {
                Some((first, last)) if last < from || first > to => continue,
                Some((first, last)) if from <= first && last <= to => 0..rows,
                _ => {
                    let mut times = Vec::with_capacity(rows.min(1 << 20));
                    self.read(time, &[(index, 0..rows)], |values| times.extend_from_slice(values))?;
                    times.partition_point(|time| *time < from)..times.partition_point(|time| *time <= to)
                }
            };
            if !range.is_empty() {
                ranges.push((index, range));
            }
        }
        Ok(ranges)
    }

    /// Passes the values of a column to `take`, a batch at a time.
    fn read(
        &self,
        place: usize,
        ranges: &[(usize, Range<usize>)],
        mut take: impl FnMut(&[f64]),
    ) -> Result<(), QueryError> {
        let mut values = Vec::new();
        for (group, rows) in ranges {
            let told = |error: ParquetError| self.damaged(&format!("{}: {error}", self.channels[place].name));
            let mut stream = ColumnStream::open(&self.reader, *group, place).map_err(told)?;
            stream.skip(rows.start).map_err(told)?;
            let mut left = rows.len();
            while left > 0 {
                values.clear();
                stream.read(left.min(BATCH), &mut values).map_err(told)?;
                if values.is_empty() {
                    return Err(self.damaged("it has fewer rows than it declares"));
                }
                left -= values.len();
                take(&values);
            }
        }
        Ok(())
    }

    /// Passes all rows of some columns to `take`, a block of rows at a time, column by column.
    ///
    /// # Errors
    /// A missing column; a damaged file; errors of `take`.
    pub fn for_each_block<E: From<QueryError>>(
        &self,
        names: &[&str],
        mut take: impl FnMut(&[Vec<f64>]) -> Result<(), E>,
    ) -> Result<(), E> {
        let places = names
            .iter()
            .map(|name| self.number_channel(name))
            .collect::<Result<Vec<_>, _>>()?;
        let told = |error: ParquetError| self.damaged(&error.to_string());
        for group in 0..self.reader.num_row_groups() {
            let mut streams = places
                .iter()
                .map(|place| ColumnStream::open(&self.reader, group, *place).map_err(told))
                .collect::<Result<Vec<_>, _>>()?;
            let mut left = usize::try_from(self.reader.metadata().row_group(group).num_rows()).unwrap_or(0);
            let mut block = vec![Vec::new(); streams.len()];
            while left > 0 {
                let rows = left.min(BATCH / 4);
                for (stream, values) in streams.iter_mut().zip(&mut block) {
                    values.clear();
                    stream.read(rows, values).map_err(told)?;
                    if values.len() != rows {
                        return Err(self.damaged("it has fewer rows than it declares").into());
                    }
                }
                take(&block)?;
                left -= rows;
            }
        }
        Ok(())
    }

    fn damaged(&self, reason: &str) -> QueryError {
        QueryError::Damaged {
            path: self.path.clone(),
            reason: reason.to_owned(),
        }
    }
}

fn number_channel(channels: &[Channel], name: &str) -> Result<usize, QueryError> {
    let at = channels
        .iter()
        .position(|channel| channel.name == name)
        .ok_or_else(|| QueryError::unknown(name, channels))?;
    if channels[at].kind.is_number() {
        Ok(at)
    } else {
        Err(QueryError::NotNumbers { name: name.to_owned() })
    }
}

/// Indices of the channel of this name, or of all numeric channels that match a pattern with one `*`; at least one.
///
/// # Errors
/// There is none, or it is not numeric.
pub fn matching(channels: &[Channel], name: &str) -> Result<Vec<usize>, QueryError> {
    let Some((head, tail)) = name.split_once('*') else {
        return Ok(vec![number_channel(channels, name)?]);
    };
    let fits = |channel: &Channel| {
        channel.kind.is_number()
            && channel.name.len() >= head.len() + tail.len()
            && channel.name.starts_with(head)
            && channel.name.ends_with(tail)
    };
    let places: Vec<usize> = (0..channels.len()).filter(|at| fits(&channels[*at])).collect();
    if places.is_empty() {
        return Err(QueryError::unknown(name, channels));
    }
    Ok(places)
}

/// Smallest and largest time of a row group, if the file contains statistics.
fn time_bounds(metadata: &RowGroupMetaData, time: usize) -> Option<(f64, f64)> {
    match metadata.column(time).statistics()? {
        Statistics::Double(statistics) => Some((*statistics.min_opt()?, *statistics.max_opt()?)),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
