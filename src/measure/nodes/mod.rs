//! Every node in every mode against Cycles: values, errors, costs, random graphs.

pub mod constants;
pub mod costs;
pub mod drift;
pub mod folded_textures;
pub mod limits;
pub mod measurements;
pub mod node_releases;
pub mod random_graphs;
pub mod settings;
pub mod suite;
pub mod table;
