//! `cloudparity explain`: what is left of a graph, what was left out, and why.

use crate::base::error::Result;
use crate::base::plain_text::one_line;
use crate::gpu::Gpu;
use crate::graph::{Operand, Program, closures};
use crate::measure::speed::leaving_out;
use crate::measure::speed::leaving_out::{KernelSize, LeavingOut};
use crate::scene::Scene;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Show the specialised graph: what is evaluated, what was left out, and why.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity explain CLOUD.scene.json")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// Change a stored value first.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Also measure the marching kernel: its size, time and picture against the generic one.
    #[arg(long)]
    kernels: bool,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load_with(&arguments.scene, &arguments.set)?;
    let program = Program::compile(&scene, &closures::targets(&scene)?)?;
    let kernels = if arguments.kernels {
        let gpu = Gpu::open();
        if let Err(error) = &gpu {
            eprintln!("left out: the adapter: {error}");
        }
        Some(leaving_out::measure(&scene, gpu.is_ok())?)
    } else {
        None
    };
    let text = if arguments.json {
        let mut document = document(&program);
        document["kernels"] = serde_json::to_value(&kernels).expect("JSON serialises");
        serde_json::to_string_pretty(&document).expect("JSON serialises") + "\n"
    } else {
        describe(&program) + &kernels.as_ref().map_or_else(String::new, describe_kernels)
    };
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// What leaving out is worth, as text.
fn describe_kernels(found: &LeavingOut) -> String {
    let left_out: Vec<String> = found.left_out.iter().map(ToString::to_string).collect();
    let left_out = if left_out.is_empty() { "nothing".to_owned() } else { left_out.join(", ") };
    let size = |kernel: &KernelSize| {
        format!("{} bytes of WGSL, {} SPIR-V instructions", kernel.wgsl_bytes, kernel.spirv_instructions)
    };
    let special = found.specialised.as_ref().map_or_else(|| "none: one exponential per ray".to_owned(), size);
    let mut text = format!(
        "The march leaves out: {left_out}\n  generic kernel: {}\n  specialised kernel: {special}\n",
        size(&found.generic)
    );
    for race in &found.races {
        text += &format!(
            "  {}: {:.2} ms instead of {:.2} ms, {:.2} times as fast; pictures {}\n",
            race.worker,
            1e3 * race.specialised_seconds,
            1e3 * race.generic_seconds,
            race.ratio,
            match race.largest_ulp {
                0 => "equal to the bit".to_owned(),
                ulp => format!("at most {ulp} ulp apart"),
            },
        );
    }
    text
}

/// The explanation as text.
pub(crate) fn describe(program: &Program) -> String {
    let mut text = String::new();
    // A node's name is the user's, and may hold line breaks and orders to a terminal.
    let line = |text: &mut String, parts: std::fmt::Arguments<'_>| {
        writeln!(text, "{}", one_line(&parts.to_string())).expect("writing to a string cannot fail");
    };
    line(&mut text, format_args!("Evaluated, in order ({} nodes):", program.instructions.len()));
    for instruction in &program.instructions {
        let inputs: Vec<String> = instruction.inputs.iter().map(|operand| name(program, operand)).collect();
        line(
            &mut text,
            format_args!(
                "  {} [{}{}] <- {}",
                instruction.label,
                instruction.node_type.label,
                instruction.mode.words().iter().fold(String::new(), |words, word| format!("{words} {word}")),
                inputs.join(", ")
            ),
        );
    }
    for output in &program.outputs {
        let operands: Vec<String> = output.operands.iter().map(|operand| name(program, operand)).collect();
        line(&mut text, format_args!("  {} = {}", output.name, operands.join(", ")));
    }
    line(&mut text, format_args!("Left out ({}):", program.notes.len()));
    for note in &program.notes {
        line(&mut text, format_args!("  {} [{}] {}: {}", note.node, note.node_type, note.action, note.reason));
    }
    text
}

fn document(program: &Program) -> serde_json::Value {
    let evaluated: Vec<_> = program
        .instructions
        .iter()
        .map(|instruction| {
            let inputs: Vec<String> = instruction.inputs.iter().map(|operand| name(program, operand)).collect();
            serde_json::json!({
                "node": instruction.label,
                "node_type": instruction.node_type.type_name,
                "mode": instruction.mode.words(),
                "inputs": inputs,
            })
        })
        .collect();
    serde_json::json!({"evaluated": evaluated, "left_out": program.notes})
}

/// A component in words: a number, a coordinate or the node that makes it.
fn name(program: &Program, operand: &Operand) -> String {
    match operand {
        Operand::Constant(value) => value.to_string(),
        Operand::Position(axis) => format!("position.{}", ["x", "y", "z"][*axis]),
        Operand::Attribute(number, axis) => format!("{}.{}", program.attributes[*number], ["x", "y", "z"][*axis]),
        Operand::Register(register) => {
            let maker = program
                .instructions
                .iter()
                .find(|instruction| {
                    (instruction.first_register..instruction.first_register + instruction.components())
                        .contains(register)
                })
                .expect("every register has an instruction");
            let mut component = register - maker.first_register;
            for (identifier, kind) in &maker.outputs {
                if component < kind.components() {
                    let axis = if kind.components() == 1 { "" } else { [".x", ".y", ".z"][component] };
                    return format!("{}.{identifier}{axis}", maker.label);
                }
                component -= kind.components();
            }
            unreachable!("the register lies within the instruction's components")
        }
    }
}
