//! Documentation pages that show the output of commands: the commands are run, and their output is compared with the
//! page.
//!
//! A page's `console` blocks hold lines that begin with `$ ` (a command) followed by its output. There `…` stands for
//! any text within a line, and alone on a line for any number of lines. A block is not run if the paragraph before it
//! contains [`NOT_RUN`].

use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{Call, Link, PATIENCE, program};
use rotortwin_tests::python::environment;
use rotortwin_tests::scratch::{Scratch, repository, shipped_scenario};
use rotortwin_tests::skip;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// Phrase in the paragraph before a block whose commands need hardware, another program or a certificate.
const NOT_RUN: &str = "not run by the tests";

/// Pages whose blocks are run, with the first command of each block that is not.
const START_PAGES: [(&str, &[&str]); 5] = [
    ("start-control.md", &[]),
    ("start-flight-test.md", &[]),
    // The test of the packages has the wheel and runs the example.
    ("start-fdi.md", &["pip install rotortwin-*.whl"]),
    (
        "start-operations.md",
        &[
            "rotortwin serve --listen 0.0.0.0:8443 --tls-cert chain.pem --tls-key key.pem",
            "deploy/secrets.sh && docker compose up --build -d",
        ],
    ),
    (
        "start-pixhawk.md",
        &[
            "rotortwin board list",
            "rotortwin fly autopilot-hover-quad --controller px4",
        ],
    ),
];

/// Other pages whose blocks are run, in a folder that has what a checkout has, with the first command of each block that is not.
const PAGES: [(&str, &[&str]); 7] = [
    (
        "hosts.md",
        &[
            "rotortwin fly config/scenarios/short-hover.toml --link zenoh --listen tcp/10.9.0.1:7447 --external controller,fdi",
            "rotortwin controller --link zenoh:connect=tcp/10.9.0.1:7447 --run-id c866f1e0f139e7fe &",
        ],
    ),
    (
        "own-controller.md",
        &[
            "cargo build --release -p rotortwin-controller --example pd_controller",
            "target/release/examples/pd_controller --link iceoryx2:default --run-id 106903600f155765",
            "rotortwin fly config/scenarios/motors-off.toml --external controller",
            "python3 -m venv venv && venv/bin/pip install eclipse-zenoh protobuf",
            "rotortwin replay runs/own",
        ],
    ),
    ("own-detector.md", &[]),
    ("scenarios.md", &[]),
    ("run-folder.md", &["pip install pandas pyarrow"]),
    ("foxglove.md", &[]),
    ("when-it-fails.md", &[]),
];

/// Folders of a checkout that these pages name.
const OF_A_CHECKOUT: [&str; 3] = ["config", "examples", "proto"];

/// A page whose commands need other programs: its tests are those of the programs.
const NEITHER: &str = "autopilots.md";

/// Longest page that counts as one: printed lines of 100 characters.
const LINES_OF_A_PAGE: usize = 100;

fn read(page: &str) -> String {
    std::fs::read_to_string(repository().join("docs").join(page)).unwrap_or_else(|error| panic!("docs/{page}: {error}"))
}

/// A command of a page, and the lines shown below it.
#[derive(Debug, PartialEq)]
struct Shown {
    line: usize,
    command: String,
    output: Vec<String>,
}

/// A `console` block.
#[derive(Debug)]
struct Block {
    is_run: bool,
    commands: Vec<Shown>,
}

fn blocks(page: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut paragraph = String::new();
    let mut is_inside = false;
    for (number, line) in page.lines().enumerate() {
        match (is_inside, line) {
            (false, "```console") => {
                is_inside = true;
                blocks.push(Block {
                    is_run: !paragraph.contains(NOT_RUN),
                    commands: Vec::new(),
                });
                paragraph.clear();
            }
            (true, "```") => is_inside = false,
            (true, _) => {
                let commands = &mut blocks.last_mut().expect("it has begun").commands;
                if let Some(command) = line.strip_prefix("$ ") {
                    commands.push(Shown {
                        line: number + 1,
                        command: command.to_owned(),
                        output: Vec::new(),
                    });
                } else {
                    let shown = commands.last_mut().expect("a block begins with a command");
                    shown.output.push(line.to_owned());
                }
            }
            (false, "") => {}
            (false, line) => {
                paragraph.push_str(line);
                paragraph.push(' ');
            }
        }
    }
    blocks
}

/// Ignores differences in column width.
fn words(line: &str) -> String {
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// True if a line matches the shown one, where `…` stands for any text.
fn fits(shown: &str, line: &str) -> bool {
    let (shown, line) = (words(shown), words(line));
    let parts: Vec<&str> = shown.split('…').map(str::trim).collect();
    let [first, .., last] = parts[..] else {
        return shown == line;
    };
    let Some(mut rest) = line.strip_prefix(first) else {
        return false;
    };
    for part in &parts[1..parts.len() - 1] {
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
    }
    rest.ends_with(last)
}

/// Shown lines that were not printed, or printed lines that are not shown.
fn difference(shown: &[String], printed: &str) -> Option<String> {
    let mut lines = printed.lines().filter(|line| !line.trim().is_empty());
    let mut is_gap = false;
    for expected in shown.iter().filter(|line| !line.trim().is_empty()) {
        if expected.trim() == "…" {
            is_gap = true;
            continue;
        }
        let found = if is_gap {
            lines.any(|line| fits(expected, line))
        } else {
            lines.next().is_some_and(|line| fits(expected, line))
        };
        if !found {
            return Some(format!("the page shows: {expected}\nprinted:\n{printed}"));
        }
        is_gap = false;
    }
    let more = lines.next().filter(|_| !is_gap)?;
    Some(format!("the page does not show: {more}\nprinted:\n{printed}"))
}

/// A command that was left running with `&`.
struct Background {
    shown: Shown,
    child: Child,
    file: PathBuf,
}

impl Background {
    fn printed(&self) -> String {
        std::fs::read_to_string(&self.file).expect("the shell has made it")
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Words that stand for values of a run, and what comes before them where they are printed.
const PRINTED: [(&str, &str); 2] = [("RUN_ID", "--run-id "), ("ENDPOINT", "zenoh:connect=")];

/// An empty folder in which a page is followed.
struct Reader {
    page: &'static str,
    scratch: Scratch,
    ports: BTreeMap<String, String>,
    background: Vec<Background>,
}

impl Reader {
    fn new(page: &'static str) -> Self {
        let scratch = Scratch::new();
        std::fs::create_dir(scratch.path(".bin")).expect("the folder is empty");
        std::os::unix::fs::symlink(program(), scratch.path(".bin/rotortwin")).expect("the folder is empty");
        Self {
            page,
            scratch,
            ports: BTreeMap::new(),
            background: Vec::new(),
        }
    }

    /// With the folders of a checkout that pages name.
    fn in_a_checkout(page: &'static str) -> Self {
        let reader = Self::new(page);
        for folder in OF_A_CHECKOUT {
            let link = reader.scratch.path(folder);
            std::os::unix::fs::symlink(repository().join(folder), link).expect("the folder is empty");
        }
        reader
    }

    /// Replaces the ports that the page names with free ones: another program may be using them.
    fn with_free_ports(&mut self, text: &str) -> String {
        const HOST: &str = "127.0.0.1:";
        let mut changed = String::new();
        let mut rest = text;
        while let Some(at) = rest.find(HOST) {
            let (before, after) = rest.split_at(at + HOST.len());
            let digits = after
                .find(|letter: char| !letter.is_ascii_digit())
                .unwrap_or(after.len());
            let (port, after) = after.split_at(digits);
            changed.push_str(before);
            changed.push_str(self.ports.entry(port.to_owned()).or_insert_with(|| {
                let listener = TcpListener::bind("127.0.0.1:0").expect("there is a free port");
                listener.local_addr().expect("it is bound").port().to_string()
            }));
            rest = after;
        }
        changed + rest
    }

    /// RUN_ID and ENDPOINT are what the last background command has printed.
    fn with_printed(&self, command: &str) -> String {
        let mut command = command.to_owned();
        for (word, before) in PRINTED {
            if !command.contains(word) {
                continue;
            }
            let last = self
                .background
                .last()
                .expect("a command before it runs in the background");
            let mut value = None;
            wait_until(PATIENCE, || {
                let printed = last.printed();
                value = printed
                    .split_once(before)
                    .and_then(|(_, rest)| rest.split_once(' '))
                    .map(|(value, _)| value.to_owned());
                value.is_some()
            });
            let value = value.unwrap_or_else(|| panic!("no '{before}' was printed: {}", last.printed()));
            command = command.replace(word, &value);
        }
        command
    }

    fn shell(&self, command: &str) -> Command {
        let path = std::env::var("PATH").unwrap_or_default();
        let mut shell = Command::new("sh");
        shell
            .args(["-c", command])
            .current_dir(self.scratch.folder())
            .env("PATH", format!("{}:{path}", self.scratch.path(".bin").display()))
            .env("HOME", self.scratch.folder())
            .env_remove("XDG_CACHE_HOME")
            .env_remove("XDG_CONFIG_HOME")
            .env_remove("ROTORTWIN_CONFIG")
            .stdin(Stdio::null());
        shell
    }

    fn follow(&mut self, shown: Shown) {
        let place = format!("docs/{}:{}: {}", self.page, shown.line, shown.command);
        let of_this_run = |line: String| PRINTED.iter().fold(line, |line, (word, _)| line.replace(word, "…"));
        let output = shown.output.iter().map(|line| of_this_run(self.with_free_ports(line)));
        let output = output.collect();
        let command = self.with_free_ports(&shown.command);
        let command = self.with_printed(&command);
        let shown = Shown { output, ..shown };
        if let Some(command) = command.strip_suffix(" &") {
            let file = self.scratch.path(&format!(".background-{}", shown.line));
            let said = File::create(&file).expect("the folder can be written");
            let child = self
                .shell(&format!("exec {command}"))
                .stdout(said.try_clone().expect("a file"))
                .stderr(said)
                .spawn();
            let begun = Background {
                child: child.expect("sh starts"),
                shown,
                file,
            };
            // The commands after it may need it.
            if let Some(first) = begun.shown.output.first() {
                let is_ready = wait_until(PATIENCE, || begun.printed().lines().any(|line| fits(first, line)));
                assert!(is_ready.is_some(), "{place}\n{}", begun.printed());
            }
            self.background.push(begun);
            return;
        }
        // On a line of its own: a command may end with a comment.
        let done = self.shell(&format!("( {command}\n) 2>&1")).output().expect("sh starts");
        let printed = String::from_utf8_lossy(&done.stdout);
        assert!(done.status.success(), "{place}\n{}: {printed}", done.status);
        if let Some(difference) = difference(&shown.output, &printed) {
            panic!("{place}\n{difference}");
        }
    }

    /// Checks that what runs in the background has printed what the page shows.
    fn end(self) {
        for each in &self.background {
            let is_shown = wait_until(PATIENCE, || difference(&each.shown.output, &each.printed()).is_none());
            let place = format!("docs/{}:{}", self.page, each.shown.line);
            assert!(
                is_shown.is_some(),
                "{place}\n{}",
                difference(&each.shown.output, &each.printed()).unwrap_or_default()
            );
        }
    }
}

/// Runs a start page from its first to its last command.
fn follow(page: &'static str) {
    if Command::new("curl").arg("--version").output().is_err() {
        skip(&format!("docs/{page}: expected curl"));
        return;
    }
    follow_as(Reader::new(page));
}

/// Runs one of the other pages.
fn follow_in_a_checkout(page: &'static str) {
    follow_as(Reader::in_a_checkout(page));
}

fn follow_as(mut reader: Reader) {
    let text = read(reader.page);
    for block in blocks(&text).into_iter().filter(|block| block.is_run) {
        for shown in block.commands {
            reader.follow(shown);
        }
    }
    reader.end();
}

#[test]
fn scenario_start_control() {
    follow("start-control.md");
}

#[test]
fn scenario_start_flight_test() {
    follow("start-flight-test.md");
}

#[test]
fn scenario_start_fdi() {
    follow("start-fdi.md");
}

#[test]
fn scenario_start_operations() {
    follow("start-operations.md");
}

#[test]
fn scenario_start_pixhawk() {
    follow("start-pixhawk.md");
}

/// The front page: the result table of the reference flight, and a hidden effect that is found.
#[test]
fn scenario_front_page() {
    assert_eq!(
        not_run(&read("../README.md")),
        [""; 0],
        "README.md: blocks that are {NOT_RUN}"
    );
    follow("../README.md");
}

#[test]
fn scenario_page_hosts() {
    follow_in_a_checkout("hosts.md");
}

#[test]
fn scenario_page_own_controller() {
    let Some(programs) = environment("python-zenoh", &["eclipse-zenoh>=1.10,<2", "protobuf>=5"]) else {
        return;
    };
    let reader = Reader::in_a_checkout("own-controller.md");
    let environment = programs.parent().expect("it is in the environment");
    let environment = environment.canonicalize().expect("it was made");
    std::os::unix::fs::symlink(environment, reader.scratch.path("venv")).expect("the folder is empty");
    follow_as(reader);
}

#[test]
fn scenario_page_own_detector() {
    follow_in_a_checkout("own-detector.md");
}

#[test]
fn scenario_page_scenarios() {
    follow_in_a_checkout("scenarios.md");
}

#[test]
fn scenario_page_run_folder() {
    follow_in_a_checkout("run-folder.md");
}

#[test]
fn scenario_page_foxglove() {
    follow_in_a_checkout("foxglove.md");
}

#[test]
fn scenario_page_when_it_fails() {
    follow_in_a_checkout("when-it-fails.md");
}

/// First commands of the blocks that no test runs.
fn not_run(page: &str) -> Vec<String> {
    let skipped = blocks(page).into_iter().filter(|block| !block.is_run);
    skipped.map(|block| block.commands[0].command.clone()).collect()
}

/// A new page with commands is followed, too, and says plainly what no test runs.
#[test]
fn val_each_page_with_commands_is_run() {
    let known: BTreeSet<&str> = START_PAGES
        .iter()
        .chain(&PAGES)
        .map(|(page, _)| *page)
        .chain([NEITHER])
        .collect();
    let mut found = BTreeSet::new();
    for file in std::fs::read_dir(repository().join("docs")).expect("it is there") {
        let name = file.expect("a file").file_name().to_string_lossy().into_owned();
        if name.ends_with(".md") && read(&name).lines().any(|line| line == "```console") {
            found.insert(name);
        }
    }
    let found: BTreeSet<&str> = found.iter().map(String::as_str).collect();
    assert_eq!(found, known, "pages with commands, and those that the tests know");
    for (page, expected) in PAGES {
        assert_eq!(not_run(&read(page)), expected, "docs/{page}: blocks that are {NOT_RUN}");
    }
}

/// Each fits on one page, is linked from both front doors, and says plainly what no test runs.
#[test]
fn val_start_pages_are_short_linked_and_run() {
    let root = repository();
    let front = std::fs::read_to_string(root.join("README.md")).expect("it is there");
    let index = read("README.md");
    for (page, not_run) in START_PAGES {
        let text = read(page);
        let lines: usize = text.lines().map(|line| line.chars().count().div_ceil(100).max(1)).sum();
        assert!(lines <= LINES_OF_A_PAGE, "docs/{page}: {lines} printed lines");
        assert!(
            front.contains(&format!("(docs/{page})")),
            "README.md: no link to docs/{page}"
        );
        assert!(
            index.contains(&format!("({page})")),
            "docs/README.md: no link to {page}"
        );
        assert_eq!(self::not_run(&text), not_run, "docs/{page}: blocks that are {NOT_RUN}");
    }
}

/// Limits that the front page states, as the program shows them.
#[test]
fn regress_limits_of_the_front_page() {
    let early = "fault=[{time_s=5.0, rotor=3, thrust_loss_percent=10.0}]";
    let opposite =
        "fault=[{time_s=20.0, rotor=2, thrust_loss_percent=10.0}, {time_s=20.0, rotor=5, thrust_loss_percent=10.0}]";
    let hover = [
        "fly",
        "hover",
        "--link",
        "in-process",
        "--set",
        "duration_s=30",
        "--set",
    ];
    let limits = [
        (
            "treats a fault in the first 10 s as vehicle bias. `fly` and `campaign` warn of that",
            [&hover[..], &[early]].concat(),
            0,
            &[
                "before the calibration of the detectors ends at 10 s",
                "Sequential detector healthy 0.0 %",
            ][..],
        ),
        (
            "Equal losses of opposite rotors at once cannot be distinguished from other such pairs",
            [&hover[..], &[opposite]].concat(),
            0,
            &["ambiguous: among rotors 1, 2, 3, 4, 5, 6"],
        ),
        (
            "listens on its own machine only until it has a certificate and a token",
            vec!["serve", "--listen", "0.0.0.0:0"],
            2,
            &["expected --tls-cert and --tls-key, or a loopback address"],
        ),
    ];
    let page = words(&std::fs::read_to_string(repository().join("README.md")).expect("it is there"));
    for (sentence, command, code, shown) in limits {
        assert!(page.contains(sentence), "README.md does not say: {sentence}");
        let scratch = Scratch::new();
        let ended = Call::new(&scratch, command).run().expect_code(code);
        let printed = words(&format!("{} {}", ended.stdout, ended.stderr.join(" ")));
        for line in shown {
            assert!(printed.contains(line), "{sentence}: expected '{line}' in {printed}");
        }
    }
}

/// Every run hash in the book belongs to a shipped scenario.
#[test]
fn regress_run_hashes_in_the_book() {
    /// Words of 32 hexadecimal digits that are not flight hashes: a job's id, the hash of no steps.
    const OTHERS: [(&str, &str); 2] = [
        ("server.md", "01a1fee40b57abece41e1490b5decc4b"),
        ("when-it-fails.md", "99aa06d3014798d86001c324468d497f"),
    ];
    let scratch = Scratch::new();
    let flown: BTreeSet<String> = ["short-hover", "hover", "reference-flight"]
        .map(|name| {
            let call = Call::fly(&scratch, Link::InProcess, &shipped_scenario(name), name);
            call.run().expect_code(0).run_hash()
        })
        .into();
    let mut stale = Vec::new();
    for file in std::fs::read_dir(repository().join("docs")).expect("it is there") {
        let path = file.expect("a file").path();
        if path.extension().is_none_or(|ending| ending != "md") {
            continue;
        }
        let name = path.file_name().expect("a file").to_string_lossy().into_owned();
        for word in read(&name).split(|letter: char| !letter.is_ascii_alphanumeric()) {
            let is_hash = word.len() == 32 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
            if is_hash && !flown.contains(word) && !OTHERS.contains(&(name.as_str(), word)) {
                stale.push(format!("docs/{name}: {word}"));
            }
        }
    }
    assert!(stale.is_empty(), "no flight of {flown:?}:\n{}", stale.join("\n"));
}

/// `a_{b,c}_N` → `a_b_1`, `a_b_2`, …, `a_c_6`.
fn expanded(name: &str, rotors: usize) -> Vec<String> {
    if let Some((before, rest)) = name.split_once('{') {
        let (choices, after) = rest.split_once('}').expect("a brace that opens closes");
        return choices
            .split(',')
            .flat_map(|choice| expanded(&format!("{before}{choice}{after}"), rotors))
            .collect();
    }
    match name.split_once("_N") {
        Some((before, after)) => (1..=rotors).map(|rotor| format!("{before}_{rotor}{after}")).collect(),
        None => vec![name.to_owned()],
    }
}

/// The page on the run folder gives the number of columns and names each.
#[test]
fn regress_columns_of_the_telemetry() {
    let scratch = Scratch::new();
    let call = Call::fly(&scratch, Link::InProcess, &shipped_scenario("short-hover"), "flown");
    let file = File::open(call.run().expect_code(0).out().join("telemetry.parquet")).expect("it was written");
    let telemetry = parquet::file::serialized_reader::SerializedFileReader::new(file).expect("it is Parquet");
    let schema = parquet::file::reader::FileReader::metadata(&telemetry)
        .file_metadata()
        .schema_descr();
    let page = read("run-folder.md");
    let sentence = format!("36000 rows and {} columns", schema.num_columns());
    assert!(page.contains(&sentence), "docs/run-folder.md: expected '{sentence}'");

    let (_, section) = page.split_once("## `telemetry.parquet`").expect("its section");
    let (section, _) = section.split_once("\n## ").unwrap_or((section, ""));
    let named: BTreeSet<String> = section
        .lines()
        .filter_map(|line| line.strip_prefix("| `")?.split(" | ").next())
        .flat_map(|cell| cell.split('`').step_by(2))
        .flat_map(|name| expanded(name, 6))
        .collect();
    let written: BTreeSet<String> = schema.columns().iter().map(|column| column.name().to_owned()).collect();
    assert_eq!(
        written.difference(&named).collect::<Vec<_>>(),
        [""; 0],
        "columns that the page does not name"
    );
    assert_eq!(
        named.difference(&written).collect::<Vec<_>>(),
        [""; 0],
        "columns that only the page names"
    );
}

/// The page on usual changes gives the number of files of its examples.
#[test]
fn regress_where_to_change() {
    let git = |words: &str| {
        let mut shell = Command::new("sh");
        shell.args(["-c", words]).current_dir(repository()).output()
    };
    if !git("git rev-parse --is-inside-work-tree").is_ok_and(|answer| answer.status.success()) {
        skip("docs/where-to-change.md: expected a checkout by git");
        return;
    }
    let page = read("where-to-change.md");
    let mut rows = 0;
    for row in page.lines().filter(|line| line.contains("| `git ")) {
        let cells: Vec<&str> = row.split(" | ").collect();
        let [what, count, _, command] = cells[..] else {
            panic!("expected four cells: {row}")
        };
        let command = command.trim_end_matches(" |").trim_matches('`');
        let listed = git(command).expect("sh starts");
        let files = String::from_utf8_lossy(&listed.stdout);
        assert_eq!(count, files.lines().count().to_string(), "{what}: {command}\n{files}");
        rows += 1;
    }
    assert_eq!(rows, 11, "rows with a command");
}

#[test]
fn val_shown_lines_are_compared_with_printed_ones() {
    let shown = |text: &str| text.lines().map(str::to_owned).collect::<Vec<_>>();
    let printed = "one\n\ntwo  2.5 s\nthree\n";
    for same in [
        "one\ntwo 2.5 s\nthree",
        "one\n…",
        "…\nthree",
        "one\ntwo … s\n…",
        "…\ntwo …\nthree",
    ] {
        assert_eq!(difference(&shown(same), printed), None, "{same}");
    }
    for other in [
        "one\ntwo 2.6 s\nthree",
        "one",
        "…\nfour\n…",
        "one\nthree",
        "…\nthree\ntwo …",
    ] {
        assert!(difference(&shown(other), printed).is_some(), "{other}");
    }
    let page = "text\n```console\n$ a b\nc\n$ d\n```\nThis is not run by the tests:\n\n```console\n$ e\n```\n";
    let found = blocks(page);
    assert_eq!((found[0].is_run, found[1].is_run), (true, false));
    assert_eq!((found[0].commands[0].line, found[0].commands[0].output.len()), (3, 1));
    assert_eq!((found[0].commands[1].command.as_str(), found.len()), ("d", 2));
}
