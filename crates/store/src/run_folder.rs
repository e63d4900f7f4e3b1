//! The folder of one run: created before the first step, completed after the last.
//!
//! ```text
//! RunFolder::create ─▶ telemetry.spool grows ─▶ finalise ─▶ telemetry.parquet, run.mcap, report.html, figures/, summary.json
//! ```
//!
//! Every file is written under a temporary name and renamed when complete, `summary.json` last: a folder with a summary is
//! complete. A failed run is finalised like any other, with as many rows as it has, possibly none.
//!
//! Nothing is synced to disk; a power failure may lose the latest files.

use crate::analysis::{Analysis, Findings};
use crate::error::{Result, StoreError, io};
use crate::figures;
use crate::files::{FIGURES_FOLDER, MCAP_FILE, REPORT_FILE, SPOOL_FILE, SUMMARY_FILE, TELEMETRY_FILE};
use crate::mcap::McapSink;
use crate::parquet::ParquetSink;
use crate::plots::Plots;
use crate::report;
use crate::spool::SpoolReader;
use crate::summary::{SUMMARY_VERSION, Summary};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// The folder of one run.
#[derive(Clone, Debug)]
pub struct RunFolder {
    path: PathBuf,
    created: bool,
}

impl RunFolder {
    /// Creates the folder, with its parents.
    ///
    /// Rejects a path that is a file or a non-empty folder, so that no run is ever mixed with another or overwritten. Call it
    /// only when the input has been validated: then bad input leaves nothing half-written behind.
    pub fn create(path: &Path) -> Result<Self> {
        let created = match std::fs::read_dir(path) {
            Ok(mut entries) => {
                if entries.next().is_some() {
                    return Err(StoreError::FolderNotEmpty {
                        path: path.to_path_buf(),
                    });
                }
                false
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                std::fs::create_dir_all(path).map_err(io(path, "cannot create the folder of the run"))?;
                true
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotADirectory => {
                return Err(StoreError::NotAFolder {
                    path: path.to_path_buf(),
                });
            }
            Err(error) => return Err(io(path, "cannot read the folder of the run")(error)),
        };
        Ok(Self {
            path: path.to_path_buf(),
            created,
        })
    }

    /// Opens a folder created for this run by another process, e.g. the supervisor of the flight's process.
    pub fn open(path: &Path) -> Result<Self> {
        if !path.is_dir() {
            return Err(StoreError::NotAFolder {
                path: path.to_path_buf(),
            });
        }
        Ok(Self {
            path: path.to_path_buf(),
            created: false,
        })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of the spool during the run.
    pub fn spool_path(&self) -> PathBuf {
        self.path.join(SPOOL_FILE)
    }

    /// Undoes [`create`](Self::create): removes the spool, and the folder if it was created here and is otherwise empty.
    pub fn discard(self) -> Result<()> {
        let spool = self.spool_path();
        match std::fs::remove_file(&spool) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(io(&spool, "cannot remove the spool")(error));
            }
            _ => {}
        }
        if self.created {
            std::fs::remove_dir(&self.path).map_err(io(&self.path, "cannot remove the folder of the run"))?;
        }
        Ok(())
    }
}

/// Files written by [`finalise`].
#[derive(Clone, Debug)]
pub struct Outputs {
    /// The summary, completed.
    pub summary: Summary,
    /// `telemetry.parquet`; absent if the run ended before its spool was created.
    pub telemetry: Option<PathBuf>,
    /// `run.mcap`; absent as above.
    pub mcap: Option<PathBuf>,
    /// `report.html`.
    pub report: PathBuf,
    /// `summary.json`.
    pub summary_file: PathBuf,
    /// `figures/*.svg`; empty if there are no rows.
    pub figures: Vec<PathBuf>,
}

/// Writes all output of a run and removes its spool.
///
/// * `summary`: the facts of the run; everything computable from the telemetry is computed here
///
/// The spool's writer must have been finished or dropped. If this fails, the spool is kept and it can be called again.
pub fn finalise(folder: &RunFolder, mut summary: Summary) -> Result<Outputs> {
    let path = folder.path();
    summary.schema_version = SUMMARY_VERSION;
    if summary.run.is_empty() {
        summary.run = path
            .file_name()
            .map_or_else(|| "run".to_owned(), |name| name.to_string_lossy().into_owned());
    }
    let spool_path = folder.spool_path();
    let (mut telemetry, mut mcap) = (None, None);
    let mut plots = None;
    if spool_path.exists() {
        let mut spool = SpoolReader::open(&spool_path)?;
        let header = spool.header().clone();
        let columns = spool.columns().to_vec();
        summary.rotor_count = header.rotor_count;
        summary.conditions = header.conditions.clone();
        summary.steps = spool.rows();
        summary.simulated_s = spool.rows() as f64 * header.step_ns as f64 / 1e9;
        summary.steps_per_s = if summary.wall_s > 0.0 {
            spool.rows() as f64 / summary.wall_s
        } else {
            0.0
        };

        let parquet_file = PartFile::create(path, TELEMETRY_FILE)?;
        let mcap_file = PartFile::create(path, MCAP_FILE)?;
        let mut parquet_sink = ParquetSink::new(
            parquet_file.writer()?,
            &parquet_file.target,
            &header,
            &columns,
            &summary,
        )?;
        let mut mcap_sink = McapSink::new(mcap_file.writer()?, &mcap_file.target, &header, &columns, &summary)?;
        let mut analysis = Analysis::new(&header, &columns);
        let mut drawn = Plots::new(&header, &columns, spool.rows());
        spool.for_each_chunk(|chunk| {
            analysis.push(chunk);
            drawn.push(chunk);
            parquet_sink.push(chunk)?;
            mcap_sink.push(chunk)
        })?;
        parquet_file.keep(parquet_sink.finish()?)?;
        mcap_file.keep(mcap_sink.finish()?)?;
        let Findings {
            tracking,
            battery,
            intervals,
        } = analysis.finish();
        summary.tracking = tracking;
        summary.battery = battery;
        summary.intervals = intervals;
        telemetry = Some(path.join(TELEMETRY_FILE));
        mcap = Some(path.join(MCAP_FILE));
        drawn.finish();
        plots = (spool.rows() > 0).then_some(drawn);
    }

    let figures = match &plots {
        Some(plots) => write_figures(path, plots, &summary)?,
        None => Vec::new(),
    };
    let drawn_from = telemetry.as_deref().filter(|_| plots.is_some());
    let report = write_text(
        path,
        REPORT_FILE,
        &report::render(&summary, plots.as_ref(), drawn_from)?,
    )?;
    let summary_file = write_text(path, SUMMARY_FILE, &summary.to_json())?;
    match std::fs::remove_file(&spool_path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(io(&spool_path, "cannot remove the spool")(error));
        }
        _ => {}
    }
    Ok(Outputs {
        summary,
        telemetry,
        mcap,
        report,
        summary_file,
        figures,
    })
}

fn write_figures(path: &Path, plots: &Plots, summary: &Summary) -> Result<Vec<PathBuf>> {
    let folder = path.join(FIGURES_FOLDER);
    std::fs::create_dir_all(&folder).map_err(io(&folder, "cannot create the folder of the figures"))?;
    figures::render(plots, summary)
        .into_iter()
        .map(|(name, svg)| write_text(&folder, &name, &svg))
        .collect()
}

pub(crate) fn write_text(folder: &Path, name: &str, text: &str) -> Result<PathBuf> {
    let part = PartFile::create(folder, name)?;
    let mut writer = part.writer()?;
    writer
        .write_all(text.as_bytes())
        .map_err(io(&part.target, "cannot write the file"))?;
    let target = part.target.clone();
    part.keep(writer)?;
    Ok(target)
}

/// A file under a temporary name; removed unless it is kept.
pub(crate) struct PartFile {
    part: PathBuf,
    pub(crate) target: PathBuf,
    kept: bool,
}

impl PartFile {
    pub(crate) fn create(folder: &Path, name: &str) -> Result<Self> {
        let part = folder.join(format!(".{name}.part"));
        File::create(&part).map_err(io(&part, "cannot create the file"))?;
        Ok(Self {
            part,
            target: folder.join(name),
            kept: false,
        })
    }

    pub(crate) fn writer(&self) -> Result<BufWriter<File>> {
        let file = File::options()
            .write(true)
            .open(&self.part)
            .map_err(io(&self.part, "cannot open the file"))?;
        Ok(BufWriter::with_capacity(1 << 18, file))
    }

    pub(crate) fn keep(mut self, mut writer: BufWriter<File>) -> Result<()> {
        writer.flush().map_err(io(&self.target, "cannot write the file"))?;
        drop(writer);
        std::fs::rename(&self.part, &self.target).map_err(io(&self.target, "cannot rename the finished file"))?;
        self.kept = true;
        Ok(())
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        if !self.kept {
            // Best effort: report the error that led here instead.
            drop(std::fs::remove_file(&self.part));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_folder_with_something_in_it_is_refused_and_left_alone() {
        let base = tempfile::tempdir().unwrap();
        let message = |path: &Path| RunFolder::create(path).unwrap_err().to_string();
        std::fs::write(base.path().join("notes.txt"), "mine").unwrap();
        assert!(message(base.path()).contains("not empty"));
        assert!(message(&base.path().join("notes.txt")).contains("not a folder"));
        assert!(message(&base.path().join("notes.txt/run")).contains("not a folder"));
        assert_eq!(std::fs::read_dir(base.path()).unwrap().count(), 1);
    }

    #[test]
    fn val_discard_leaves_nothing_but_what_was_there() {
        let base = tempfile::tempdir().unwrap();
        let path = base.path().join("runs/one");
        let folder = RunFolder::create(&path).unwrap();
        std::fs::write(folder.spool_path(), "x").unwrap();
        folder.discard().unwrap();
        assert!(!path.exists());

        let empty = base.path().join("mine");
        std::fs::create_dir(&empty).unwrap();
        RunFolder::create(&empty).unwrap().discard().unwrap();
        assert!(empty.exists());
    }

    #[test]
    fn val_unfinished_part_is_removed() {
        let base = tempfile::tempdir().unwrap();
        drop(PartFile::create(base.path(), "x").unwrap());
        assert_eq!(std::fs::read_dir(base.path()).unwrap().count(), 0);
    }
}
