//! Examples at the end of each command's help. A test parses every one of them, and demands that each command has some.
//!
//! Commands of the first level take theirs where they are declared. Those below them take theirs from [`BELOW`]: `runs`, `campaigns` and
//! `blind-benches` share one declaration, and the generator of `blind` is that of another program.

pub(crate) const FIRST: &str = "\
Examples:
  rotortwin fly reference-flight
  rotortwin diagnose flight.ulg --model f550
  rotortwin campaign detector-ideal
  rotortwin serve";

pub(crate) const FLY: &str = "\
Examples:
  rotortwin fly hover --seed 7
  rotortwin fly hover --set initial.state_of_charge=0.4
  rotortwin fly hover --pace real-time --mavlink udp:127.0.0.1:14550
  rotortwin fly hover --external controller
  rotortwin fly hover --model f550@v2 --out runs/mine
  rotortwin fly hover --server http://bench:8400";

pub(crate) const REPLAY: &str = "\
Examples:
  rotortwin replay runs/reference-flight-1";

pub(crate) const SHOW: &str = "\
Examples:
  rotortwin show runs/reference-flight-1
  rotortwin show runs/reference-flight-1 --json";

pub(crate) const JUDGE: &str = "\
Examples:
  rotortwin judge runs/hover-1 verdicts.csv --name yaw-rate
  rotortwin judge runs/hover-1 --classifier f550-improved";

pub(crate) const FEATURES: &str = "\
Examples:
  rotortwin features detector-realistic --limit 48 --out windows.parquet";

pub(crate) const EXPORT: &str = "\
Examples:
  rotortwin export runs/reference-flight-1 --format ulog --out flight.ulg";

pub(crate) const LOG: &str = "\
Examples:
  rotortwin log show flight.ulg
  rotortwin log import flight.ulg flight.bin --out logs --rate 100";

pub(crate) const FDI_LOG: &str = "\
Examples:
  rotortwin fdi-log flight.ulg --model f550
  rotortwin fdi-log runs/* --model f550 --truth fault_label --series all.csv
  rotortwin fdi-log today.ulg --model mine --healthy mon.ulg tue.ulg wed.ulg
  rotortwin fdi-log a.ulg --model mine@v3 --truth truth.csv --report judged.html";

pub(crate) const FLEET: &str = "\
Examples:
  rotortwin fleet add hexa-07 monday.ulg tuesday.ulg --model f550
  rotortwin fleet show hexa-07 --report hexa-07.html
  rotortwin fleet acknowledge hexa-07 --rotor 3 --by Meyer --note worn-edge
  rotortwin fleet reset hexa-07 --rotor 3 --by Meyer --note new-propeller";

pub(crate) const CHECK: &str = "\
Examples:
  rotortwin check windy-hover
  rotortwin check windy-hover --json";

pub(crate) const REPRODUCE: &str = "\
Examples:
  rotortwin reproduce --seeds 5
  rotortwin reproduce --table 6 --figure 14 --seeds 1";

pub(crate) const COMPARE: &str = "\
Examples:
  rotortwin compare flight.ulg --model f550
  rotortwin compare flight.ulg@35:65 --model f550@v0 f550 --out compared";

pub(crate) const DIAGNOSE: &str = "\
Examples:
  rotortwin diagnose flight.ulg --model f550 --out found
  rotortwin diagnose today.ulg --model f550 --baseline mon.ulg tue.ulg wed.ulg";

pub(crate) const VIBRATION: &str = "\
Examples:
  rotortwin vibration today.ulg --baseline mon.ulg tue.ulg wed.ulg
  rotortwin vibration flight.bbl --model f550";

pub(crate) const IMPROVE: &str = "\
Examples:
  rotortwin improve flight.ulg --held-out other.ulg --model f550 --yes";

pub(crate) const NEXT_FLIGHT: &str = "\
Examples:
  rotortwin next-flight --model f550 --between mass,air-density --out next.toml";

pub(crate) const EFFECTS: &str = "\
Examples:
  rotortwin effects
  rotortwin effects show rotor-drag
  rotortwin effects plot rotor-drag --model f550 --set drag_n_s_m=0.3
  rotortwin effects --effects my-effect.toml";

pub(crate) const MODEL: &str = "\
Examples:
  rotortwin model import f550
  rotortwin model add f550 rotor-drag drag_n_s_m=0.25
  rotortwin model add f550 --from found/diagnosis.json
  rotortwin model diff f550@v0 f550";

pub(crate) const CAMPAIGN: &str = "\
Examples:
  rotortwin campaign detector-ideal --jobs 4
  rotortwin campaign detector-ideal --flight 17
  rotortwin campaign wide-draw --hunt --budget 300
  rotortwin campaign wide-draw --shards 0..4 --out part-0
  rotortwin campaign merge wide-draw part-0 part-1 --out whole
  rotortwin campaign wide-draw --shards 0..4 --out s3://bench/night-17";

pub(crate) const QUERY: &str = "\
Examples:
  rotortwin query 'SELECT folder, max(true_roll_rad) FROM telemetry GROUP BY 1'
  rotortwin query 'SELECT * FROM campaign LIMIT 9' runs/campaign-octo-lag --csv
  rotortwin query 'DESCRIBE shards' s3://bench/night-17";

pub(crate) const FIT: &str = "\
Examples:
  rotortwin fit thrust stand.csv --map time=1:s --map thrust=2:kg";

pub(crate) const VEHICLE: &str = "\
Examples:
  rotortwin vehicle from-log flight.bin --mass 1.5 --arm 0.25 --out mine.toml
  rotortwin vehicle tolerances mine.toml mass=1% inertia=5% thrust=2%";

pub(crate) const BLIND: &str = "\
Examples:
  rotortwin blind --preset singles,pairs --count 200 --seed 7
  rotortwin blind --preset singles --cases 0..60 --out part-0
  rotortwin blind merge part-0 part-1 --out whole
  rotortwin blind generate --effect rotor-drag --out flight.parquet";

pub(crate) const BOARD: &str = "\
Examples:
  rotortwin board list
  rotortwin board doctor serial:/dev/ttyACM0
  rotortwin board measure qemu";

pub(crate) const CONFORM: &str = "\
Examples:
  rotortwin conform zenoh
  rotortwin conform serial:/dev/ttyUSB0@921600
  rotortwin conform virtual --json
  rotortwin conform plant:ardupilot:127.0.0.1:9002";

pub(crate) const CONTROLLERS: &str = "\
Examples:
  rotortwin controllers autopilot-hover --controller own --controller ardupilot
  rotortwin controllers hover --controller own --controller external --within 1
  rotortwin controllers --runs runs/hover-1 runs/hover-1-2";

pub(crate) const SPIN_TEST: &str = "\
Examples:
  rotortwin spin-test ardupilot
  rotortwin spin-test px4 --pilot none";

pub(crate) const SERVE: &str = "\
Examples:
  rotortwin serve
  rotortwin serve --listen 127.0.0.1:9000 --data /srv/rotortwin --workers 4
  rotortwin serve --executor ray=http://127.0.0.1:8265";

pub(crate) const RUNS: &str = "\
Examples:
  rotortwin runs list --server http://bench:8400
  rotortwin runs fetch ID --server http://bench:8400";

pub(crate) const TRAIN: &str = "\
Examples:
  rotortwin train --out my-classifier.json --seeds 1
  rotortwin train --networks 0..11 --out part-0
  rotortwin train --networks 11..21 --out part-1
  rotortwin train merge part-0 part-1 --out my-classifier.json";

pub(crate) const JOB: &str = "\
Examples:
  rotortwin job job.json";

pub(crate) const LIST: &str = "\
Examples:
  rotortwin list
  rotortwin list scenarios";

pub(crate) const NEW: &str = "\
Examples:
  rotortwin new scenario mine --from hover
  rotortwin new vehicle my-quad --from quad-x";

pub(crate) const COMPLETIONS: &str = "\
Examples:
  rotortwin completions bash > /etc/bash_completion.d/rotortwin
  rotortwin completions zsh > ~/.zfunc/_rotortwin
  rotortwin completions fish > ~/.config/fish/completions/rotortwin.fish";

pub(crate) const MAN: &str = "\
Examples:
  rotortwin man model add | man -l -
  rotortwin man --out ~/.local/share/man/man1";

/// Examples of commands that are not declared in this crate's list of commands, or share a declaration.
const BELOW: [(&str, &[&str]); 67] = [
    (
        "log import",
        &[
            "rotortwin log import flight.ulg flight.bin --out logs --rate 100",
            "rotortwin log import stand.csv --mapping mine.toml --model f550",
        ],
    ),
    (
        "log show",
        &[
            "rotortwin log show flight.ulg",
            "rotortwin log show flight.ulg@35:65 --json",
            "rotortwin log show runs/reference-flight-1 --take-truth",
        ],
    ),
    ("log map", &["rotortwin log map stand.csv --out mine.toml"]),
    (
        "log example",
        &[
            "rotortwin log example --effect rotor-drag --seed 7",
            "rotortwin log example --preset healthy --duration-s 120 --out logs",
        ],
    ),
    (
        "fleet add",
        &[
            "rotortwin fleet add hexa-07 monday.ulg tuesday.ulg --model f550",
            "rotortwin fleet add hexa-07 old.bin --model f550 --date 2026-01-31",
        ],
    ),
    (
        "fleet show",
        &[
            "rotortwin fleet show",
            "rotortwin fleet show hexa-07 --report hexa-07.html",
        ],
    ),
    (
        "fleet acknowledge",
        &["rotortwin fleet acknowledge hexa-07 --rotor 3 --by Meyer --note worn-edge"],
    ),
    (
        "fleet reset",
        &["rotortwin fleet reset hexa-07 --rotor 3 --by Meyer --note new-propeller"],
    ),
    (
        "fdi-service",
        &["rotortwin fdi-service --link zenoh:listen=tcp/127.0.0.1:7450 --model f550"],
    ),
    (
        "effects show",
        &[
            "rotortwin effects show rotor-drag",
            "rotortwin effects show my-effect --effects my-effect.toml",
        ],
    ),
    (
        "effects plot",
        &[
            "rotortwin effects plot rotor-drag",
            "rotortwin effects plot rotor-thrust-scale#3 --model f550 --flight hover",
        ],
    ),
    ("model list", &["rotortwin model list"]),
    (
        "model show",
        &["rotortwin model show f550", "rotortwin model show f550@v1 --json"],
    ),
    ("model log", &["rotortwin model log f550"]),
    (
        "model add",
        &[
            "rotortwin model add f550 rotor-drag drag_n_s_m=0.25±0.01",
            "rotortwin model add f550 --from found/diagnosis.json --pick 1",
        ],
    ),
    ("model undo", &["rotortwin model undo f550"]),
    ("model branch", &["rotortwin model branch f550@v2 windy"]),
    ("model diff", &["rotortwin model diff f550@v0 f550"]),
    ("model export", &["rotortwin model export f550@v2 --out f550-v2.toml"]),
    (
        "model detectors",
        &["rotortwin model detectors hover --model f550@v2 --flights 10"],
    ),
    ("model import", &["rotortwin model import my-quad.toml --name mine"]),
    (
        "campaign merge",
        &[
            "rotortwin campaign merge wide-draw part-0 part-1 --out whole",
            "rotortwin campaign merge wide-draw s3://bench/night-17 --out whole",
        ],
    ),
    (
        "fit thrust",
        &["rotortwin fit thrust stand.csv --map time=1:s --map thrust=2:kg"],
    ),
    (
        "fit battery",
        &["rotortwin fit battery discharge.csv --map voltage=2:V --map current=3:A"],
    ),
    (
        "fit lag",
        &["rotortwin fit lag steps.csv --map time=1:s --map thrust=2:-kg"],
    ),
    (
        "vehicle from-log",
        &[
            "rotortwin vehicle from-log flight.bin --mass 1.5 --arm 0.25 --out mine.toml",
            "rotortwin vehicle from-log a.ulg b.ulg --mass 1.5 --arm 0.25 --halves",
        ],
    ),
    (
        "vehicle tolerances",
        &[
            "rotortwin vehicle tolerances mine.toml mass=1% inertia=5% thrust=2%",
            "rotortwin vehicle tolerances mine.toml all=2% rotors=3% centre-of-mass=4mm",
        ],
    ),
    (
        "blind generate",
        &[
            "rotortwin blind generate --effect rotor-drag --out flight.parquet",
            "rotortwin blind generate --flight hover --out a.parquet --truth a.json",
        ],
    ),
    ("blind effects", &["rotortwin blind effects"]),
    ("blind merge", &["rotortwin blind merge part-0 part-1 --out whole"]),
    (
        "train merge",
        &["rotortwin train merge part-0 part-1 --out my-classifier.json"],
    ),
    ("board list", &["rotortwin board list"]),
    ("board info", &["rotortwin board info serial:/dev/ttyACM0"]),
    (
        "board doctor",
        &["rotortwin board doctor serial:/dev/ttyACM0 --duration-s 30"],
    ),
    (
        "board measure",
        &[
            "rotortwin board measure",
            "rotortwin board measure qemu --scenario hover --cost-limit 15000",
        ],
    ),
    ("board flash", &["rotortwin board flash target/firmware/pixhawk6c.px4"]),
    (
        "board boot-loader",
        &["rotortwin board boot-loader serial:/dev/ttyACM0"],
    ),
    (
        "router",
        &[
            "rotortwin router --listen tcp/10.0.0.1:7447",
            "rotortwin router --listen tls/0.0.0.0:7447 --zenoh-config router.toml",
        ],
    ),
    (
        "runs list",
        &[
            "rotortwin runs list --server http://bench:8400",
            "rotortwin runs list --status done --server http://bench:8400",
        ],
    ),
    ("runs get", &["rotortwin runs get ID --server http://bench:8400"]),
    ("runs events", &["rotortwin runs events ID --server http://bench:8400"]),
    ("runs cancel", &["rotortwin runs cancel ID --server http://bench:8400"]),
    ("runs delete", &["rotortwin runs delete ID --server http://bench:8400"]),
    (
        "runs fetch",
        &["rotortwin runs fetch ID --out fetched --server http://bench:8400"],
    ),
    (
        "campaigns",
        &[
            "rotortwin campaigns list --server http://bench:8400",
            "rotortwin campaigns fetch ID --server http://bench:8400",
        ],
    ),
    (
        "campaigns list",
        &[
            "rotortwin campaigns list --server http://bench:8400",
            "rotortwin campaigns list --status done --server http://bench:8400",
        ],
    ),
    (
        "campaigns get",
        &["rotortwin campaigns get ID --server http://bench:8400"],
    ),
    (
        "campaigns events",
        &["rotortwin campaigns events ID --server http://bench:8400"],
    ),
    (
        "campaigns cancel",
        &["rotortwin campaigns cancel ID --server http://bench:8400"],
    ),
    (
        "campaigns delete",
        &["rotortwin campaigns delete ID --server http://bench:8400"],
    ),
    (
        "campaigns fetch",
        &["rotortwin campaigns fetch ID --out fetched --server http://bench:8400"],
    ),
    (
        "blind-benches",
        &[
            "rotortwin blind-benches list --server http://bench:8400",
            "rotortwin blind-benches fetch ID --server http://bench:8400",
        ],
    ),
    (
        "blind-benches list",
        &[
            "rotortwin blind-benches list --server http://bench:8400",
            "rotortwin blind-benches list --status done --server http://bench:8400",
        ],
    ),
    (
        "blind-benches get",
        &["rotortwin blind-benches get ID --server http://bench:8400"],
    ),
    (
        "blind-benches events",
        &["rotortwin blind-benches events ID --server http://bench:8400"],
    ),
    (
        "blind-benches cancel",
        &["rotortwin blind-benches cancel ID --server http://bench:8400"],
    ),
    (
        "blind-benches delete",
        &["rotortwin blind-benches delete ID --server http://bench:8400"],
    ),
    (
        "blind-benches fetch",
        &["rotortwin blind-benches fetch ID --out fetched --server http://bench:8400"],
    ),
    (
        "health",
        &[
            "rotortwin health http://127.0.0.1:8400/healthz",
            "rotortwin health worker:data",
        ],
    ),
    (
        "token",
        &[
            "rotortwin token create prometheus --scopes read",
            "rotortwin token list",
        ],
    ),
    (
        "token create",
        &[
            "rotortwin token create prometheus --scopes read --days 365",
            "rotortwin token create ci --tenant bench --data /srv/rotortwin",
        ],
    ),
    ("token list", &["rotortwin token list --data /srv/rotortwin"]),
    ("token revoke", &["rotortwin token revoke ID"]),
    (
        "worker",
        &[
            "rotortwin worker --workers 8 --database-url postgres://bench@db/rotortwin",
            "rotortwin worker --roles controller,fdi",
        ],
    ),
    ("config", &["rotortwin config"]),
    (
        "controller",
        &["rotortwin controller --link zenoh:connect=tcp/10.9.0.1:7447 --run-id c866f1e0"],
    ),
    (
        "fdi",
        &["rotortwin fdi --link zenoh:connect=tcp/10.9.0.1:7447 --run-id c866f1e0"],
    ),
];

/// The declarations with the examples of all commands.
pub(crate) fn added_to(root: clap::Command) -> clap::Command {
    with(root, "")
}

/// * `above`: path of `command` and a space; nothing for the root
fn with(command: clap::Command, above: &str) -> clap::Command {
    command.mut_subcommands(|below| {
        let path = format!("{above}{}", below.get_name());
        let below = with(below, &format!("{path} "));
        match BELOW.iter().find(|(name, _)| *name == path) {
            Some((_, lines)) => below.after_help(format!("Examples:\n  {}", lines.join("\n  "))),
            None => below,
        }
    })
}

#[cfg(test)]
mod tests {
    use crate::{command, parsed};
    use std::collections::BTreeMap;
    use std::ffi::OsString;

    /// Started by rotortwin and its schedulers, by nobody else: their command lines are written by programs.
    const NOT_FOR_PEOPLE: [&str; 2] = ["part", "sim"];

    fn accepted(line: &str) -> Result<(), String> {
        let words = line.split_whitespace().map(OsString::from);
        parsed(words).map(drop).map_err(|error| error.to_string())
    }

    fn examples(command: &clap::Command, found: &mut Vec<String>) {
        let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        found.extend(
            text.lines()
                .filter_map(|line| line.strip_prefix("  "))
                .map(str::to_owned),
        );
        for below in command.get_subcommands() {
            examples(below, found);
        }
    }

    #[test]
    fn val_every_example_is_a_command() {
        let mut found = Vec::new();
        examples(&command(), &mut found);
        assert!(found.len() > 120, "{found:?}");
        for line in found {
            // The shell's use of the output is not checked.
            let typed = line.split(['|', '>']).next().unwrap_or_default();
            if let Err(error) = accepted(typed) {
                panic!("{line}: {error}");
            }
            // Two spaces stand before it.
            assert!(line.chars().count() <= 78, "wider than 80 columns: {line}");
        }
    }

    /// 66 of 100 commands had none.
    #[test]
    fn regress_every_command_has_examples_of_its_own() {
        fn look(command: &clap::Command, path: &str, without: &mut Vec<String>) {
            for below in command.get_subcommands() {
                let path = format!("{path} {}", below.get_name());
                let text = below.get_after_help().map(ToString::to_string).unwrap_or_default();
                let begins = format!("  {path}");
                let of_its_own = |line: &str| {
                    line.strip_prefix(&begins)
                        .is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
                };
                if !(text.starts_with("Examples:\n") && text.lines().any(of_its_own)) {
                    without.push(path.clone());
                }
                look(below, &path, without);
            }
        }
        let mut without = Vec::new();
        look(&command(), "rotortwin", &mut without);
        assert_eq!(without, NOT_FOR_PEOPLE.map(|name| format!("rotortwin {name}")));
    }

    #[test]
    fn val_every_entry_is_of_a_command() {
        let root = command();
        for (path, _) in super::BELOW {
            let found = path
                .split(' ')
                .try_fold(&root, |command, name| command.find_subcommand(name));
            assert!(found.is_some(), "{path}");
        }
    }

    #[test]
    fn val_the_declarations_are_sound() {
        command().debug_assert();
    }

    /// Names that options had before. Scripts use them.
    #[test]
    fn regress_former_names_of_options_still_work() {
        for old in [
            "campaign x.toml --threads 2",
            "reproduce --threads 2",
            "train --out x --threads 2",
            "blind --vehicles a.toml,b.toml",
            "blind generate --vehicle a.toml --out x.parquet",
            "log show x.ulg --vehicle a.toml",
            "fdi-log x.ulg --vehicle a.toml",
            "blind --n 3",
            "board doctor virtual --duration 3",
            "board measure virtual --duration 3 --limit 15000",
            "query x --rows 3 --time 3",
            "serve --query-time 3 --rate 100",
            "campaign x.toml --hunt --budget 30 --cases 2",
            "vehicle from-log x.ulg --mass 1 --arm 0.2 --held-out",
            "log import x.ulg --truth",
            "log show x.ulg --truth --json --flight",
            "fdi-log x.ulg --model f550 --json --flight",
        ] {
            assert_eq!(accepted(&format!("rotortwin {old}")), Ok(()), "{old}");
        }
    }

    /// Where an option takes different things in different commands, on purpose.
    const DIFFERENT: [(&str, &[&str], &str); 9] = [
        (
            "autopilot",
            &["NAME", "NAME=ADDRESS[,pilot=ADDR|none]"],
            "a server lists them by name, a flight picks one",
        ),
        (
            "controller",
            &["BOARD|AUTOPILOT", "WHO"],
            "'controllers' also takes ours and those that join",
        ),
        (
            "flight",
            &["NAME", "NUMBER"],
            "manoeuvres have names, the flights of a campaign numbers",
        ),
        ("from", &["FILE", "NAME"], "a diagnosis; what is copied"),
        ("listen", &["ADDRESS", "ENDPOINT"], "HTTP, zenoh"),
        (
            "model",
            &["MODEL", "VEHICLE"],
            "VEHICLE where there are no versions: a vehicle file or its name",
        ),
        ("out", &["DIR", "FILE", "NAME.toml"], "what the command writes"),
        (
            "truth",
            &["FILE", "FILE|COLUMN"],
            "logs of a simulator hold it in a column",
        ),
        (
            "write",
            &["BLADES.toml", "VEHICLE.toml"],
            "the document that gets what was fitted",
        ),
    ];

    /// An option takes the same kind of value in every command: a flag does not take a value elsewhere, and values have
    /// one name.
    #[test]
    fn regress_one_name_for_one_thing() {
        fn look(command: &clap::Command, found: &mut BTreeMap<String, BTreeMap<String, Vec<String>>>) {
            if NOT_FOR_PEOPLE.contains(&command.get_name()) {
                return;
            }
            for argument in command.get_arguments().filter(|argument| !argument.is_hide_set()) {
                let Some(long) = argument.get_long() else { continue };
                let value = if argument.get_action().takes_values() {
                    let names = argument.get_value_names().unwrap_or_default();
                    names.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
                } else {
                    "(flag)".to_owned()
                };
                let places = found.entry(long.to_owned()).or_default().entry(value).or_default();
                places.push(command.get_name().to_owned());
            }
            command.get_subcommands().for_each(|below| look(below, found));
        }
        let mut root = command();
        root.build();
        let mut found = BTreeMap::new();
        look(&root, &mut found);
        for former in [
            "threads",
            "vehicle",
            "vehicles",
            "n",
            "duration",
            "rows",
            "time",
            "query-time",
        ] {
            assert!(!found.contains_key(former), "{former}");
        }
        for (name, values) in &found {
            let allowed = DIFFERENT
                .iter()
                .find(|(known, ..)| known == name)
                .map(|(_, values, _)| *values);
            let are: Vec<&str> = values.keys().map(String::as_str).collect();
            match allowed {
                Some(allowed) => assert_eq!(are, allowed, "--{name}: {values:?}"),
                None => assert_eq!(are.len(), 1, "--{name}: {values:?}"),
            }
        }
        // Seconds, megabytes and counts, whatever the option.
        for (name, value) in [
            ("duration-s", "S"),
            ("time-limit", "S"),
            ("query-time-limit", "S"),
            ("memory", "MB"),
            ("job-memory", "MB"),
            ("jobs", "COUNT"),
            ("limit", "COUNT"),
            ("count", "COUNT"),
            ("seeds", "COUNT"),
            ("flights", "COUNT"),
            ("hunt-cases", "COUNT"),
            ("hunt-budget", "COUNT"),
        ] {
            assert_eq!(found[name].keys().collect::<Vec<_>>(), [value], "--{name}");
        }
    }
}
