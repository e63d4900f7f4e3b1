//! `rotortwin completions` and `rotortwin man`: generated from the same declarations as the help.

use crate::output;
use clap::Parser;
use clap_complete::Shell;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `rotortwin completions`.
#[derive(Debug, Parser)]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Arguments of `rotortwin man`.
#[derive(Debug, Parser)]
pub struct ManArgs {
    /// Command whose page is printed, such as fly or model add [default: the page of rotortwin]
    #[arg(conflicts_with = "out", value_name = "COMMAND")]
    command: Vec<String>,
    /// Write all pages into this folder instead, as rotortwin.1, rotortwin-fly.1, …
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Prints the completions of a shell.
pub(crate) fn completions(args: &CompletionsArgs) -> ExitCode {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut crate::command(), "rotortwin", &mut script);
    print!("{}", String::from_utf8_lossy(&script));
    ExitCode::SUCCESS
}

/// Prints a page, or writes all.
pub(crate) fn man(args: &ManArgs) -> ExitCode {
    if let Some(folder) = &args.out {
        return match write_pages(folder) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => output::failed(format!("{}: cannot be written: {error}", folder.display())),
        };
    }
    let mut root = crate::command();
    root.build();
    let mut command = &root;
    for word in &args.command {
        let Some(found) = command.find_subcommand(word) else {
            return output::bad_input(format!(
                "there is no command '{}'; 'rotortwin --help' lists them",
                args.command.join(" ")
            ));
        };
        command = found;
    }
    let mut page = Vec::new();
    if let Err(error) = clap_mangen::Man::new(command.clone()).render(&mut page) {
        return output::failed(error);
    }
    print!("{}", String::from_utf8_lossy(&page));
    ExitCode::SUCCESS
}

fn write_pages(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    clap_mangen::generate_to(crate::command(), folder)
}
