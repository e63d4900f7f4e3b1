//! Paths that commands write to are those of this machine: `s3://BUCKET/PREFIX`, taken for a folder, would be made here as `s3:/BUCKET/PREFIX`.

use clap::builder::{PathBufValueParser, TypedValueParser as _};
use clap::{Arg, Command};
use std::any::TypeId;
use std::path::PathBuf;

/// Arguments that name what a command writes: a folder, a file, the folder of the models, that of a server.
const WRITTEN: [&str; 6] = ["out", "models", "data", "report", "series", "save_classifier"];

/// The declarations, with addresses of buckets refused where nothing is written to one.
pub(crate) fn checked(root: Command) -> Command {
    root.mut_args(|argument| of_argument(argument, local))
        .mut_subcommands(|below| match below.get_name() {
            "campaign" => campaign(below),
            _ => checked(below),
        })
}

/// `campaign --shards` and `campaign merge` write to a bucket as well, and say themselves what they need for it.
fn campaign(command: Command) -> Command {
    command
        .mut_args(|argument| of_argument(argument, local_or_in_a_bucket))
        .mut_subcommands(campaign)
}

fn of_argument(argument: Arg, check: fn(PathBuf) -> Result<PathBuf, String>) -> Arg {
    let is_path = argument.get_value_parser().type_id() == TypeId::of::<PathBuf>();
    if is_path && WRITTEN.contains(&argument.get_id().as_str()) {
        return argument.value_parser(PathBufValueParser::new().try_map(check));
    }
    argument
}

fn local(path: PathBuf) -> Result<PathBuf, String> {
    match scheme(&path) {
        None => Ok(path),
        Some(_) => Err("this is written to this machine only; expected the path of a folder or file".to_owned()),
    }
}

fn local_or_in_a_bucket(path: PathBuf) -> Result<PathBuf, String> {
    match scheme(&path) {
        None | Some("s3") => Ok(path),
        Some(_) => Err("expected a folder of this machine, or s3://BUCKET/PREFIX".to_owned()),
    }
}

/// `s3` of `s3://BUCKET`; `./s3://BUCKET` is a path.
fn scheme(path: &std::path::Path) -> Option<&str> {
    let (scheme, _) = path.to_str()?.split_once("://")?;
    let is_one = scheme.starts_with(|first: char| first.is_ascii_alphabetic())
        && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    is_one.then_some(scheme)
}

#[cfg(test)]
mod tests {
    use crate::{command, parsed};
    use std::ffi::OsString;

    fn refusal(line: &str) -> String {
        let words = line.split_whitespace().map(OsString::from);
        parsed(words)
            .map(drop)
            .map_or_else(|error| error.to_string(), |()| String::new())
    }

    #[test]
    fn val_addresses_are_refused_where_a_path_is_written() {
        for line in [
            "rotortwin blind --cases 0..4 --out s3://bench/night",
            "rotortwin blind --out=gs://bench/night",
            "rotortwin blind merge a b --out s3://bench/night",
            "rotortwin train --networks 0..4 --out s3://bench/night",
            "rotortwin train merge a b --out s3://bench/net.json",
            "rotortwin fly hover --out s3://bench/night",
            "rotortwin diagnose a.ulg --model f550 --models s3://bench/models",
            "rotortwin serve --data s3://bench/data",
        ] {
            let said = refusal(line);
            assert!(said.contains("written to this machine only"), "{line}: {said}");
        }
        let said = refusal("rotortwin campaign wide-draw --out gs://bench/night");
        assert!(said.contains("s3://BUCKET/PREFIX"), "{said}");
    }

    #[test]
    fn val_paths_and_buckets_of_campaigns_are_accepted() {
        for line in [
            "rotortwin campaign wide-draw --shards 0..4 --out s3://bench/night",
            "rotortwin campaign merge wide-draw s3://bench/night --out s3://bench/whole",
            "rotortwin blind --cases 0..4 --out ./s3://bench",
            "rotortwin serve --artifacts s3://bench/files",
        ] {
            assert_eq!(refusal(line), "", "{line}");
        }
    }

    /// Options `--out` of all commands, also of those that come later.
    #[test]
    fn val_every_out_is_looked_at() {
        fn look(command: &clap::Command, found: &mut Vec<String>) {
            for argument in command.get_arguments().filter(|argument| argument.get_id() == "out") {
                let parsed = argument.get_value_parser().type_id() == std::any::TypeId::of::<std::path::PathBuf>();
                assert!(parsed, "{}: --out is no path", command.get_name());
                found.push(command.get_name().to_owned());
            }
            for below in command.get_subcommands() {
                look(below, found);
            }
        }
        let mut found = Vec::new();
        look(&command(), &mut found);
        assert!(found.len() > 15, "{found:?}");
    }
}
