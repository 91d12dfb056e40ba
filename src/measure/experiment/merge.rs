//! Merging: the records of folders in which shards of one plan worked come together in one.
//!
//! Every record is read and its seal checked before it is taken; one of another build or another plan stops the merge. Files that belong to a
//! record (a picture, the replicas of a truth) bear its key at the beginning of their names, and come from the folder from which the
//! record comes. They are linked where the file system can, copied where not: whatever writes here writes a new file, so that
//! two names of one file never see each other's changes.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, Resume, listed};
use crate::base::ledger::{Found, LOCKS, Ledger, Purpose};
use crate::measure::experiment::shard::Shard;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};

/// Digits of a key at the beginning of a file's name.
const KEY_DIGITS: usize = 16;

/// Which folders' records are taken over before anything is done.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Merge {
    /// The folders; where two have a record of the same name, the first of them gives it.
    pub from: Vec<PathBuf>,
    /// Whether that is all: no job is done, and one without a record is an error.
    pub only: bool,
}

/// A job of a plan: the part of its record, and its key.
type Planned<'a> = (&'static str, &'a str);

/// A folder and the shards that worked in it.
pub(super) struct Source<'a>(&'a Path, Vec<Shard>);

/// Where a record of a source goes.
#[derive(PartialEq)]
enum Fate {
    /// Into the folder, in the place of what may be there.
    Taken,
    /// Nowhere: it is there, or another folder's is.
    Stays,
    /// Nowhere: another is there that was measured apart from it.
    Twice,
}

impl Merge {
    /// Refuses folders that are none, of another experiment, or of other builds than `resume` allows, before anything is written. A new
    /// folder is begun in the name of the build that began theirs, since keys hold it.
    pub(super) fn check(&self, folder: &Path, purpose: &Purpose, resume: &Resume) -> Result<()> {
        let mut first: Option<(&Path, Vec<Identity>)> = None;
        for from in &self.from {
            if is_same(from, folder) {
                return Err(Error::new(
                    from.display().to_string(),
                    "the folder into which others are merged",
                    "other folders than that of the results",
                    "Leave it out: what is there stays.",
                ));
            }
            let (builds, _) = purpose.read_mark(from)?;
            let mark = from.join(purpose.mark);
            resume.join(&mark.display().to_string(), &builds)?;
            match &first {
                Some((of, known)) if known[0] != builds[0] => return Err(begun_by_others(&mark, &builds, of, known)),
                Some(_) => {}
                None => first = Some((from, builds)),
            }
        }
        let Some((from, builds)) = first else { return Ok(()) };
        if folder.join(purpose.mark).exists() {
            let (known, _) = purpose.read_mark(folder)?;
            if known[0] != builds[0] {
                return Err(begun_by_others(&from.join(purpose.mark), &builds, folder, &known));
            }
            return Ok(());
        }
        files::make_folder(folder, "a folder for results")?;
        // Shards that begin together do so one after another.
        let _turn = files::Lock::wait(&folder.join(LOCKS), "mark")?;
        purpose.begin_as(folder, &builds)
    }

    /// Brings what the folders have into one; says which shards worked in each.
    pub(super) fn bring(
        &self,
        folder: &Path,
        purpose: &Purpose,
        ledger: &Ledger,
        plan: &[Planned<'_>],
    ) -> Result<Vec<Source<'_>>> {
        // One at a time, and not while a shard begins.
        let _turn = files::Lock::wait(&folder.join(LOCKS), "merge")?;
        let planned: HashSet<Planned<'_>> = plan.iter().copied().collect();
        let parts: HashSet<&str> = plan.iter().map(|(part, _)| *part).collect();
        let mut sources = Vec::with_capacity(self.from.len());
        for from in &self.from {
            let (builds, shards) = purpose.read_mark(from)?;
            let files = below(from)?;
            let mut fates: HashMap<String, Fate> = HashMap::new();
            let mut records = Vec::new();
            let mut twice = 0;
            for (part, name) in &files {
                let Some(key) = name.strip_suffix(".json").filter(|stem| is_key(stem)) else { continue };
                if parts.contains(part.as_str()) && !planned.contains(&(part.as_str(), key)) {
                    return Err(Error::new(
                        from.join(part).join(name).display().to_string(),
                        "a record that is none of this plan",
                        format!("records of the {} jobs of this plan alone", plan.len()),
                        "Merge folders of one plan: leave this one out, or take the file that its shards were run with.",
                    ));
                }
                let fate = self.fate(from, folder, ledger, &builds, part, key)?;
                if fate == Fate::Taken {
                    records.push((part, name));
                }
                twice += usize::from(fate == Fate::Twice);
                // A key in two parts is that of a job and of what belongs to it: one of them taken means all of them.
                let known = fates.entry(key.to_owned()).or_insert(Fate::Stays);
                if fate == Fate::Taken {
                    *known = Fate::Taken;
                }
            }
            // The records last: where one is, what belongs to it is there, too.
            for (part, name) in &files {
                let key = name.get(..KEY_DIGITS).filter(|key| is_key(key));
                let is_record = key.is_some_and(|key| name.strip_prefix(key) == Some(".json"));
                if is_record {
                    continue;
                }
                let to = folder.join(part).join(name);
                match key.and_then(|key| fates.get(key)) {
                    Some(Fate::Taken) => take(&from.join(part).join(name), &to)?,
                    Some(Fate::Stays | Fate::Twice) => {}
                    // Of work that has no record yet, such as the first replicas of a truth.
                    None if to.exists() => {}
                    None => take(&from.join(part).join(name), &to)?,
                }
            }
            for (part, name) in records {
                take(&from.join(part).join(name), &folder.join(part).join(name))?;
            }
            if twice > 0 {
                log::warn!(
                    "{twice} records of {} are in an earlier folder, too, made anew: those of the earlier are taken",
                    from.display()
                );
            }
            let shards = shards.iter().filter_map(|text| text.parse().ok()).collect();
            sources.push(Source(from, shards));
        }
        Ok(sources)
    }

    /// What becomes of a sound record; one that was edited, or that a build made which the folder does not name, is refused.
    fn fate(
        &self,
        from: &Path,
        folder: &Path,
        ledger: &Ledger,
        builds: &[Identity],
        part: &str,
        key: &str,
    ) -> Result<Fate> {
        let path = || from.join(part).join(format!("{key}.json"));
        let Some((build, found)) = ledger.look_at(from, part, key)? else { return Ok(Fate::Stays) };
        if !builds.contains(&build) {
            return Err(Error::new(
                path().display().to_string(),
                format!("a record of the build {build}"),
                format!("one of {}, which worked in its folder", listed(builds, ToString::to_string)),
                "Remove the file, and run its shard again.",
            ));
        }
        Ok(match (ledger.look_at(folder, part, key)?, found) {
            (None, _) | (Some((_, Found::LeftOut(_))), Found::Record(())) => Fate::Taken,
            (Some((_, Found::LeftOut(_))), Found::LeftOut(_)) => Fate::Stays,
            (Some((_, Found::Record(()))), Found::LeftOut(_)) => Fate::Stays,
            (Some((_, Found::Record(()))), Found::Record(())) => {
                let bytes = |folder: &Path| std::fs::read(folder.join(part).join(format!("{key}.json"))).ok();
                if bytes(from) == bytes(folder) { Fate::Stays } else { Fate::Twice }
            }
        })
    }

    /// Refuses a plan of which a job has no record, by the shard that was to make it.
    pub(super) fn nothing_missing(
        &self,
        ledger: &Ledger,
        plan: &[Planned<'_>],
        sources: &[Source<'_>],
        label: &dyn Fn(usize) -> String,
    ) -> Result<()> {
        let is_there = |(part, key): &Planned<'_>| ledger.file(part, key).is_some_and(|path| path.exists());
        let missing: Vec<usize> = (0..plan.len()).filter(|&position| !is_there(&plan[position])).collect();
        let Some(&first) = missing.first() else { return Ok(()) };
        let mut shards: Vec<String> = Vec::new();
        for Source(from, of_folder) in sources {
            for shard in of_folder {
                let lacks = missing.iter().filter(|&&position| shard.has(position)).count();
                let has = (0..plan.len()).filter(|&position| shard.has(position)).count();
                if lacks > 0 {
                    shards.push(format!("shard {shard} in {} lacks {lacks} of {has}", from.display()));
                }
            }
        }
        // Positions that no folder's shard has, by the count of most shards. One beyond the plan splits nothing.
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        for shard in sources.iter().flat_map(|Source(_, shards)| shards) {
            if (shard.count() as usize) <= plan.len() {
                *counts.entry(shard.count()).or_default() += 1;
            }
        }
        let count = counts.iter().max_by_key(|(_, often)| **often).map_or(1, |(count, _)| *count);
        let has = |position: usize| sources.iter().any(|Source(_, all)| all.iter().any(|shard| shard.has(position)));
        let lost = missing.iter().filter(|&&position| !has(position));
        let lost: BTreeSet<u32> = lost.map(|position| (*position as u64 % u64::from(count)) as u32 + 1).collect();
        if count > 1 {
            shards.extend(lost.iter().map(|number| format!("shard {number}/{count} is in none of the folders")));
        }
        let place = match shards.is_empty() {
            true => "the merged folders".to_owned(),
            false => shards.join("; "),
        };
        Err(Error::new(
            place,
            format!("{} of {} records; missing is first {}", plan.len() - missing.len(), plan.len(), label(first)),
            "a record of every job of the plan",
            "Run these shards again by the same command, each goes on where it stopped; and merge the folders of all shards.",
        ))
    }
}

fn begun_by_others(mark: &Path, builds: &[Identity], of: &Path, known: &[Identity]) -> Error {
    Error::new(
        mark.display().to_string(),
        format!("a folder that the build {} began", builds[0]),
        format!("one that {} began, as {}: its records are named by that build", known[0], of.display()),
        "Run its shard anew with that build.",
    )
}

/// Whether two paths are one folder; where one does not exist, they are not.
fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

fn is_key(text: &str) -> bool {
    text.len() == KEY_DIGITS && text.bytes().all(|byte| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte))
}

/// The files in the folders of a folder, as the path of the folder below it and the name: no locks, and nothing that was not finished. Those
/// directly in it are its mark and summaries, which are made anew.
fn below(from: &Path) -> Result<Vec<(String, String)>> {
    let mut found = Vec::new();
    let mut names = Vec::new();
    for entry in walk(from)? {
        if entry.1 && entry.0 != LOCKS {
            names.push(entry.0);
        }
    }
    while let Some(part) = names.pop() {
        for (name, is_folder) in walk(&from.join(&part))? {
            if is_folder {
                names.push(format!("{part}/{name}"));
            } else if !name.starts_with('.') {
                found.push((part.clone(), name));
            }
        }
    }
    found.sort_unstable();
    Ok(found)
}

/// Names in a folder, and whether they are folders.
fn walk(folder: &Path) -> Result<Vec<(String, bool)>> {
    let fail = |cause: &std::io::Error| Error::io(folder, "a folder that can be read", cause);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|cause| fail(&cause))? {
        let entry = entry.map_err(|cause| fail(&cause))?;
        let is_folder = entry.file_type().map_err(|cause| fail(&cause))?.is_dir();
        found.push((entry.file_name().to_string_lossy().into_owned(), is_folder));
    }
    Ok(found)
}

/// Links or copies a file, in the place of what may be there.
fn take(from: &Path, to: &Path) -> Result<()> {
    // The common case without a temporary file: nothing is there.
    if let Some(parent) = to.parent() {
        files::make_folder(parent, "a folder for results")?;
    }
    if std::fs::hard_link(from, to).is_ok() {
        return Ok(());
    }
    files::replace_atomically(to, |temporary| std::fs::copy(from, temporary).map(drop))
}
