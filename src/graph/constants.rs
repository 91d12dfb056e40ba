//! Numbers that Rust and WGSL share: typed in Rust, handed to WGSL as a module of constants when a kernel is linked.

use std::fmt::Write;

/// A number for WGSL.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SharedNumber {
    /// `u32`.
    Unsigned(u32),
    /// `f32`.
    Float(f32),
}

/// A module of constants. A kernel that imports `path` reads them by the last part of it, `constants::NAME`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedConstants {
    /// Import path.
    pub path: &'static str,
    /// Names and numbers.
    pub numbers: &'static [(&'static str, SharedNumber)],
}

impl SharedConstants {
    /// The module's text.
    pub fn text(&self) -> String {
        let mut text = format!("#define_import_path {}\n\n", self.path);
        for (name, number) in self.numbers {
            let written = match number {
                SharedNumber::Unsigned(number) => writeln!(text, "const {name}: u32 = {number}u;"),
                // The shortest text that is this number again.
                SharedNumber::Float(number) => writeln!(text, "const {name}: f32 = {number:?}f;"),
            };
            written.expect("writing to a string cannot fail");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_read_the_numbers_as_they_are() {
        const CONSTANTS: SharedConstants = SharedConstants {
            path: "cloudparity::some::constants",
            numbers: &[
                ("SIDE", SharedNumber::Unsigned(32)),
                ("SMALL", SharedNumber::Float(1.0e-7)),
                ("WHOLE", SharedNumber::Float(3.0)),
            ],
        };
        const ENTRY: &str = "#import cloudparity::some::constants

            const CELLS = constants::SIDE * constants::SIDE;
            @group(0) @binding(0) var<storage, read_write> results: array<f32, constants::SIDE / 8u>;

            @compute @workgroup_size(1)
            fn main() { results[0] = f32(CELLS) * constants::SMALL + constants::WHOLE; }
        ";
        let mut linker = crate::graph::wgsl::Linker::bare();
        linker.add_constants(&CONSTANTS);
        let module = linker.link("test.wgsl", ENTRY).expect("the kernel links");
        let text = crate::graph::wgsl::write(&module, crate::graph::wgsl::Language::Wgsl).expect("WGSL");
        let text = String::from_utf8(text).expect("text");
        assert!(text.contains("array<f32, 4>"), "{text}");
        for (name, number) in [("SMALL", 1.0e-7_f32), ("WHOLE", 3.0)] {
            let written =
                text.split_once(&format!("const constants_{name}: f32 = ")).and_then(|(_, rest)| rest.split_once("f;"));
            let (written, _) = written.unwrap_or_else(|| panic!("{name}: {text}"));
            assert_eq!(written.parse::<f32>().map(f32::to_bits), Ok(number.to_bits()), "{name}: {written}");
        }
    }
}
