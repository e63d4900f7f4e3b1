//! What `rotortwin part` is asked for: nothing on its command line; done by `rotortwin-network`.

use clap::Parser;

/// Arguments of `rotortwin part`.
#[derive(Debug, Parser)]
pub struct Args {}
