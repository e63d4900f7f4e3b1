//! A campaign on a Slurm cluster that loses a node.

use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{Call, program};
use rotortwin_tests::scratch::{Scratch, repository};
use rotortwin_tests::slurm::Slurm;
use std::time::Duration;

/// Longest wait for the array: the lost node is detected after 8 s; its task is queued again and flown by the other
/// node.
const PATIENCE: Duration = Duration::from_secs(300);

#[test]
fn scenario_an_array_survives_the_death_of_a_node() {
    let Some(mut slurm) = Slurm::start() else { return };
    let scratch = Scratch::new();
    scratch.write("hover.toml", rotortwin_tests::scratch::short_flight());
    let campaign = scratch.write(
        "c.toml",
        "name = 'c'\ndescription = 'on a cluster'\nscenario = 'hover.toml'\nseed = 5\nflights = 4096\n[set]\nduration_s = 30.0\n\
         [[axis]]\nname = 'loss'\nkey = 'fault[0].thrust_loss_percent'\nlog_uniform = [2.0, 30.0]\n",
    );
    // Under the name that the script calls.
    std::fs::create_dir_all(scratch.path("bin")).expect("a folder");
    std::os::unix::fs::symlink(program(), scratch.path("bin/rotortwin")).expect("a link");
    let path = format!(
        "{}:{}",
        scratch.path("bin").display(),
        std::env::var("PATH").unwrap_or_default()
    );
    let submitted = slurm
        .command(repository().join("deploy/slurm/campaign.sh"))
        .arg(&campaign)
        .arg(scratch.path("out"))
        .arg("32")
        .env("PATH", format!("{path}:/usr/sbin"))
        .output()
        .expect("the script runs");
    let said = String::from_utf8_lossy(&submitted.stdout).into_owned();
    assert!(
        submitted.status.success(),
        "{}",
        String::from_utf8_lossy(&submitted.stderr)
    );
    assert!(said.starts_with("4 tasks: job "), "{said}");

    let shard = |part: u32| {
        let folder = scratch.path(&format!("out/parts/{part}/shards"));
        std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some())
    };
    let on_first = || slurm.say("squeue", &["-h", "-t", "running", "-w", "n1", "-o", "%i"]);
    let flies = || !on_first().trim().is_empty() && (0..4).any(shard);
    assert!(
        wait_until(PATIENCE, flies).is_some(),
        "no task flies: {}\n{}",
        slurm.say("squeue", &[]),
        slurm.logs()
    );
    slurm.kill_node("n1");
    let whole = scratch.path("out/whole/summary.json");
    let ended = || slurm.say("squeue", &["-h"]).trim().is_empty() || whole.is_file();
    let log = |name: &str| std::fs::read_to_string(scratch.path("out").join(name)).unwrap_or_default();
    assert!(
        wait_until(PATIENCE, ended).is_some(),
        "{}\n{}",
        slurm.say("squeue", &[]),
        slurm.logs()
    );
    let there = wait_until(Duration::from_secs(60), || {
        whole.is_file() && slurm.say("squeue", &["-h"]).trim().is_empty()
    });
    assert!(there.is_some(), "no result: {}\n{}", log("merge.log"), slurm.logs());
    let again = slurm.logs().matches("requeue job").count();
    assert!(
        again >= 1,
        "no task was queued again, the node died too late:\n{}",
        slurm.logs()
    );

    Call::new(&scratch, ["campaign".into(), campaign.into_os_string()])
        .with(["--out".into(), scratch.path("one").into_os_string()])
        .start()
        .end(PATIENCE)
        .expect_code(0);
    for name in ["campaign.parquet", "campaign.csv", "summary.json", "report.html"] {
        let [one, other] =
            ["one", "out/whole"].map(|folder| std::fs::read(scratch.path(folder).join(name)).expect("it was written"));
        assert!(one == other, "{name} differs");
    }
}
