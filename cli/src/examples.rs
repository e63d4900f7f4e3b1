//! Examples at the end of each command's help. A test parses every one of them.

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
  rotortwin judge runs/hover-1 verdicts.csv --name 'yaw rate'";

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
  rotortwin fdi-log runs/* --model f550 --truth fault_label --series windows.parquet
  rotortwin fdi-log today.ulg --model mine --healthy mon.ulg tue.ulg wed.ulg
  rotortwin fdi-log a.ulg b.bin --model mine@v3 --truth truth.csv --report judged.html";

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
  rotortwin query 'SELECT folder, max(true_roll_rad) FROM telemetry GROUP BY folder' runs
  rotortwin query 'SELECT * FROM campaign ORDER BY flight LIMIT 10' runs/campaign-detector-ideal --csv
  rotortwin query 'DESCRIBE shards' s3://bench/night-17";

pub(crate) const FIT: &str = "\
Examples:
  rotortwin fit thrust stand.csv --map time=1:s --map thrust=2:kg";

pub(crate) const VEHICLE: &str = "\
Examples:
  rotortwin vehicle from-log flight.bin --mass 1.5 --arm 0.25 --out mine.toml
  rotortwin vehicle from-log flight.ulg@35:65 --mass 1.5 --arm 0.25 --frame quad-x --held-out";

pub(crate) const BLIND: &str = "\
Examples:
  rotortwin blind --preset singles,pairs --n 200 --seed 7
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
  rotortwin controllers hover --controller own --controller external --within 0.3
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
  rotortwin train --out my-classifier.json --seeds 1";

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
  rotortwin completions bash > ~/.local/share/bash-completion/completions/rotortwin
  rotortwin completions zsh > ~/.zfunc/_rotortwin
  rotortwin completions fish > ~/.config/fish/completions/rotortwin.fish";

pub(crate) const MAN: &str = "\
Examples:
  rotortwin man model add | man -l -
  rotortwin man --out ~/.local/share/man/man1";

#[cfg(test)]
mod tests {
    use crate::Cli;
    use clap::{CommandFactory as _, Parser as _};

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
        examples(&Cli::command(), &mut found);
        assert!(found.len() > 30, "{found:?}");
        for line in found {
            // The shell's use of the output is not checked.
            let words = line.split(['|', '>']).next().unwrap_or_default().split_whitespace();
            if let Err(error) = Cli::try_parse_from(words) {
                panic!("{line}: {error}");
            }
        }
    }

    #[test]
    fn val_the_declarations_are_sound() {
        Cli::command().debug_assert();
    }

    /// The same option has the same name in every command; former names still work.
    #[test]
    fn val_one_name_for_one_thing() {
        for old in [
            &["campaign", "x.toml", "--threads", "2"][..],
            &["reproduce", "--threads", "2"],
            &["train", "--out", "x", "--threads", "2"],
            &["blind", "--vehicles", "a.toml,b.toml"],
            &["blind", "generate", "--vehicle", "a.toml", "--out", "x.parquet"],
            &["log", "show", "x.ulg", "--vehicle", "a.toml"],
            &["fdi-log", "x.ulg", "--vehicle", "a.toml"],
        ] {
            assert!(Cli::try_parse_from([&["rotortwin"], old].concat()).is_ok(), "{old:?}");
        }
        fn look(command: &clap::Command) {
            for argument in command.get_arguments().filter_map(clap::Arg::get_long) {
                assert!(
                    !["threads", "vehicle", "vehicles"].contains(&argument),
                    "{}",
                    command.get_name()
                );
            }
            command.get_subcommands().for_each(look);
        }
        look(&Cli::command());
    }
}
