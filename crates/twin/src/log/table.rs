//! A file's columns before they are accepted.

/// Columns as read; all have the same length.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    /// In the order of the file.
    pub(crate) columns: Vec<RawColumn>,
}

/// One column as read.
#[derive(Clone, Debug)]
pub(crate) struct RawColumn {
    pub(crate) name: String,
    /// NaN = empty cell, or a cell listed in `bad`.
    pub(crate) values: Vec<f64>,
    /// First cell that is not a finite number, with its data row (from 1) and its text.
    pub(crate) bad: Option<(usize, String)>,
    /// How many such cells there are.
    pub(crate) bad_cells: usize,
}

impl RawColumn {
    pub(crate) fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            values: Vec::new(),
            bad: None,
            bad_cells: 0,
        }
    }

    /// Adds a cell that is not a finite number.
    pub(crate) fn push_bad(&mut self, text: &str) {
        self.values.push(f64::NAN);
        self.bad_cells += 1;
        if self.bad.is_none() {
            let short: String = text.chars().take(40).collect();
            self.bad = Some((self.values.len(), short));
        }
    }
}

impl Table {
    /// Adds a column made in this process: NaN = empty, infinite = bad.
    pub(crate) fn push(&mut self, name: &str, values: Vec<f64>) {
        let mut column = RawColumn::new(name);
        for value in values {
            if value.is_infinite() {
                column.push_bad("inf");
            } else {
                column.values.push(value);
            }
        }
        self.columns.push(column);
    }

    /// Replaces sensed values (`NAME`) by the truth of a simulated run (`true_NAME`).
    pub(crate) fn take_truth(&mut self) -> Result<(), String> {
        const PREFIX: &str = "true_";
        let truths: Vec<String> = self
            .columns
            .iter()
            .filter_map(|column| column.name.strip_prefix(PREFIX).map(str::to_owned))
            .collect();
        if truths.is_empty() {
            return Err("no true_… column; the truth is in the telemetry of simulated runs only".to_owned());
        }
        for name in truths {
            if super::names::is_canonical(&name) {
                self.columns.retain(|column| column.name != name);
                for column in &mut self.columns {
                    if column.name.strip_prefix(PREFIX) == Some(&name) {
                        column.name.clone_from(&name);
                    }
                }
            }
        }
        Ok(())
    }
}
