//! A private Postgres in a scratch folder; stopped on drop.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Time limit for starting and stopping.
const LIMIT: Duration = Duration::from_secs(30);

/// A Postgres.
#[derive(Debug)]
pub struct Postgres {
    programs: PathBuf,
    folder: PathBuf,
    port: u16,
    listen: &'static str,
    environment: Vec<(&'static str, String)>,
    child: Option<Child>,
}

impl Postgres {
    /// Creates and starts one in `folder`; `None`: Postgres is not installed, and the test is counted as skipped.
    ///
    /// # Panics
    /// It is installed but does not start.
    pub fn start(folder: &Path) -> Option<Self> {
        Self::start_in(&[], folder)
    }

    /// [`start`](Self::start) with more environment variables.
    ///
    /// # Panics
    /// It is installed but does not start.
    pub fn start_in(environment: &[(&'static str, String)], folder: &Path) -> Option<Self> {
        let Some(programs) = programs() else {
            crate::skip::skip("Postgres is not installed");
            return None;
        };
        let port = TcpListener::bind("127.0.0.1:0")
            .and_then(|listener| listener.local_addr())
            .expect("a port is free")
            .port();
        let folder = folder.join("postgres");
        std::fs::create_dir_all(&folder).expect("it can be made");
        let mut postgres = Self {
            programs,
            folder,
            port,
            listen: "127.0.0.1",
            environment: environment.to_vec(),
            child: None,
        };
        if rustix::process::geteuid().is_root() {
            // Postgres refuses to run as root, and its user needs access to the folder.
            let mut path = postgres.folder.clone();
            let owned = Command::new("chown").arg("-R").arg("postgres").arg(&path).status();
            assert!(
                owned.is_ok_and(|status| status.success()),
                "the folder can be given to Postgres"
            );
            while path.pop() && path.starts_with(std::env::temp_dir()) && path != std::env::temp_dir() {
                let opened = Command::new("chmod").arg("a+x").arg(&path).status();
                assert!(
                    opened.is_ok_and(|status| status.success()),
                    "the folder can be opened to Postgres"
                );
            }
        }
        let data = postgres.folder.join("data");
        let made = postgres
            .command("initdb")
            .args(["-A", "trust", "-U", "rotortwin", "--no-sync", "-D"])
            .arg(&data)
            .stdout(Stdio::null())
            .status();
        assert!(made.is_ok_and(|status| status.success()), "initdb works");
        postgres.up();
        Some(postgres)
    }

    fn command(&self, program: &str) -> Command {
        let program = self.programs.join(program);
        let mut command = if rustix::process::geteuid().is_root() {
            let mut command = Command::new("setpriv");
            command
                .args(["--reuid", "postgres", "--regid", "postgres", "--clear-groups", "--"])
                .arg(program);
            command
        } else {
            Command::new(program)
        };
        command.current_dir(&self.folder).stdin(Stdio::null());
        command
    }

    /// Starts it (again) and waits until it responds.
    ///
    /// # Panics
    /// It does not.
    pub fn up(&mut self) {
        let log = std::fs::File::create(self.folder.with_extension("log")).expect("a log");
        let data = self.folder.join("data");
        let child = self
            .command("postgres")
            .envs(self.environment.iter().map(|(name, value)| (name, value)))
            .arg("-D")
            .arg(&data)
            .args(["-p", &self.port.to_string(), "-h", self.listen, "-k", ""])
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .expect("it starts");
        self.child = Some(child);
        let begun = Instant::now();
        loop {
            let answers = self
                .command("pg_isready")
                .args([
                    "-q",
                    "-h",
                    "127.0.0.1",
                    "-p",
                    &self.port.to_string(),
                    "-U",
                    "rotortwin",
                    "-d",
                    "postgres",
                ])
                .status()
                .is_ok_and(|status| status.success());
            if answers {
                return;
            }
            assert!(
                begun.elapsed() < LIMIT,
                "Postgres does not answer: {}",
                std::fs::read_to_string(self.folder.with_extension("log")).unwrap_or_default()
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Kills all its processes with SIGKILL.
    ///
    /// # Panics
    /// The kernel refuses.
    pub fn kill(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        // Its helpers hold the shared memory; they cannot be identified once it is gone.
        let helpers = crate::process::Process::children(child.id());
        child.kill().expect("it can be killed");
        child.wait().expect("it can be waited for");
        for (helper, _) in &helpers {
            helper.signal(rustix::process::Signal::KILL);
        }
        crate::process::wait_until(LIMIT, || helpers.iter().all(|(helper, _)| !helper.is_alive()))
            .expect("its helpers end");
    }

    /// Makes it listen on all addresses of its host, and trust the hosts of a test.
    ///
    /// # Panics
    /// It does not start again.
    pub fn open_to_other_hosts(&mut self) {
        self.kill();
        let rules = self.folder.join("data/pg_hba.conf");
        let mut file = std::fs::OpenOptions::new()
            .append(true)
            .open(&rules)
            .expect("the rules are there");
        std::io::Write::write_all(&mut file, b"host all all 10.77.0.0/24 trust\n").expect("they can be changed");
        self.listen = "*";
        self.up();
    }

    /// The same for programs on another host.
    pub fn url_at(&self, address: &str) -> String {
        self.url().replace("127.0.0.1", address)
    }

    fn psql(&self) -> Command {
        let mut command = self.command("psql");
        command
            .args([
                "-h",
                "127.0.0.1",
                "-p",
                &self.port.to_string(),
                "-U",
                "rotortwin",
                "-d",
                "postgres",
            ])
            .args(["-q", "-A", "-t", "-v", "ON_ERROR_STOP=1"]);
        command
    }

    /// Result of a statement, as text.
    ///
    /// # Panics
    /// It fails.
    pub fn ask(&self, statement: &str) -> String {
        self.try_ask(statement).unwrap_or_else(|said| panic!("{said}"))
    }

    /// [`ask`](Self::ask) for one that may be down.
    ///
    /// # Errors
    /// The error message.
    ///
    /// # Panics
    /// There is no psql.
    pub fn try_ask(&self, statement: &str) -> Result<String, String> {
        let output = self.psql().args(["-c", statement]).output().expect("psql starts");
        if !output.status.success() {
            return Err(String::from_utf8_lossy(&output.stderr).into_owned());
        }
        Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    }

    /// Starts a transaction with a statement and goes silent, like a host that vanishes; its rows stay locked.
    ///
    /// # Panics
    /// It fails.
    pub fn hold(&self, statement: &str) -> Held {
        let mut child = self
            .psql()
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("psql starts");
        let text = format!("BEGIN;\n{statement};\nSELECT 'held';\n");
        let stdin = child.stdin.as_mut().expect("it is piped");
        stdin.write_all(text.as_bytes()).expect("it listens");
        let stdout = child.stdout.take().expect("it is piped");
        let mut lines = BufReader::new(stdout).lines();
        assert!(
            lines.any(|line| line.is_ok_and(|line| line.trim() == "held")),
            "{statement}"
        );
        Held(child)
    }

    /// Port it listens on.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// A connection for programs.
    pub fn url(&self) -> String {
        format!("postgres://rotortwin@127.0.0.1:{}/postgres", self.port)
    }
}

/// An open, silent transaction; rolled back on drop.
#[derive(Debug)]
pub struct Held(Child);

impl Drop for Held {
    fn drop(&mut self) {
        if let Err(error) = self.0.kill().and_then(|()| self.0.wait().map(|_| ())) {
            eprintln!("a session cannot be ended: {error}");
        }
    }
}

impl Drop for Postgres {
    fn drop(&mut self) {
        self.kill();
    }
}

/// The folder with `initdb`, in Debian's location or on the path.
fn programs() -> Option<PathBuf> {
    let debian = std::fs::read_dir("/usr/lib/postgresql")
        .into_iter()
        .flatten()
        .filter_map(Result::ok)
        .map(|entry| entry.path().join("bin"));
    let path = std::env::var_os("PATH").unwrap_or_default();
    debian
        .chain(std::env::split_paths(&path))
        .find(|folder| folder.join("initdb").is_file() && folder.join("postgres").is_file())
}
