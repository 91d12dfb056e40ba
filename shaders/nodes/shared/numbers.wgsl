// Constants of a program in a buffer, so that a number that changes is no change of the kernel.

#define_import_path cloudparity::numbers

@group(1) @binding(1) var<storage, read> numbers: array<f32>;
