//! The program: reads the command line, calls the library, prints.

use std::process::ExitCode;

fn main() -> ExitCode {
    cloudparity::cli::run()
}
