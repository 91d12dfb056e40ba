//! What commands say that go on with work which was begun before, and that run an experiment.

use crate::base::identity::Resume;
use crate::measure::experiment::{Merge, Outcome, Settings, Shard};
use std::path::PathBuf;

/// Whose work is gone on with.
#[derive(clap::Args)]
pub(super) struct ResumeArguments {
    /// Go on with what another build of the program left (after an edit of a shader, say), instead of refusing it. Results name all
    /// builds that had part in them.
    #[arg(long)]
    mix_builds: bool,
}

impl ResumeArguments {
    /// The setting of the library.
    pub fn resume(&self) -> Resume {
        Resume { mix_builds: self.mix_builds, ..Resume::default() }
    }

    /// Whether the option was given.
    pub fn given(&self) -> bool {
        self.mix_builds
    }
}

/// How an experiment is run.
#[derive(clap::Args)]
pub(super) struct ExperimentArguments {
    #[command(flatten)]
    resume: ResumeArguments,
    /// Do only this part of the plan: 2/4 is the second of four. Shards work in one folder, each on a machine of its own where times are
    /// measured, or in folders of their own, which --merge brings together. The one that ends last sums up.
    #[arg(long, value_name = "NUMBER/COUNT", default_value = "1/1", hide_default_value = true)]
    shard: Shard,
    /// First take over the records of these folders, in which shards of the same plan worked. Records of another build, of another
    /// plan, or that were edited, are refused.
    #[arg(long, value_name = "DIR", num_args = 1..)]
    merge: Vec<PathBuf>,
    /// Do no job: sum up what --merge brings together. A record that none of the folders has is an error that names its shard.
    #[arg(long, requires = "merge", conflicts_with = "shard")]
    only_merge: bool,
}

impl ExperimentArguments {
    /// The settings of the library.
    pub fn settings(&self) -> Settings {
        let merge = Merge { from: self.merge.clone(), only: self.only_merge };
        Settings { resume: self.resume.resume(), shard: self.shard, merge }
    }
}

/// The summary; where other shards have not done their parts, none, and a note on stderr.
pub(super) fn whole<S>(outcome: Outcome<S>) -> Option<S> {
    match outcome {
        Outcome::All(summary) => Some(summary),
        Outcome::Part { done, of } => {
            eprintln!("{done} of {of} records are there; the shard that makes the last one sums up");
            None
        }
    }
}
