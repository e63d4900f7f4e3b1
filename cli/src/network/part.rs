//! Arguments of `rotortwin part`: none; executed by `rotortwin-network`.

use clap::Parser;

/// Arguments of `rotortwin part`.
#[derive(Debug, Parser)]
pub struct Args {}
