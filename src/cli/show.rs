//! `cloudparity show`: what there is.

use super::{completions, doctor, explain, lights, man, models, nodes, params, passes, schema};
use crate::base::error::Result;
use std::process::ExitCode;

/// Show what there is: what a scene evaluates, its parameters, nodes, engines, light models, this machine.
#[derive(clap::Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Explain(explain::Arguments),
    Params(params::Arguments),
    Models(models::Arguments),
    Lights(lights::Arguments),
    Passes(passes::Arguments),
    Nodes(nodes::Arguments),
    Schema(schema::Arguments),
    Doctor(doctor::Arguments),
    Completions(completions::Arguments),
    Man(man::Arguments),
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.what {
        What::Explain(arguments) => explain::run(arguments),
        What::Params(arguments) => params::run(arguments),
        What::Models(arguments) => models::run(arguments),
        What::Lights(arguments) => lights::run(arguments),
        What::Passes(arguments) => passes::run(arguments),
        What::Nodes(arguments) => nodes::run(arguments),
        What::Schema(arguments) => schema::run(arguments),
        What::Doctor(arguments) => doctor::run(arguments),
        What::Completions(arguments) => completions::run(arguments),
        What::Man(arguments) => man::run(arguments),
    }
}
