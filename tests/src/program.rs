//! The program under test: how it is started, its output, and its files.

use crate::process::{Process, wait_until};
use crate::scratch::Scratch;
use rustix::process::Signal;
use serde_json::Value;
use std::ffi::OsString;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest wait for anything that should happen at once, or in seconds, on a machine where dozens of programs wait for two processors.
pub const PATIENCE: Duration = Duration::from_secs(180);

/// The program file. Cargo puts it next to the folder of the test programs.
pub fn program() -> PathBuf {
    let test = std::env::current_exe().expect("a process has a program file");
    let folder = test
        .parent()
        .and_then(Path::parent)
        .expect("test programs are in target/PROFILE/deps");
    let program = folder.join("rotortwin-under-test");
    assert!(
        program.is_file(),
        "{} is missing: run the tests with cargo test -p rotortwin-tests",
        program.display()
    );
    program
}

/// How plant, controller and FDI engine are connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Link {
    /// One process.
    InProcess,
    /// Shared memory.
    Iceoryx2,
    /// TCP.
    Zenoh,
}

impl Link {
    /// The links between processes.
    pub const BETWEEN_PROCESSES: [Self; 2] = [Self::Iceoryx2, Self::Zenoh];

    /// As on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::InProcess => "in-process",
            Self::Iceoryx2 => "iceoryx2",
            Self::Zenoh => "zenoh",
        }
    }
}

/// An invocation of the program.
#[derive(Debug)]
pub struct Call {
    command: Command,
    out: Option<PathBuf>,
}

impl Call {
    /// Any command; it runs in the folder of the test.
    pub fn new<A: Into<OsString>>(scratch: &Scratch, args: impl IntoIterator<Item = A>) -> Self {
        let mut command = Command::new(program());
        command
            .args(args.into_iter().map(Into::into))
            .current_dir(scratch.folder());
        Self { command, out: None }
    }

    /// `fly`, with its run folder at `name` in the folder of the test.
    pub fn fly(scratch: &Scratch, link: Link, scenario: &Path, name: &str) -> Self {
        let out = scratch.path(name);
        let mut call = Self::new(scratch, ["fly".into(), scenario.as_os_str().to_owned()]);
        call.command.args(["--link", link.name(), "--out"]).arg(&out);
        if link == Link::Iceoryx2 {
            call.command.args(["--domain", scratch.domain()]);
        }
        call.out = Some(out);
        call
    }

    /// More arguments.
    #[must_use]
    pub fn with<A: Into<OsString>>(mut self, args: impl IntoIterator<Item = A>) -> Self {
        self.command.args(args.into_iter().map(Into::into));
        self
    }

    /// Runs as the user with this id, which requires the privilege to switch.
    #[must_use]
    pub fn as_user(mut self, id: u32) -> Self {
        use std::os::unix::process::CommandExt as _;
        self.command.uid(id).gid(id);
        self
    }

    /// Runs with this command prefix, e.g. on another of several [`hosts`](crate::hosts).
    #[must_use]
    pub fn behind(mut self, words: impl IntoIterator<Item = OsString>) -> Self {
        let mut words = words.into_iter();
        let Some(first) = words.next() else { return self };
        let mut command = Command::new(first);
        command
            .args(words)
            .arg(self.command.get_program())
            .args(self.command.get_args());
        if let Some(folder) = self.command.get_current_dir() {
            command.current_dir(folder);
        }
        self.command = command;
        self
    }

    /// Starts it.
    pub fn start(mut self) -> Run {
        self.command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = self.command.spawn().expect("the program starts");
        let mut stdout = child.stdout.take().expect("it is piped");
        let stderr = child.stderr.take().expect("it is piped");
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        let stdout = std::thread::spawn(move || {
            let mut text = String::new();
            stdout.read_to_string(&mut text).expect("the program prints UTF-8");
            text
        });
        let supervisor = Process::of_child(&child);
        Run {
            child,
            supervisor,
            lines,
            seen: Vec::new(),
            stdout: Some(stdout),
            out: self.out,
            members: Vec::new(),
        }
    }

    /// Starts it and waits for it to end.
    pub fn run(self) -> Ended {
        self.start().end(PATIENCE)
    }
}

/// A process of a run, named by its subcommand.
pub type MemberName = &'static str;

/// The running program.
#[derive(Debug)]
pub struct Run {
    child: Child,
    supervisor: Process,
    lines: Receiver<String>,
    seen: Vec<String>,
    stdout: Option<JoinHandle<String>>,
    out: Option<PathBuf>,
    /// Processes found, to be killed if the test fails.
    members: Vec<(MemberName, Process, Vec<String>)>,
}

/// Result of the ended program.
#[derive(Debug)]
pub struct Ended {
    /// Exit code; none if a signal ended it.
    pub code: Option<i32>,
    /// All of standard output.
    pub stdout: String,
    /// Lines of standard error.
    pub stderr: Vec<String>,
    /// The run folder, if any.
    pub out: Option<PathBuf>,
}

impl Run {
    /// The process started.
    pub fn supervisor(&self) -> Process {
        self.supervisor
    }

    /// The process of the run with this subcommand, once it exists: `sim`, `controller`, `fdi`, or `supervisor`.
    pub fn member(&mut self, name: MemberName) -> Process {
        if name == "supervisor" {
            return self.supervisor;
        }
        let deadline = Instant::now() + PATIENCE;
        loop {
            self.find_members();
            if let Some((_, process, _)) = self.members.iter().find(|(found, ..)| *found == name) {
                return *process;
            }
            if Instant::now() >= deadline {
                self.give_up(&format!("no process {name}"));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Arguments of a process of the run.
    pub fn member_args(&mut self, name: MemberName) -> Vec<String> {
        self.member(name);
        self.members
            .iter()
            .find(|(found, ..)| *found == name)
            .map(|(.., args)| args.clone())
            .unwrap_or_default()
    }

    /// All current processes of the run, the supervisor first.
    pub fn members(&mut self) -> Vec<Process> {
        self.find_members();
        std::iter::once(self.supervisor)
            .chain(self.members.iter().map(|(_, process, _)| *process))
            .collect()
    }

    fn find_members(&mut self) {
        for (process, args) in Process::children(self.supervisor.pid) {
            let subcommand = args.get(1).map_or("", String::as_str);
            let name = ["sim", "controller", "fdi"]
                .into_iter()
                .find(|name| *name == subcommand);
            if let Some(name) = name
                && self.members.iter().all(|(_, known, _)| *known != process)
            {
                self.members.push((name, process, args));
            }
        }
    }

    /// The first matching line of standard error after the last one returned.
    pub fn line(&mut self, fits: impl Fn(&str) -> bool) -> String {
        let deadline = Instant::now() + PATIENCE;
        loop {
            match self
                .lines
                .recv_timeout(deadline.saturating_duration_since(Instant::now()))
            {
                Ok(line) => {
                    self.seen.push(line.clone());
                    if fits(&line) {
                        return line;
                    }
                }
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                    self.give_up("the line that was waited for")
                }
            }
        }
    }

    /// True once the supervisor has ended.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().expect("it is our child").is_some()
    }

    /// Waits for the supervisor to end and collects its output.
    pub fn end(mut self, limit: Duration) -> Ended {
        if wait_until(limit, || self.has_ended()).is_none() {
            self.give_up(&format!("no end within {limit:?}"));
        }
        let code = self.child.wait().expect("it is our child").code();
        // Other processes of the run may hold the pipes slightly longer.
        while let Ok(line) = self.lines.recv_timeout(PATIENCE) {
            self.seen.push(line);
        }
        let stdout = self
            .stdout
            .take()
            .map(|reader| reader.join().expect("the reader does not panic"))
            .unwrap_or_default();
        Ended {
            code,
            stdout,
            stderr: std::mem::take(&mut self.seen),
            out: self.out.clone(),
        }
    }

    /// Fails the test with all available information.
    fn give_up(&mut self, what: &str) -> ! {
        self.seen.extend(self.lines.try_iter());
        let logs = self.out.as_deref().map(logs).unwrap_or_default();
        panic!("{what}; printed so far:\n{}\n{logs}", self.seen.join("\n"));
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        self.find_members();
        for process in self.members() {
            process.signal(Signal::KILL);
        }
        drop(self.child.wait());
    }
}

/// The logs in a run folder.
fn logs(out: &Path) -> String {
    let read = |name: &str| {
        std::fs::read_to_string(out.join(name))
            .map(|text| format!("{name}: {text}"))
            .unwrap_or_default()
    };
    ["sim.log", "controller.log", "fdi.log"].map(read).concat()
}

impl Ended {
    /// Fails the test unless the exit code is this one.
    #[track_caller]
    pub fn expect_code(self, code: i32) -> Self {
        let logs = self.out.as_deref().map(logs).unwrap_or_default();
        assert_eq!(
            self.code,
            Some(code),
            "printed:\n{}\n{}\n{logs}",
            self.stdout,
            self.stderr.join("\n")
        );
        self
    }

    /// The run folder.
    pub fn out(&self) -> &Path {
        self.out.as_deref().expect("only `fly` has a run folder")
    }

    /// `summary.json` of the run folder.
    #[track_caller]
    pub fn summary(&self) -> Value {
        read_json(&self.out().join("summary.json"))
    }

    /// The run hash in the summary.
    #[track_caller]
    pub fn run_hash(&self) -> String {
        text(&self.summary(), "/run_hash").to_owned()
    }
}

/// A JSON file.
#[track_caller]
pub fn read_json(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Text at a JSON pointer.
#[track_caller]
pub fn text<'a>(value: &'a Value, pointer: &str) -> &'a str {
    let found = value.pointer(pointer).and_then(Value::as_str);
    found.unwrap_or_else(|| panic!("no text at {pointer}: {value:.300}"))
}

/// Integer at a JSON pointer.
#[track_caller]
pub fn whole(value: &Value, pointer: &str) -> i64 {
    let found = value.pointer(pointer).and_then(Value::as_i64);
    found.unwrap_or_else(|| panic!("no whole number at {pointer}: {value:.300}"))
}

/// Number at a JSON pointer.
#[track_caller]
pub fn number(value: &Value, pointer: &str) -> f64 {
    let found = value.pointer(pointer).and_then(Value::as_f64);
    found.unwrap_or_else(|| panic!("no number at {pointer}: {value:.300}"))
}
