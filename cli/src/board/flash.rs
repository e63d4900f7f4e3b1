//! `rotortwin board flash`: writes a `.px4` file to a board, through PX4's boot loader.

use indicatif::{ProgressBar, ProgressStyle};
use rotortwin_bridge::boot_loader::{BootLoader, Progress};
use rotortwin_bridge::line::FileLine;
use rotortwin_bridge::px4_file::Px4File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Baud rate of the boot loader's UART; USB accepts any.
const BAUD: u32 = 115_200;

/// Flashes; the error is a message, and whether the input was wrong.
///
/// * `port`: None searches for the USB port of a PX4 boot loader   * `wait`: time for the boot loader to appear
pub(crate) fn flash(path: &Path, port: Option<&Path>, wait: Duration) -> Result<(), (bool, String)> {
    let file = Px4File::load(path).map_err(|error| (true, error))?;
    println!(
        "{}: {} bytes for boards {}, {}",
        path.display(),
        file.image.len(),
        file.board_id,
        file.summary
    );
    println!("Take the propellers off. Plug the board's USB in now, if it is not in its boot loader yet.");
    let port = match port {
        Some(port) => port.to_owned(),
        None => find_port(wait).map_err(|error| (false, error))?,
    };
    let line = open(&port, wait).map_err(|error| (true, error))?;
    let bar = ProgressBar::new(file.image.len() as u64);
    bar.set_style(
        ProgressStyle::with_template("{msg:12} {bar:40} {bytes}/{total_bytes}")
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
    );
    let result = BootLoader::find(line, wait).and_then(|found| {
        found.flash(&file, |progress| match progress {
            Progress::Found(device) => println!(
                "{}: board {}, boot loader of revision {}, room for {} bytes",
                port.display(),
                device.board_id,
                device.revision,
                device.flash
            ),
            Progress::Erasing => bar.set_message("erasing"),
            Progress::Writing(written, _) => {
                bar.set_message("writing");
                bar.set_position(written as u64);
            }
            Progress::Checking => bar.set_message("comparing"),
            Progress::Starting => bar.finish_and_clear(),
        })
    });
    bar.finish_and_clear();
    result.map_err(|error| (false, format!("{}: {error}", port.display())))?;
    println!("Written, compared and started.");
    Ok(())
}

/// Waits for a port to appear.
fn open(port: &Path, wait: Duration) -> Result<FileLine, String> {
    let start = Instant::now();
    loop {
        match FileLine::serial(port, BAUD) {
            Ok(line) => return Ok(line),
            Err(error) if start.elapsed() >= wait => return Err(error),
            Err(_) => std::thread::sleep(Duration::from_millis(50)),
        }
    }
}

/// The only serial port whose USB product names a PX4 boot loader.
fn find_port(wait: Duration) -> Result<PathBuf, String> {
    let start = Instant::now();
    loop {
        let found: Vec<PathBuf> = super::serial_ports()
            .into_iter()
            .filter(|port| super::usb_word(port, "product").contains("PX4 BL"))
            .map(|port| Path::new("/dev").join(port.file_name().unwrap_or_default()))
            .collect();
        match found.as_slice() {
            [port] => return Ok(port.clone()),
            [] if start.elapsed() >= wait => {
                return Err(format!(
                    "no PX4 boot loader appeared on USB within {:.0} s; '--port /dev/ttyACM0' names a port, '--wait' waits longer",
                    wait.as_secs_f64()
                ));
            }
            [] => std::thread::sleep(Duration::from_millis(50)),
            several => {
                let names: Vec<String> = several.iter().map(|port| port.display().to_string()).collect();
                return Err(format!(
                    "found several boot loaders ({}); choose one with '--port'",
                    names.join(", ")
                ));
            }
        }
    }
}
