//! `cloudparity show completions`: what a shell needs to complete commands and options.

use crate::base::error::Result;
use clap_complete::Shell;
use std::process::ExitCode;

/// Print the completions of a shell.
#[derive(clap::Args)]
#[command(
    after_help = "Example: cloudparity completions bash > ~/.local/share/bash-completion/completions/cloudparity"
)]
pub(super) struct Arguments {
    /// The shell.
    #[arg(value_enum)]
    shell: Shell,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let mut all = super::command_line();
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut all, "cloudparity", &mut text);
    super::print(&String::from_utf8_lossy(&text))?;
    Ok(ExitCode::SUCCESS)
}
