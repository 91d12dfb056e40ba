//! The shader of [`OneShader`] as programs read it: GLSL for three.js, WGSL for its node materials, Godot's language, HLSL.
//!
//! The texts are naga's, with three things changed that naga has no setting for: uniforms by name instead of blocks, names that a person reads,
//! and what a language forbids (said where it is done).

use super::manifest::Field;
use super::one_shader::{Block, OneShader};
use crate::base::error::{Error, Result};
use naga::{Expression, FunctionArgument, Handle, Module, ScalarKind, Statement, TypeInner};
use serde::Serialize;
use std::fmt::Write;

/// A uniform of its own, where a program knows no structs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// `cloud_march_steps`; of the suns' arrays `cloud_sun_way`, or `cloud_sun_way_0` where each is a parameter.
    pub name: String,
    /// `float`, `uint`, `vec2` or `vec3`.
    pub kind: &'static str,
    /// Its block, element and field in `cloud.json`.
    pub block: String,
    /// The element of the block.
    pub element: usize,
    /// The field.
    pub field: String,
}

/// The texture's name.
const TEXTURE: &str = "cloud_data";

/// A field as a language declares it: its name, its type's name in GLSL, and whether it fills a gap.
struct Member {
    name: String,
    kind: &'static str,
}

impl Member {
    fn is_padding(&self) -> bool {
        crate::gpu::layout::Field::is_padding(&self.name)
    }
}

fn members(module: &Module, block: &Block) -> Result<Vec<Member>> {
    let found = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some(block.kind.as_str()));
    let Some((_, naga::Type { inner: TypeInner::Struct { members, .. }, .. })) = found else {
        return Err(defect(&block.kind, "not there"));
    };
    let kind_of = |handle: Handle<naga::Type>| match module.types[handle].inner {
        TypeInner::Scalar(scalar) if scalar.kind == ScalarKind::Uint => Ok("uint"),
        TypeInner::Scalar(scalar) if scalar.kind == ScalarKind::Float => Ok("float"),
        TypeInner::Vector { size: naga::VectorSize::Bi, .. } => Ok("vec2"),
        TypeInner::Vector { size: naga::VectorSize::Tri, .. } => Ok("vec3"),
        ref other => Err(defect(&block.kind, &format!("a field that is {other:?}"))),
    };
    let of = |member: &naga::StructMember| {
        Ok(Member { name: member.name.clone().unwrap_or_default(), kind: kind_of(member.ty)? })
    };
    members.iter().map(of).collect()
}

fn defect(what: &str, found: &str) -> Error {
    Error::new(
        format!("shader: {what}"),
        found,
        "a struct of numbers and vectors of 2 and 3",
        "This is a defect of the program: report it with the scene file.",
    )
}

/// Naga's text in GLSL for WebGL 2, without its entry and what only a whole shader has; uniforms are structs with the names
/// `cloud_view` and so on, the texture is `cloud_data`.
pub fn glsl(shader: &OneShader) -> Result<String> {
    use naga::back::glsl;
    let module = &shader.module;
    let info = crate::graph::wgsl::validate(module)?;
    let options = glsl::Options {
        version: glsl::Version::Embedded { version: 300, is_webgl: true },
        writer_flags: glsl::WriterFlags::empty(),
        ..Default::default()
    };
    let stage = naga::ShaderStage::Fragment;
    let pipeline = glsl::PipelineOptions { shader_stage: stage, entry_point: "main".into(), multiview: None };
    let mut text = String::new();
    let checks = naga::proc::BoundsCheckPolicies::default();
    glsl::Writer::new(&mut text, module, &info, &options, &pipeline, checks)
        .and_then(|mut writer| writer.write())
        .map_err(|cause| defect("GLSL", &cause.to_string()))?;
    let mut body = String::new();
    for line in before(&text, "void main()")?.lines() {
        if line.starts_with("#version") || line.starts_with("precision") || line.starts_with("layout(location") {
            continue;
        }
        // `layout(std140) uniform Block { Struct name; };`
        match line.strip_prefix("layout(std140) uniform ").and_then(|rest| rest.split_once(" { ")) {
            Some((_, declaration)) => {
                let declaration = declaration.trim_end_matches("};").trim_end();
                writeln!(body, "uniform {declaration}").expect("writing to a string cannot fail");
            }
            None => writeln!(body, "{line}").expect("writing to a string cannot fail"),
        }
    }
    for block in &shader.manifest.blocks {
        body = body.replace(&format!("_group_0_binding_{}_fs", block.binding), &uniform_name(block));
    }
    Ok(body.replace("_group_1_binding_0_fs", "cloud_data"))
}

/// A block's name as a uniform.
fn uniform_name(block: &Block) -> String {
    format!("cloud_{}", block.name)
}

/// What lies before a mark in a text.
fn before<'a>(text: &'a str, mark: &str) -> Result<&'a str> {
    text.split_once(mark).map(|(before, _)| before).ok_or_else(|| defect(mark, "a text without it"))
}

/// Godot's shading language: the functions, with a uniform for each number. It has no structs as uniforms; each field is one of its own, and the
/// fields of the suns are arrays.
pub fn godot(shader: &OneShader) -> Result<(String, Vec<Parameter>)> {
    let mut text = glsl(shader)?;
    let mut parameters = Vec::new();
    for block in &shader.manifest.blocks {
        let name = uniform_name(block);
        let mut members = members(&shader.module, block)?;
        members.retain(|member| !member.is_padding());
        // A name that begins another one comes after it.
        members.sort_by_key(|member| std::cmp::Reverse(member.name.len()));
        let prefix = if block.count > 0 { "cloud_sun" } else { name.as_str() };
        let mut declared = String::new();
        for member in &members {
            let own = format!("{prefix}_{}", member.name);
            let size = if block.count > 0 { format!("[{}]", block.count) } else { String::new() };
            let read = match block.count {
                0 => text.contains(&format!("{name}.{}", member.name)),
                _ => text.contains(&format!("].{}", member.name)),
            };
            if !read {
                continue;
            }
            writeln!(declared, "uniform {} {own}{size};", member.kind).expect("writing to a string cannot fail");
            for element in 0..block.elements.len() {
                parameters.push(Parameter {
                    name: own.clone(),
                    kind: member.kind,
                    block: block.name.clone(),
                    element,
                    field: member.name.clone(),
                });
            }
            if block.count == 0 {
                text = text.replace(&format!("{name}.{}", member.name), &own);
            }
        }
        if block.count > 0 {
            text = of_elements(&text, &name, prefix);
        }
        // The declaration of the whole gives way to those of its fields.
        let whole = format!("uniform {} {name}", block.kind);
        let begin = text.find(&whole).ok_or_else(|| defect(&name, "a text without its uniform"))?;
        let end = begin + text[begin..].find('\n').unwrap_or(text.len() - begin);
        text.replace_range(begin..end, declared.trim_end());
    }
    let texture = "uniform highp sampler2D cloud_data;";
    let own = "uniform sampler2D cloud_data : filter_nearest, repeat_disable;";
    Ok((signed_shifts(&text.replace(texture, own)), parameters))
}

/// Godot shifts signed numbers by signed ones alone: `(name >> 16u)` as `(name >> 16)` where `name` is an `int` of the function.
fn signed_shifts(text: &str) -> String {
    let mut result = String::with_capacity(text.len());
    let mut signed: Vec<&str> = Vec::new();
    for line in text.lines() {
        if !line.starts_with([' ', '}']) {
            signed.clear();
        }
        for (at, _) in line.match_indices("int ") {
            let starts = line[..at].chars().next_back().is_none_or(|before| matches!(before, ' ' | '('));
            let rest = &line[at + "int ".len()..];
            let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            if starts && end > 0 {
                signed.push(&rest[..end]);
            }
        }
        let mut rest = line;
        while let Some(at) = [" >> ", " << "].iter().filter_map(|shift| rest.find(shift)).min() {
            let (left, right) = (&rest[..at], &rest[at + " >> ".len()..]);
            let begin = left.rfind(|c: char| !c.is_alphanumeric() && c != '_').map_or(0, |last| last + 1);
            let digits = right.find(|c: char| !c.is_ascii_digit()).unwrap_or(right.len());
            result += &rest[..at + " >> ".len()];
            rest = right;
            if signed.contains(&&left[begin..]) && digits > 0 && right[digits..].starts_with('u') {
                result += &right[..digits];
                rest = &right[digits + 1..];
            }
        }
        result += rest;
        result.push('\n');
    }
    result
}

/// `name[index].field` as `prefix_field[index]`.
fn of_elements(text: &str, name: &str, prefix: &str) -> String {
    let begin = format!("{name}[");
    let mut parts = text.split(&begin);
    let mut result = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        // Of the declaration, which has no field, nothing is changed.
        match part.split_once("].") {
            Some((index, rest)) if !index.contains('\n') => {
                let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
                let (field, rest) = rest.split_at(end);
                write!(result, "{prefix}_{field}[{index}]{rest}").expect("writing to a string cannot fail");
            }
            _ => {
                result += &begin;
                result += part;
            }
        }
    }
    result
}

/// HLSL of shader model 5 and above: the functions, uniforms in constant buffers `view_numbers` and so on, the texture `cloud_data`.
pub fn hlsl(shader: &OneShader) -> Result<String> {
    let text = hlsl_of(&shader.module)?;
    let texture = shader.module.global_variables.iter().find(|(_, variable)| is_texture(variable));
    let Some((_, variable)) = texture else { return Ok(text) };
    let name = variable.name.clone().unwrap_or_default();
    let own = format!("Texture2D<float4> {TEXTURE}");
    let text = text.replace(&format!("Texture2D<float4> {name} : register(t0, space1)"), &own);
    Ok(text.replace(&format!("{name}.Load("), &format!("{TEXTURE}.Load(")))
}

/// The same for programs that give a function nothing but its arguments: numbers are variables of the file that begin with those of the scene,
/// the texture is the last argument of every function that reads it.
pub fn hlsl_function(shader: &OneShader) -> Result<String> {
    let module = textures_as_arguments(&shader.module)?;
    let texture = module.global_variables.iter().find(|(_, variable)| is_texture(variable));
    let declared =
        texture.map(|(_, variable)| format!("Texture2D<float4> {}", variable.name.clone().unwrap_or_default()));
    let mut numbers = Vec::new();
    for block in &shader.manifest.blocks {
        let members = members(&module, block)?;
        let elements: Vec<String> = block.elements.iter().map(|fields| initialiser(&members, fields)).collect();
        let (name, size) = (variable_of(&module, block)?, block.count);
        numbers.push(match size {
            0 => format!("static {} {name} = {};", block.kind, elements[0]),
            _ => format!("static {} {name}[{size}] = {{ {} }};", block.kind, elements.join(", ")),
        });
    }
    let mut body = String::new();
    let mut numbers = numbers.into_iter();
    for line in hlsl_of(&module)?.lines() {
        if declared.as_ref().is_some_and(|declared| line.starts_with(declared.as_str())) {
            continue;
        }
        let line = if line.starts_with("cbuffer ") { numbers.next() } else { Some(line.to_owned()) };
        writeln!(body, "{}", line.ok_or_else(|| defect("HLSL", "more constant buffers than blocks"))?)
            .expect("writing to a string cannot fail");
    }
    Ok(body)
}

/// Functions of HLSL that take a ray of Blender's world, and with the texture as an argument one of Unreal's.
pub fn hlsl_rays(shader: &OneShader, is_function: bool) -> Result<String> {
    let frame = &shader.manifest.origin.camera;
    let composite = shader.manifest.blocks.iter().find(|block| block.name == "composite");
    let exposure = match composite {
        Some(block) => format!("{}.exposure", variable_of(&shader.module, block)?),
        None => "1.0".to_owned(),
    };
    let has_texture = shader.module.global_variables.iter().any(|(_, variable)| is_texture(variable));
    let (taken, given) = match (is_function, has_texture) {
        (false, _) => ("", ""),
        (true, true) => (", Texture2D<float4> data", ", data"),
        (true, false) => (", Texture2D<float4> data", ""),
    };
    let rows =
        frame.to_local.iter().flatten().map(|value| format!("{:?}", *value as f32)).collect::<Vec<_>>().join(", ");
    let unit = frame.unit as f32;
    let mut text = format!(
        "\n// Blender's world to the frame of the density, row by row, and metres of its unit of length.\n\
         static const float4x4 CLOUD_TO_LOCAL = {{ {rows} }};\n\
         static const float CLOUD_UNIT = {unit:?};\n\n\
         // Linear colour with alpha in it of a ray of Blender's world: metres, z up, a unit vector.\n\
         float4 cloud_from_blender(float3 place, float3 direction, float farthest{taken})\n{{\n\
         \x20   float3 origin = mul(CLOUD_TO_LOCAL, float4(place, 1.0)).xyz;\n\
         \x20   float3 way = mul(CLOUD_TO_LOCAL, float4(direction, 0.0)).xyz * CLOUD_UNIT;\n\
         \x20   rays_Pixel found = cloud(origin, way, direction, farthest / CLOUD_UNIT{given});\n\
         \x20   float3 through = found.transmittance;\n\
         \x20   return float4(found.radiance * {exposure}, 1.0 - (through.x + through.y + through.z) / 3.0);\n}}\n"
    );
    if is_function {
        text += "\n// The same of Unreal's: centimetres, x ahead, y to the right, z up.\n\
                 float4 cloud_from_unreal(float3 place, float3 direction, float farthest, Texture2D<float4> data)\n{\n\
                 \x20   float3 turned = float3(1.0, -1.0, 1.0);\n\
                 \x20   return cloud_from_blender(place * turned / 100.0, normalize(direction * turned), farthest / 100.0, data);\n}\n";
    }
    Ok(text)
}

/// `{ float3(..), 64u, .. }`, gaps included.
fn initialiser(members: &[Member], fields: &[Field]) -> String {
    let value = |member: &Member| {
        let values: Vec<String> = fields.iter().find(|field| field.name == member.name).map_or_else(
            || vec!["0".to_owned()],
            |field| {
                field
                    .values
                    .iter()
                    .map(|value| if field.kind == "u32" { format!("{value}u") } else { format!("{value:?}") })
                    .collect()
            },
        );
        match values.len() {
            1 => values.concat(),
            count => format!("float{count}({})", values.join(", ")),
        }
    };
    format!("{{ {} }}", members.iter().map(value).collect::<Vec<_>>().join(", "))
}

/// Naga's text without its entry, registers and what compilers do not agree on.
fn hlsl_of(module: &Module) -> Result<String> {
    use naga::back::hlsl;
    let info = crate::graph::wgsl::validate(module)?;
    let options = hlsl::Options { fake_missing_bindings: true, ..Default::default() };
    let pipeline = hlsl::PipelineOptions::default();
    let mut text = String::new();
    hlsl::Writer::new(&mut text, &options, &pipeline)
        .write(module, &info, None)
        .map_err(|cause| defect("HLSL", &cause.to_string()))?;
    let mut body = String::new();
    let mut is_input = false;
    for line in before(&text, "float4 main(")?.lines() {
        // The entry's own struct goes with the entry.
        is_input |= line.starts_with("struct FragmentInput_main");
        if is_input {
            is_input = line != "};";
            continue;
        }
        // A constant buffer must not have the name of what is in it; and an engine gives registers itself.
        match line.strip_prefix("cbuffer ").and_then(|rest| rest.split_once(" : register(")) {
            Some((name, rest)) => {
                let content = rest.split_once(") ").map_or(rest, |(_, content)| content);
                writeln!(body, "cbuffer {}_numbers {content}", name.split('_').next_back().unwrap_or(name))
            }
            None => match constant_struct(line) {
                Some(initialised) => writeln!(body, "{initialised}"),
                None => writeln!(body, "{line}"),
            },
        }
        .expect("writing to a string cannot fail");
    }
    // Compilers do not agree that a number is cast to an array.
    while let Some(begin) = body.find(" = (float[") {
        let rest = &body[begin + " = (float[".len()..];
        let Some((count, _)) = rest.split_once("])0") else { break };
        let zeros = vec!["0.0"; count.parse().unwrap_or(0)].join(", ");
        body = body.replace(&format!(" = (float[{count}])0"), &format!(" = {{{zeros}}}"));
    }
    Ok(body)
}

/// `static const T name = ConstructT(values);` with a list in place of the call, which a constant of a file may not have everywhere.
fn constant_struct(line: &str) -> Option<String> {
    let (declaration, call) = line.strip_prefix("static const ")?.split_once(" = Construct")?;
    let kind = declaration.split_once(' ')?.0;
    let values = call.strip_prefix(kind)?.strip_prefix('(')?.strip_suffix(");")?;
    Some(format!("static const {declaration} = {{ {values} }};"))
}

fn is_texture(variable: &naga::GlobalVariable) -> bool {
    variable.binding.is_some_and(|place| (place.group, place.binding) == (1, 0))
}

/// WGSL for the node materials of three.js: the functions, the one that a node calls, and its parameters after `raster` and, where there is a
/// texture, `data`. A node's function has no uniforms but its arguments, so it puts them into variables of the module; a texture cannot be put
/// there, so every function that reads it gets it.
pub fn wgsl_node(shader: &OneShader) -> Result<(String, String, Vec<Parameter>)> {
    let module = textures_as_arguments(&shader.module)?;
    let text =
        String::from_utf8_lossy(&crate::graph::wgsl::write(&module, crate::graph::wgsl::Language::Wgsl)?).into_owned();
    let text = before(&text, "@fragment")?;
    let (mut parameters, mut arguments, mut assignments) = (Vec::new(), String::new(), String::new());
    let mut body = String::new();
    for line in text.lines() {
        match line.split_once("var<uniform> ") {
            Some((_, declaration)) => writeln!(body, "var<private> {declaration}"),
            None if line.starts_with("@group(") || line.starts_with("var ") => Ok(()),
            None => writeln!(body, "{line}"),
        }
        .expect("writing to a string cannot fail");
    }
    for block in &shader.manifest.blocks {
        let members = members(&module, block)?;
        let mut elements = Vec::new();
        for element in 0..block.elements.len() {
            let mut values = Vec::new();
            for member in &members {
                if member.is_padding() {
                    values.push(if member.kind == "uint" { "0u" } else { "0.0" }.to_owned());
                    continue;
                }
                let name = match block.count {
                    0 => format!("cloud_{}_{}", block.name, member.name),
                    _ => format!("cloud_sun_{}_{element}", member.name),
                };
                let kind = match member.kind {
                    "uint" => "u32",
                    "float" => "f32",
                    "vec2" => "vec2<f32>",
                    _ => "vec3<f32>",
                };
                write!(arguments, ", {name}: {kind}").expect("writing to a string cannot fail");
                values.push(name.clone());
                parameters.push(Parameter {
                    name,
                    kind: member.kind,
                    block: block.name.clone(),
                    element,
                    field: member.name.clone(),
                });
            }
            elements.push(format!("{}({})", block.kind, values.join(", ")));
        }
        let variable = variable_of(&module, block)?;
        let value = match block.count {
            0 => elements.remove(0),
            count => format!("array<{}, {count}>({})", block.kind, elements.join(", ")),
        };
        writeln!(assignments, "    {variable} = {value};").expect("writing to a string cannot fail");
    }
    let has_texture = module.global_variables.iter().any(|(_, variable)| is_texture(variable));
    let (taken, given) = if has_texture { (", data: texture_2d<f32>", ", data") } else { ("", "") };
    let entry = format!(
        "fn cloud_picture(raster: vec2<f32>{taken}{arguments}) -> vec4<f32> {{\n{assignments}    return picture(raster{given});\n}}\n"
    );
    Ok((body, entry, parameters))
}

fn variable_of(module: &Module, block: &Block) -> Result<String> {
    let is_own = |place: naga::ResourceBinding| (place.group, place.binding) == (0, block.binding);
    let found = module.global_variables.iter().find(|(_, variable)| variable.binding.is_some_and(is_own));
    found.and_then(|(_, variable)| variable.name.clone()).ok_or_else(|| defect(&block.name, "no variable"))
}

/// The same module, in which every function that reads the texture, or calls one that does, has it as its last argument.
fn textures_as_arguments(module: &Module) -> Result<Module> {
    let mut module = module.clone();
    let Some((texture, kind)) = module
        .global_variables
        .iter()
        .find(|(_, variable)| is_texture(variable))
        .map(|(handle, variable)| (handle, variable.ty))
    else {
        return Ok(module);
    };
    let mut readers = Vec::new();
    // A function lies behind those that it calls.
    for (handle, function) in module.functions.iter_mut() {
        let reads =
            function.expressions.iter().any(|(_, expression)| *expression == Expression::GlobalVariable(texture));
        let calls = calls_any(&function.body, &readers);
        if !reads && !calls {
            continue;
        }
        let number = function.arguments.len() as u32;
        function.arguments.push(FunctionArgument { name: Some("data".into()), ty: kind, binding: None });
        for (_, expression) in function.expressions.iter_mut() {
            if *expression == Expression::GlobalVariable(texture) {
                *expression = Expression::FunctionArgument(number);
            }
        }
        if calls {
            let argument = function.expressions.append(Expression::FunctionArgument(number), naga::Span::default());
            hand_on(&mut function.body, &readers, argument);
        }
        readers.push(handle);
    }
    for entry in &mut module.entry_points {
        if calls_any(&entry.function.body, &readers) {
            let global = entry.function.expressions.append(Expression::GlobalVariable(texture), naga::Span::default());
            hand_on(&mut entry.function.body, &readers, global);
        }
    }
    Ok(module)
}

fn calls_any(block: &naga::Block, functions: &[Handle<naga::Function>]) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Call { function, .. } => functions.contains(function),
        Statement::Block(block) => calls_any(block, functions),
        Statement::If { accept, reject, .. } => calls_any(accept, functions) || calls_any(reject, functions),
        Statement::Switch { cases, .. } => cases.iter().any(|case| calls_any(&case.body, functions)),
        Statement::Loop { body, continuing, .. } => calls_any(body, functions) || calls_any(continuing, functions),
        _ => false,
    })
}

/// Gives calls of some functions one more argument.
fn hand_on(block: &mut naga::Block, functions: &[Handle<naga::Function>], argument: Handle<Expression>) {
    for statement in block.iter_mut() {
        match statement {
            Statement::Call { function, arguments, .. } if functions.contains(function) => arguments.push(argument),
            Statement::Block(block) => hand_on(block, functions, argument),
            Statement::If { accept, reject, .. } => {
                hand_on(accept, functions, argument);
                hand_on(reject, functions, argument);
            }
            Statement::Switch { cases, .. } => {
                cases.iter_mut().for_each(|case| hand_on(&mut case.body, functions, argument));
            }
            Statement::Loop { body, continuing, .. } => {
                hand_on(body, functions, argument);
                hand_on(continuing, functions, argument);
            }
            _ => {}
        }
    }
}
