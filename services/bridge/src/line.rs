//! Lines of bytes to a board: serial ports, pseudo-terminals, pipes and sockets of the emulator.
//!
//! A serial port that disappears (an unplugged USB cable) is reopened when it returns; until then nothing is sent or received, and the
//! session's time-out decides. An emulator that exits is an error at once.

use rotortwin_board::application::{Application, Board, State};
use rotortwin_board::message::CostUnit;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A byte stream to a board and back, with its own clock.
pub trait Line {
    /// Sends all bytes, or loses them.
    fn send(&mut self, bytes: &[u8]) -> Result<(), String>;
    /// Waits for bytes, at most for `wait`; returns the number received.
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> Result<usize, String>;
    /// Time since the line was opened: wall-clock time, or the line's virtual time.
    fn now(&self) -> Duration;
    /// Time after which an unanswered request is repeated.
    fn retry(&self) -> Duration;
}

/// A line over file descriptors.
pub struct FileLine {
    files: Option<(OwnedFd, OwnedFd)>,
    serial: Option<(PathBuf, u32)>,
    child: Option<Child>,
    start: Instant,
    retry: Duration,
    /// Folder with the emulator's pipes.
    _folder: Option<tempfile::TempDir>,
}

impl Drop for FileLine {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child
            && let Err(error) = child.kill().and_then(|()| child.wait().map(|_| ()))
        {
            tracing::warn!(%error, "could not end the emulator");
        }
    }
}

impl FileLine {
    fn new(reader: OwnedFd, writer: OwnedFd, retry: Duration) -> Self {
        Self {
            files: Some((reader, writer)),
            serial: None,
            child: None,
            start: Instant::now(),
            retry,
            _folder: None,
        }
    }

    /// A serial port, raw, 8N1.
    pub fn serial(path: &Path, baud: u32) -> Result<Self, String> {
        let port = open_serial(path, baud).map_err(|error| format!("{}: {error}", path.display()))?;
        let writer = port
            .try_clone()
            .map_err(|error| format!("{}: {error}", path.display()))?;
        let mut line = Self::new(port, writer, Duration::from_millis(100));
        line.serial = Some((path.to_owned(), baud));
        Ok(line)
    }

    /// A pseudo-terminal, with a virtual board of this process at its other end.
    pub fn pty() -> Result<Self, String> {
        let failed = |error: Errno| format!("no pseudo-terminal: {error}");
        let Terminal { end: host, path } = Terminal::open()?;
        let board = open_serial(&path, 921_600).map_err(failed)?;
        let flags = rustix::fs::fcntl_getfl(&host).map_err(failed)?;
        rustix::fs::fcntl_setfl(&host, flags | OFlags::NONBLOCK).map_err(failed)?;
        std::thread::Builder::new()
            .name("virtual-board".to_owned())
            .spawn(move || serve(&board))
            .map_err(|error| format!("the virtual board cannot be started: {error}"))?;
        let writer = host.try_clone().map_err(|error| error.to_string())?;
        Ok(Self::new(host, writer, Duration::from_millis(100)))
    }

    /// QEMU's `mps2-an500` with the program `elf`.
    ///
    /// * `channel`: over its UART, or over semihosting
    pub fn qemu(elf: &Path, channel: Channel) -> Result<Self, String> {
        if !elf.is_file() {
            return Err(format!(
                "{}: no such program; 'cargo xtask firmware' builds it",
                elf.display()
            ));
        }
        let folder = tempfile::tempdir().map_err(|error| format!("no temporary folder: {error}"))?;
        let mut command = Command::new("qemu-system-arm");
        command.args(["-M", "mps2-an500", "-display", "none", "-monitor", "none"]);
        // An instruction takes 1024 ns of the machine's time: costs are exact, and every run is identical.
        command.args(["-icount", "shift=10,sleep=off"]);
        command
            .arg("-kernel")
            .arg(elf)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let semihosting = "enable=on,target=native,arg=board";
        let (reader, writer, child) = match channel {
            Channel::Uart => {
                let socket = folder.path().join("uart");
                let listener = UnixListener::bind(&socket).map_err(|error| format!("{}: {error}", socket.display()))?;
                listener.set_nonblocking(true).map_err(|error| error.to_string())?;
                command
                    .arg("-semihosting-config")
                    .arg(format!("{semihosting},arg=uart"));
                command
                    .arg("-chardev")
                    .arg(format!("socket,id=s0,path={}", socket.display()));
                command.args(["-serial", "chardev:s0"]);
                let mut child = spawn(&mut command)?;
                let stream = until_there(&mut child, || listener.accept().ok().map(|(stream, _)| stream))?;
                stream.set_nonblocking(true).map_err(|error| error.to_string())?;
                let reader = OwnedFd::from(stream);
                let writer = reader.try_clone().map_err(|error| error.to_string())?;
                (reader, writer, child)
            }
            Channel::Semihosting => {
                let [to_board, to_host] = ["to-board", "to-host"].map(|name| folder.path().join(name));
                for path in [&to_board, &to_host] {
                    rustix::fs::mknodat(
                        rustix::fs::CWD,
                        path,
                        rustix::fs::FileType::Fifo,
                        Mode::RUSR | Mode::WUSR,
                        0,
                    )
                    .map_err(|error| format!("{}: {error}", path.display()))?;
                }
                let options = OFlags::NONBLOCK | OFlags::CLOEXEC;
                let reader = rustix::fs::open(&to_host, OFlags::RDONLY | options, Mode::empty())
                    .map_err(|error| format!("{}: {error}", to_host.display()))?;
                command.arg("-semihosting-config").arg(format!(
                    "{semihosting},arg=files,arg={},arg={}",
                    to_board.display(),
                    to_host.display()
                ));
                command.args(["-serial", "null"]);
                let mut child = spawn(&mut command)?;
                let writer = until_there(&mut child, || {
                    rustix::fs::open(&to_board, OFlags::WRONLY | options, Mode::empty()).ok()
                })?;
                (reader, writer, child)
            }
        };
        let mut line = Self::new(reader, writer, Duration::from_secs(1));
        line.child = Some(child);
        line._folder = Some(folder);
        Ok(line)
    }

    /// Reopens a serial port that had disappeared.
    fn reopen(&mut self) {
        if let Some((path, baud)) = &self.serial
            && self.files.is_none()
            && let Ok(port) = open_serial(path, *baud)
            && let Ok(writer) = port.try_clone()
        {
            tracing::info!(path = %path.display(), "the serial port is back");
            self.files = Some((port, writer));
        }
    }

    /// Handles a broken line.
    fn broken(&mut self, what: &str) -> Result<(), String> {
        if let Some((path, _)) = &self.serial {
            if self.files.take().is_some() {
                tracing::warn!(path = %path.display(), what, "the serial port is gone");
            }
            return Ok(());
        }
        match self.child.as_mut().map(Child::try_wait) {
            Some(Ok(Some(status))) => Err(format!("the emulator ended ({status})")),
            // The other end is not open yet, or about to close.
            _ => Ok(()),
        }
    }
}

/// A pseudo-terminal: a simulated board holds this end, the other one is a serial port with a path.
pub struct Terminal {
    end: OwnedFd,
    path: PathBuf,
}

impl Terminal {
    /// Creates one.
    pub fn open() -> Result<Self, String> {
        let failed = |error: Errno| format!("no pseudo-terminal: {error}");
        let end =
            rustix::pty::openpt(rustix::pty::OpenptFlags::RDWR | rustix::pty::OpenptFlags::NOCTTY).map_err(failed)?;
        rustix::pty::grantpt(&end).map_err(failed)?;
        rustix::pty::unlockpt(&end).map_err(failed)?;
        let name = rustix::pty::ptsname(&end, Vec::new()).map_err(failed)?;
        let path = PathBuf::from(name.to_string_lossy().into_owned());
        Ok(Self { end, path })
    }

    /// Path of the serial port.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits for a byte; None once the port is closed.
    pub fn read_byte(&self) -> Option<u8> {
        let mut byte = [0];
        loop {
            match rustix::io::read(&self.end, &mut byte) {
                Ok(1) => return Some(byte[0]),
                Err(Errno::INTR) => {}
                _ => return None,
            }
        }
    }

    /// Sends bytes to the process that has opened the port; false once it is closed.
    pub fn write(&self, bytes: &[u8]) -> bool {
        let mut rest = bytes;
        while !rest.is_empty() {
            match rustix::io::write(&self.end, rest) {
                Ok(written) => rest = &rest[written..],
                Err(Errno::INTR) => {}
                Err(_) => return false,
            }
        }
        true
    }
}

/// How the emulated board is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Two pipes through semihosting: fast.
    Semihosting,
    /// The emulated UART: a real stream of bytes, some 100 steps a second.
    Uart,
}

fn spawn(command: &mut Command) -> Result<Child, String> {
    command.spawn().map_err(|error| {
        format!("the emulator qemu-system-arm cannot be started ({error}); install Debian's package qemu-system-arm")
    })
}

fn until_there<T>(child: &mut Child, mut open: impl FnMut() -> Option<T>) -> Result<T, String> {
    let start = Instant::now();
    loop {
        if let Some(found) = open() {
            return Ok(found);
        }
        let ended = child.try_wait().map_err(|error| error.to_string())?;
        if ended.is_some() || start.elapsed() > Duration::from_secs(20) {
            let mut words = String::new();
            if let Err(error) = child.kill() {
                tracing::debug!(%error, "the emulator is gone already");
            }
            if let Some(stderr) = &mut child.stderr {
                use std::io::Read as _;
                stderr
                    .take(2000)
                    .read_to_string(&mut words)
                    .map_err(|error| error.to_string())?;
            }
            child.wait().map_err(|error| error.to_string())?;
            return Err(format!("the emulator did not start: {}", words.trim()));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn open_serial(path: &Path, baud: u32) -> Result<OwnedFd, Errno> {
    use rustix::termios::{ControlModes, OptionalActions, tcgetattr, tcsetattr};
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let port = rustix::fs::open(path, flags, Mode::empty())?;
    let mut settings = tcgetattr(&port)?;
    settings.make_raw();
    settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    settings.control_modes &= !(ControlModes::CSTOPB | ControlModes::CRTSCTS);
    settings.set_speed(baud)?;
    tcsetattr(&port, OptionalActions::Now, &settings)?;
    Ok(port)
}

fn timespec(wait: Duration) -> Timespec {
    Timespec::try_from(wait).unwrap_or(Timespec { tv_sec: 1, tv_nsec: 0 })
}

impl Line for FileLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), String> {
        self.reopen();
        let mut rest = bytes;
        while !rest.is_empty() {
            let Some((_, writer)) = &self.files else { return Ok(()) };
            match rustix::io::write(writer, rest) {
                Ok(written) => rest = &rest[written..],
                Err(Errno::AGAIN | Errno::INTR) => {
                    let mut fds = [PollFd::from_borrowed_fd(writer.as_fd(), PollFlags::OUT)];
                    // If a line accepts nothing for this long, the frame is lost; it will be repeated.
                    if poll(&mut fds, Some(&timespec(self.retry))) == Ok(0) {
                        return Ok(());
                    }
                }
                Err(error) => return self.broken(&error.to_string()),
            }
        }
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> Result<usize, String> {
        self.reopen();
        let Some((reader, _)) = &self.files else {
            std::thread::sleep(wait.min(Duration::from_millis(20)));
            return Ok(0);
        };
        let mut fds = [PollFd::from_borrowed_fd(reader.as_fd(), PollFlags::IN)];
        match poll(&mut fds, Some(&timespec(wait))) {
            Ok(0) | Err(Errno::INTR) => return Ok(0),
            Ok(_) => {}
            Err(error) => return self.broken(&error.to_string()).map(|()| 0),
        }
        match rustix::io::read(reader, &mut *buffer) {
            Ok(0) => {
                std::thread::sleep(Duration::from_millis(1));
                self.broken("end of file").map(|()| 0)
            }
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(error) => {
                std::thread::sleep(Duration::from_millis(1));
                self.broken(&error.to_string()).map(|()| 0)
            }
        }
    }

    fn now(&self) -> Duration {
        self.start.elapsed()
    }

    fn retry(&self) -> Duration {
        self.retry
    }
}

/// A board without hardware.
#[derive(Clone, Copy, Debug, Default)]
pub struct VirtualBoard;

impl Board for VirtualBoard {
    const NAME: &'static str = "virtual";
    const UNIT: CostUnit = CostUnit::Nothing;

    fn counter(&mut self) -> u32 {
        0
    }
    fn cost(&self, _: u32, _: u32) -> u32 {
        0
    }
    fn clock_hz(&self) -> u32 {
        0
    }
    fn stack(&self) -> [u32; 3] {
        [0; 3]
    }
    fn reset_cause(&self) -> u8 {
        0
    }
    fn show(&mut self, _: State) {}
    fn boot_loader(&mut self) -> bool {
        false
    }
}

/// Runs a virtual board at the end of a terminal, until the terminal closes.
fn serve(port: &OwnedFd) {
    let mut application = Box::<Application>::default();
    let mut buffer = [0; 1024];
    loop {
        let mut fds = [PollFd::from_borrowed_fd(port.as_fd(), PollFlags::IN)];
        if poll(&mut fds, None).is_err() {
            return;
        }
        let count = match rustix::io::read(port, &mut buffer) {
            Ok(0) => return,
            Ok(count) => count,
            Err(Errno::AGAIN | Errno::INTR) => continue,
            Err(_) => return,
        };
        for byte in &buffer[..count] {
            let Some(answer) = application.receive(*byte, &mut VirtualBoard) else {
                continue;
            };
            let mut rest = answer;
            while !rest.is_empty() {
                match rustix::io::write(port, rest) {
                    Ok(written) => rest = &rest[written..],
                    Err(Errno::AGAIN | Errno::INTR) => std::thread::yield_now(),
                    Err(_) => return,
                }
            }
        }
    }
}
