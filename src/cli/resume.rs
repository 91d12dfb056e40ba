//! What commands say that go on with work which was begun before.

use crate::base::identity::Resume;

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
