//! The files of a shader for programs: its text in the language of each, and a host that draws it.

use super::languages;
use super::one_shader::OneShader;
use crate::base::choice::choice;
use crate::base::error::Result;
use serde_json::json;
use std::collections::BTreeMap;

choice! {
    "lowercase",
    /// A program that draws a shader.
    pub enum Program {
        /// three.js: GLSL ES 3.00 in a `ShaderMaterial`, WGSL in a node material.
        Three,
        /// Godot 4: an include of its shading language, and a project.
        Godot,
        /// Direct3D, Unity, Unreal: HLSL.
        Hlsl,
    }
}

/// Name and text of a file.
type Host = (&'static str, &'static str);

macro_rules! hosts {
    ($folder:literal: $($name:literal),+) => { [$(($name, include_str!(concat!($folder, "/", $name)))),+] };
}

const THREE: [Host; 6] =
    hosts!("three": "package.json", "index.html", "page.js", "cloud.js", "cloud-webgl.js", "cloud-webgpu.js");

const GODOT: [Host; 6] =
    hosts!("godot": "project.godot", "main.tscn", "main.gd", "cloud.gd", "cloud.gdshader", "picture.gdshader");

const HLSL: [Host; 4] = hosts!("hlsl": "picture.hlsl", "Cloud.shader", "Cloud.cs", "README.md");

impl Program {
    /// Its files by name, beside what [`OneShader::write`] writes itself.
    pub fn files(self, shader: &OneShader) -> Result<BTreeMap<String, Vec<u8>>> {
        let (host, texts): (&[Host], Vec<(&str, String)>) = match self {
            Self::Three => {
                let (functions, entry, parameters) = languages::wgsl_node(shader)?;
                let parameters = serde_json::to_string_pretty(&json!({ "parameters": parameters }))
                    .expect("parameters are JSON")
                    + "\n";
                let texts = vec![
                    ("cloud.glsl", languages::glsl(shader)?),
                    ("cloud.wgsl", functions),
                    ("cloud-entry.wgsl", entry),
                    ("parameters.json", parameters),
                ];
                (&THREE, texts)
            }
            Self::Godot => (&GODOT, vec![("cloud.gdshaderinc", languages::godot(shader)?.0)]),
            Self::Hlsl => {
                let texts = vec![
                    ("cloud.hlsl", languages::hlsl(shader)? + &languages::hlsl_rays(shader, false)?),
                    ("cloud.ush", languages::hlsl_function(shader)? + &languages::hlsl_rays(shader, true)?),
                ];
                (&HLSL, texts)
            }
        };
        let host = host.iter().map(|&(name, text)| (name.to_owned(), text.as_bytes().to_vec()));
        Ok(host.chain(texts.into_iter().map(|(name, text)| (name.to_owned(), text.into_bytes()))).collect())
    }
}
