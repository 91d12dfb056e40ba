//! Writing a program as WGSL.
