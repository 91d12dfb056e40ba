//! `cloudparity show man`: manual pages.

use crate::base::error::{Error, Result};
use crate::base::files;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write a manual page of every command.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity man -o ~/.local/share/man/man1")]
pub(super) struct Arguments {
    /// The folder for the pages.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let folder = &arguments.output;
    files::make_folder(folder, "a folder for the pages")?;
    let mut all = super::command_line();
    all.build();
    write(&all, "cloudparity", folder)?;
    Ok(ExitCode::SUCCESS)
}

/// The page of a command and those of its subcommands: `cloudparity-measure-study.1`.
fn write(command: &clap::Command, name: &str, folder: &std::path::Path) -> Result<()> {
    let mut page = Vec::new();
    let path = folder.join(format!("{name}.1"));
    clap_mangen::Man::new(command.clone().display_name(name.to_owned()))
        .title(name.to_uppercase())
        .render(&mut page)
        .map_err(|cause| Error::io(&path, "a manual page", &cause))?;
    files::write_atomically(&path, &page)?;
    super::print(&format!("{}\n", path.display()))?;
    for below in command.get_subcommands() {
        write(below, &format!("{name}-{}", below.get_name()), folder)?;
    }
    Ok(())
}
