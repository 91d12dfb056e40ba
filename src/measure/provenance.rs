//! What a result comes from besides its settings: the build and its compiler, the processor, the adapter, the packages that took part.

use crate::base::identity::{COMPILER, Identity};
use crate::bridge;
use crate::gpu::{Adapter, Gpu};
use crate::measure::timing::machine;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// Where a result comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The build that wrote it.
    pub build: Identity,
    /// The compiler of that build.
    pub compiler: String,
    /// Processor, operating system, threads.
    pub machine: String,
    /// The adapter and its driver, where one took part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<Adapter>,
    /// Versions of the Python packages by name; none where there is no Python.
    #[serde(default)]
    pub packages: IndexMap<String, String>,
}

impl Provenance {
    /// That of what this program does now.
    pub fn now(gpu: Option<&Gpu>) -> Self {
        Self {
            build: Identity::current().clone(),
            compiler: COMPILER.to_owned(),
            machine: machine(),
            adapter: gpu.map(|gpu| gpu.adapter().clone()),
            packages: bridge::package_versions(),
        }
    }

    /// In a line, for the metadata of figures.
    pub fn line(&self) -> String {
        let packages: Vec<String> = self.packages.iter().map(|(name, version)| format!("{name} {version}")).collect();
        let adapter = self.adapter.as_ref().map_or(String::new(), |one| format!("; {} ({})", one.name, one.driver));
        format!(
            "cloudparity {}, {}; {}{adapter}; {}",
            self.build.full(),
            self.compiler,
            self.machine,
            packages.join(", ")
        )
    }

    /// As names and values, for pages.
    pub fn facts(&self) -> Vec<(String, String)> {
        let mut facts = vec![
            ("cloudparity".to_owned(), self.build.full().to_owned()),
            ("Compiler".to_owned(), self.compiler.clone()),
            ("Machine".to_owned(), self.machine.clone()),
        ];
        facts.extend(
            self.adapter
                .iter()
                .map(|one| ("Adapter".to_owned(), format!("{} ({}, driver {})", one.name, one.backend, one.driver))),
        );
        facts.extend(self.packages.iter().map(|(name, version)| (name.clone(), version.clone())));
        facts
    }
}
