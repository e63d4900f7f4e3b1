//! A Slurm cluster of two nodes on this machine, in a scratch folder; stopped on drop.

use crate::process::wait_until;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

/// Time limit for starting.
const LIMIT: Duration = Duration::from_secs(60);
/// Names of the nodes.
pub const NODES: [&str; 2] = ["n1", "n2"];

/// A cluster.
#[derive(Debug)]
pub struct Slurm {
    folder: tempfile::TempDir,
    daemons: Vec<Child>,
    nodes: Vec<Option<Child>>,
}

impl Slurm {
    /// Creates and starts one; `None`: Slurm is not installed or not permitted, and the test is counted as skipped.
    ///
    /// # Panics
    /// It is installed but does not start.
    pub fn start() -> Option<Self> {
        if !rustix::process::geteuid().is_root() {
            crate::skip::skip("a Slurm cluster needs root");
            return None;
        }
        let programs = ["munged", "slurmctld", "slurmd", "sbatch"];
        if let Some(missing) = programs.into_iter().find(|program| !is_there(program)) {
            crate::skip::skip(&format!("Slurm is not installed ({missing})"));
            return None;
        }
        // Socket paths must be short.
        let folder = tempfile::Builder::new()
            .prefix("slurm-")
            .tempdir()
            .expect("a folder can be made");
        let mut slurm = Self {
            folder,
            daemons: Vec::new(),
            nodes: Vec::new(),
        };
        slurm.configure();
        let (socket, key) = (slurm.path("munge"), slurm.path("key"));
        let options = [
            format!("--socket={}", socket.display()),
            format!("--key-file={}", key.display()),
            format!("--pid-file={}", slurm.path("munged.pid").display()),
            format!("--log-file={}", slurm.path("munged.log").display()),
            format!("--seed-file={}", slurm.path("seed").display()),
        ];
        let munged = slurm.spawn("munged", &["--force", "--foreground"], &options);
        slurm.daemons.push(munged);
        assert!(wait_until(LIMIT, || socket.exists()).is_some(), "munged does not start");
        let controller = slurm.spawn("slurmctld", &["-D", "-c"], &[]);
        slurm.daemons.push(controller);
        for node in NODES {
            // In separate namespaces with everything that it starts, which end with it.
            let words = [
                "--pid",
                "--mount-proc",
                "--fork",
                "--kill-child",
                "slurmd",
                "-D",
                "-N",
                node,
            ];
            let daemon = slurm.spawn("unshare", &words, &[]);
            slurm.nodes.push(Some(daemon));
        }
        let idle = || slurm.say("sinfo", &["-h", "-t", "idle", "-o", "%D"]).trim() == "2";
        assert!(
            wait_until(LIMIT, idle).is_some(),
            "the nodes do not come up: {}",
            slurm.say("sinfo", &[])
        );
        Some(slurm)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn configure(&self) {
        let held: Vec<TcpListener> = (0..3)
            .map(|_| TcpListener::bind("127.0.0.1:0").expect("a port is free"))
            .collect();
        let port = |i: usize| held[i].local_addr().expect("it is bound").port();
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").expect("it has a name");
        let host = host.trim().split('.').next().unwrap_or_default().to_owned();
        let folder = self.folder.path().display();
        let nodes: String = NODES
            .iter()
            .enumerate()
            .map(|(i, node)| {
                format!(
                    "NodeName={node} NodeHostName={host} NodeAddr=127.0.0.1 Port={} CPUs=1\n",
                    port(i + 1)
                )
            })
            .collect();
        let text = format!(
            "ClusterName=test\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser=root\nSlurmdUser=root\nSlurmctldPort={}\n\
             AuthType=auth/munge\nAuthInfo=socket={folder}/munge,cred_expire=8\n\
             StateSaveLocation={folder}/state\nSlurmdSpoolDir={folder}/spool.%n\n\
             SlurmctldPidFile={folder}/controller.pid\nSlurmdPidFile={folder}/%n.pid\n\
             SlurmctldLogFile={folder}/controller.log\nSlurmdLogFile={folder}/%n.log\n\
             ProctrackType=proctrack/pgid\nTaskPlugin=task/none\nJobAcctGatherType=jobacct_gather/none\n\
             SelectType=select/cons_tres\nSelectTypeParameters=CR_Core\nSchedulerParameters=sched_interval=1\n\
             SlurmdTimeout=8\nReturnToService=2\nMailProg=/bin/true\n{nodes}\
             PartitionName=all Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP\n",
            port(0)
        );
        std::fs::create_dir_all(self.path("state")).expect("a folder");
        std::fs::write(self.path("slurm.conf"), text).expect("written");
        let key: Vec<u8> = (0..1024u32)
            .map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8)
            .collect();
        std::fs::write(self.path("key"), key).expect("written");
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o400);
        std::fs::set_permissions(self.path("key"), mode).expect("it is ours");
    }

    fn spawn(&self, program: &str, words: &[&str], more: &[String]) -> Child {
        let mut command = self.command(program);
        command.args(words).args(more).stdin(Stdio::null());
        let log = std::fs::File::options()
            .create(true)
            .append(true)
            .open(self.path("daemons.log"))
            .expect("a log");
        command.stdout(Stdio::null()).stderr(log);
        command.spawn().unwrap_or_else(|error| panic!("{program}: {error}"))
    }

    /// A command configured for this cluster.
    pub fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        let path = std::env::var("PATH").unwrap_or_default();
        command
            .env("PATH", format!("{path}:/usr/sbin:/sbin"))
            .env("SLURM_CONF", self.path("slurm.conf"));
        command
    }

    /// Output of a Slurm command.
    pub fn say(&self, program: &str, words: &[&str]) -> String {
        let output = self.command(program).args(words).output();
        output.map_or_else(
            |error| error.to_string(),
            |output: Output| String::from_utf8_lossy(&output.stdout).into_owned(),
        )
    }

    /// Kills the node, with everything that runs on it.
    ///
    /// # Panics
    /// It is dead already.
    pub fn kill_node(&mut self, node: &str) {
        let place = NODES
            .iter()
            .position(|name| *name == node)
            .expect("a node of the cluster");
        let mut daemon = self.nodes[place].take().expect("it lives");
        daemon.kill().expect("it can be killed");
        daemon.wait().expect("it is ours");
    }

    /// Logs of its daemons.
    pub fn logs(&self) -> String {
        let read = |name: &str| std::fs::read_to_string(self.path(name)).unwrap_or_default();
        ["controller.log", "n1.log", "n2.log", "daemons.log"].map(read).concat()
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        for child in self.nodes.iter_mut().flatten().chain(self.daemons.iter_mut().rev()) {
            // It may be gone already.
            drop(child.kill());
            drop(child.wait());
        }
    }
}

fn is_there(program: &str) -> bool {
    let path = std::env::var("PATH").unwrap_or_default();
    path.split(':')
        .chain(["/usr/sbin", "/sbin"])
        .any(|folder| Path::new(folder).join(program).is_file())
}
