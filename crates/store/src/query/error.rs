//! Errors of queries.

use super::channel::Channel;
use std::path::PathBuf;

/// Each message is one sentence.
#[derive(Debug, thiserror::Error)]
pub enum QueryError {
    /// Unknown channel.
    #[error("there is no channel '{name}'{nearest}")]
    UnknownChannel {
        /// Requested name.
        name: String,
        /// `; the nearest are …`, or nothing.
        nearest: String,
    },
    /// The channel holds text or lists.
    #[error("channel '{name}' is not numeric; expected a numeric channel")]
    NotNumbers {
        /// Channel.
        name: String,
    },
    /// Too few points.
    #[error("`points` is {points}; expected at least 2")]
    Points {
        /// Requested number.
        points: usize,
    },
    /// An invalid interval.
    #[error("the interval from {from} s to {to} s is empty; expected from_s ≤ to_s")]
    Interval {
        /// s.
        from: f64,
        /// s.
        to: f64,
    },
    /// The result would be too large.
    #[error(
        "that would be {values} values; expected at most {most}: request fewer channels or `points`, or fetch the whole file",
        most = super::MOST_VALUES
    )]
    TooMany {
        /// Number of values.
        values: u64,
    },
    /// The file cannot be opened or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file cannot be decoded.
    #[error("{}: {reason}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The output cannot be written.
    #[error("it cannot be written: {source}")]
    Output {
        /// Why.
        source: std::io::Error,
    },
    /// The result cannot be encoded.
    #[error("the answer cannot be written as Parquet: {source}")]
    Write {
        /// Why.
        #[from]
        source: parquet::errors::ParquetError,
    },
}

impl QueryError {
    /// The file is at fault, not the query.
    pub fn is_of_the_file(&self) -> bool {
        matches!(
            self,
            Self::Io { .. } | Self::Damaged { .. } | Self::Output { .. } | Self::Write { .. }
        )
    }

    pub(crate) fn unknown(name: &str, channels: &[Channel]) -> Self {
        let nearest = nearest(name, channels.iter().map(|channel| channel.name.as_str()));
        Self::UnknownChannel {
            // User input, truncated to the length of a name.
            name: name.chars().take(80).collect(),
            nearest: match nearest.as_slice() {
                [] => String::new(),
                [one] => format!("; the nearest is '{one}'"),
                some => format!("; the nearest are '{}'", some.join("', '")),
            },
        }
    }
}

/// Up to three likely names: those that contain the word or are contained in it first, then by edit distance.
fn nearest<'a>(word: &str, names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let word = word.chars().take(80).collect::<String>().to_lowercase();
    let mut ranked: Vec<(usize, &str)> = names
        .filter_map(|name| {
            let lower = name.to_lowercase();
            let part = word.len() >= 3 && (lower.contains(&word) || word.contains(&lower));
            let changes = changes(&word, &lower);
            (part || changes <= word.len().max(lower.len()) / 2).then_some((if part { 0 } else { changes }, name))
        })
        .collect();
    ranked.sort_by_key(|(changes, name)| (*changes, name.len()));
    ranked.into_iter().take(3).map(|(_, name)| name).collect()
}

/// Levenshtein distance in characters.
fn changes(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, a) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, b) in b.iter().enumerate() {
            let next = (diagonal + usize::from(a != *b)).min(row[j] + 1).min(row[j + 1] + 1);
            diagonal = std::mem::replace(&mut row[j + 1], next);
        }
    }
    row.last().copied().unwrap_or(0)
}
