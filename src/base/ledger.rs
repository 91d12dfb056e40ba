//! The ledger of an experiment: a folder of records, each a file of its own, named by the hash of all that it depends on.
//!
//! A record is written whole or not at all, as soon as it is there, so that an experiment that was killed at any moment loses no more than
//! what was in work, and does nothing twice. The folder has a mark that says what it is for and which builds worked in it; one of another
//! experiment or another build is refused ([`Resume`] may go on with it).
//!
//! Keys hold the build that began the folder, and every record names the one that made it. Where builds are mixed knowingly, records are
//! therefore found by whoever goes on, and say whose they are.
//!
//! A record carries a *seal*, the hash of its text and its name: one that was edited by hand, cut or given another name is refused by its
//! file, and never counts as measured.
//!
//! One process at a time works in a folder, or several *shards* of one plan: these have distinct jobs, and whatever two of them need is
//! made by one while the other waits for it. The locks are the operating system's: they end with the process, whatever ends it.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, Resume};
use cpu_time::ProcessTime;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

/// Format of marks and records.
const FORMAT: &str = "cloudparity-ledger/1";

/// Folder of the locks of records that several processes may need.
pub const LOCKS: &str = "locks";

/// Beginning of the line of a record with its seal.
const SEAL: &str = "  \"seal\": \"";

/// When work began.
pub struct Begin(ProcessTime, Instant);

impl Begin {
    /// Now.
    pub fn now() -> Self {
        Self(ProcessTime::now(), Instant::now())
    }

    /// What was spent since.
    pub fn spent(&self) -> Spent {
        Spent { processor_seconds: self.0.elapsed().as_secs_f64(), wall_seconds: self.1.elapsed().as_secs_f64() }
    }
}

/// What a folder is for: the content of its mark, but for the builds.
#[derive(Debug, Clone, PartialEq)]
pub struct Purpose {
    /// Name of the file with the mark.
    pub mark: &'static str,
    /// Format of the experiment's results.
    pub format: &'static str,
    /// What all records of the folder belong to; null where records of different plans may lie side by side.
    pub of: Json,
}

impl Purpose {
    /// The builds that worked in a folder, the one that began it first, and the shards that it names; an error where it has no mark of this
    /// purpose.
    pub fn read_mark(&self, folder: &Path) -> Result<(Vec<Identity>, Vec<String>)> {
        let path = folder.join(self.mark);
        if !path.is_file() {
            return Err(Error::new(
                folder.display().to_string(),
                match folder.is_dir() {
                    true => format!("a folder without {}", self.mark),
                    false => "no folder".to_owned(),
                },
                format!("a folder with records of {}", self.format),
                "Correct the path; or run the shard that was to fill it.",
            ));
        }
        known_mark(&path, self).map(|mark| (mark.builds, mark.shards))
    }

    /// Begins a folder in the name of the builds that worked elsewhere, so that their records are found in it. One that was begun stays.
    pub fn begin_as(&self, folder: &Path, builds: &[Identity]) -> Result<()> {
        let path = folder.join(self.mark);
        if path.exists() { Ok(()) } else { self.write_mark(&path, builds.to_vec(), Vec::new()) }
    }

    fn write_mark(&self, path: &Path, builds: Vec<Identity>, shards: Vec<String>) -> Result<()> {
        let mark = Mark { ledger: FORMAT.into(), format: self.format.into(), builds, shards, of: self.of.clone() };
        files::write_atomically(path, to_json(&mark).as_bytes())
    }

    /// The builds that worked in a folder; none where it has no mark of this purpose.
    pub fn builds(&self, folder: &Path) -> Result<Option<Vec<Identity>>> {
        let path = folder.join(self.mark);
        Ok(if path.exists() { known_mark(&path, self).ok().map(|mark| mark.builds) } else { None })
    }
}

/// Whether other processes may work in the folder meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharing {
    /// None.
    Alone,
    /// Other shards.
    Shared,
}

/// An open folder of records, or a memory of them where nothing is kept.
pub struct Ledger {
    folder: Option<PathBuf>,
    purpose: Purpose,
    /// The build that is part of the keys: that which began the folder.
    first: Identity,
    own: Identity,
    sharing: Sharing,
    builds: Mutex<Vec<Identity>>,
    _lock: Option<files::Lock>,
}

/// The mark of a folder.
#[derive(Serialize, Deserialize)]
struct Mark {
    ledger: String,
    format: String,
    builds: Vec<Identity>,
    /// The parts of plans that were worked on here.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    shards: Vec<String>,
    #[serde(default, skip_serializing_if = "Json::is_null")]
    of: Json,
}

/// A record with the build that made it, or why there is none.
#[derive(Serialize, Deserialize)]
struct Made<T> {
    build: Identity,
    /// Of the work, where it was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    spent: Option<Spent>,
    #[serde(flatten)]
    found: Found<T>,
}

/// What work on a record took, in seconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spent {
    /// Processor time of all threads of this process.
    pub processor_seconds: f64,
    /// Time on the wall.
    pub wall_seconds: f64,
}

/// What work on a record came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Found<T> {
    /// The record.
    Record(T),
    /// None, with the reason. Whoever has the job tries it again; other shards take the reason as it is.
    LeftOut(String),
}

impl Ledger {
    /// Opens a folder, or makes it; refuses one with another purpose or of another build.
    pub fn open(folder: &Path, purpose: Purpose, resume: &Resume, sharing: Sharing) -> Result<Self> {
        files::make_folder(folder, "a folder for results")?;
        let lock = match sharing {
            Sharing::Alone => files::Lock::take(folder)?,
            Sharing::Shared => files::Lock::share(folder)?,
        };
        if sharing == Sharing::Alone {
            files::remove_temporary(folder)?;
        }
        // Shards that begin together read and write the mark one after another.
        let _turn = files::Lock::wait(&folder.join(LOCKS), "mark")?;
        let path = folder.join(purpose.mark);
        let (found, shards) = match path.exists() {
            true => known_mark(&path, &purpose).map(|mark| (mark.builds, mark.shards))?,
            false => Default::default(),
        };
        let builds = resume.join(&path.display().to_string(), &found)?;
        if builds != found {
            purpose.write_mark(&path, builds.clone(), shards)?;
        }
        Ok(Self {
            folder: Some(folder.to_owned()),
            purpose,
            first: builds[0].clone(),
            own: resume.build.clone(),
            sharing,
            builds: Mutex::default(),
            _lock: Some(lock),
        })
    }

    /// Notes in the mark that a part of a plan is worked on here.
    pub fn note_shard(&self, shard: &str) -> Result<()> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let _turn = files::Lock::wait(&folder.join(LOCKS), "mark")?;
        let (builds, mut shards) = self.purpose.read_mark(folder)?;
        if shards.iter().any(|known| known == shard) {
            return Ok(());
        }
        shards.push(shard.to_owned());
        self.purpose.write_mark(&folder.join(self.purpose.mark), builds, shards)
    }

    /// The build that is part of the keys.
    pub fn first(&self) -> &Identity {
        &self.first
    }

    /// A ledger that keeps nothing.
    pub fn in_memory(purpose: Purpose, resume: &Resume) -> Self {
        let own = resume.build.clone();
        let builds = Mutex::default();
        Self { folder: None, purpose, first: own.clone(), own, sharing: Sharing::Alone, builds, _lock: None }
    }

    /// The folder; none where nothing is kept.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// The builds whose records were read or made so far, in order of their names.
    pub fn builds(&self) -> Vec<Identity> {
        let mut all = self.builds.lock().expect("no holder panics").clone();
        all.sort();
        all
    }

    /// The key of a record that depends on `inputs`, and on the build.
    pub fn key(&self, inputs: &Json) -> String {
        let all = json!({"build": self.first, "format": self.purpose.format, "inputs": inputs});
        files::sha256(all.to_string().as_bytes())[..16].to_owned()
    }

    /// The file of a record.
    pub fn file(&self, part: &str, key: &str) -> Option<PathBuf> {
        self.folder.as_ref().map(|folder| folder.join(part).join(format!("{key}.json")))
    }

    /// A record, if it is there.
    pub fn read<T: DeserializeOwned>(&self, part: &str, key: &str) -> Result<Option<T>> {
        Ok(match self.find(part, key)? {
            Some(Found::Record(record)) => Some(record),
            _ => None,
        })
    }

    /// A record, or why there is none, if somebody has tried.
    pub fn find<T: DeserializeOwned>(&self, part: &str, key: &str) -> Result<Option<Found<T>>> {
        let Some(path) = self.file(part, key) else { return Ok(None) };
        let Some(made) = read_made::<T>(&path, part, key, &self.own)? else { return Ok(None) };
        if matches!(made.found, Found::Record(_)) {
            self.note(made.build);
        }
        Ok(Some(made.found))
    }

    /// The build that made a record, if it is there.
    pub fn maker(&self, part: &str, key: &str) -> Result<Option<Identity>> {
        let Some(path) = self.file(part, key) else { return Ok(None) };
        Ok(read_made::<Json>(&path, part, key, &self.own)?.map(|made| made.build))
    }

    /// The build that works now.
    pub fn own(&self) -> &Identity {
        &self.own
    }

    /// Writes a record of this build.
    pub fn write<T: Serialize>(&self, part: &str, key: &str, record: T) -> Result<()> {
        self.keep(part, key, &Found::Record(record), None)
    }

    /// Writes what work came to, and what it took.
    pub fn keep<T: Serialize>(&self, part: &str, key: &str, found: &Found<T>, spent: Option<Spent>) -> Result<()> {
        if matches!(found, Found::Record(_)) {
            self.note(self.own.clone());
        }
        let Some(path) = self.file(part, key) else { return Ok(()) };
        let text = to_json(&Made { build: self.own.clone(), spent, found: by_reference(found) });
        files::write_atomically(&path, sealed(&text, part, key).as_bytes())
    }

    /// What a record of another folder came to, and the build that made it, without its content: sound, or an error.
    pub fn look_at(&self, folder: &Path, part: &str, key: &str) -> Result<Option<(Identity, Found<()>)>> {
        let path = folder.join(part).join(format!("{key}.json"));
        let found = read_made::<Json>(&path, part, key, &self.own)?;
        Ok(found.map(|made| match made.found {
            Found::Record(_) => (made.build, Found::Record(())),
            Found::LeftOut(reason) => (made.build, Found::LeftOut(reason)),
        }))
    }

    /// A record that is there, or is made now; where another shard is at it, its end is waited for.
    pub fn obtain<T: Serialize + DeserializeOwned>(
        &self,
        part: &str,
        key: &str,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        if let Some(found) = self.read(part, key)? {
            return Ok(found);
        }
        let _claim = self.claim(part, key)?;
        if let Some(found) = self.read(part, key)? {
            return Ok(found);
        }
        let begin = Begin::now();
        let made = Found::Record(make()?);
        self.keep(part, key, &made, Some(begin.spent()))?;
        match made {
            Found::Record(record) => Ok(record),
            Found::LeftOut(_) => unreachable!("a record was made"),
        }
    }

    /// Waits until no other shard makes this record.
    pub fn claim(&self, part: &str, key: &str) -> Result<Option<files::Lock>> {
        match (&self.folder, self.sharing) {
            (Some(folder), Sharing::Shared) => {
                files::Lock::wait(&folder.join(LOCKS), &format!("{part}-{key}")).map(Some)
            }
            _ => Ok(None),
        }
    }

    fn note(&self, build: Identity) {
        let mut builds = self.builds.lock().expect("no holder panics");
        if !builds.contains(&build) {
            builds.push(build);
        }
    }
}

/// What was found, without a copy of it.
fn by_reference<T>(found: &Found<T>) -> Found<&T> {
    match found {
        Found::Record(record) => Found::Record(record),
        Found::LeftOut(reason) => Found::LeftOut(reason.clone()),
    }
}

/// The text of a record with its seal, which stands in a line of its own.
fn sealed(text: &str, part: &str, key: &str) -> String {
    let inside = text.strip_prefix("{\n").expect("records are objects of several lines");
    format!("{{\n{SEAL}{}\",\n{inside}", seal(text, part, key))
}

/// The hash of a record's text without the seal, and of its name.
fn seal(text: &str, part: &str, key: &str) -> String {
    files::sha256(format!("{part}/{key}\n{text}").as_bytes())
}

/// The text of a record without its seal, and the seal.
fn unsealed(text: &str) -> Option<(String, &str)> {
    let (found, rest) = text.strip_prefix("{\n")?.strip_prefix(SEAL)?.split_once("\",\n")?;
    Some((format!("{{\n{rest}"), found))
}

/// A record of a folder; `None` where it is not there. One that was changed after it was written is refused. Without a seal are records of
/// builds from before there was one, which is never the build that reads.
fn read_made<T: DeserializeOwned>(path: &Path, part: &str, key: &str, own: &Identity) -> Result<Option<Made<T>>> {
    if !path.exists() {
        return Ok(None);
    }
    let text = files::read_text(path, "JSON")?;
    let changed = |found: String, expected: String| {
        Error::new(
            path.display().to_string(),
            found,
            expected,
            "Take the file from where it was made, or remove it: it is made again.",
        )
    };
    match unsealed(&text) {
        Some((inside, found)) => {
            let expected = seal(&inside, part, key);
            if found != expected {
                return Err(changed(
                    format!(
                        "a record that was changed or renamed after it was written (its text has the seal {expected:.12})"
                    ),
                    format!("the text and the name with the seal {found:.12}, which it carries"),
                ));
            }
            parse_record(path, &inside).map(Some)
        }
        None => {
            let made: Made<T> = parse_record(path, &text)?;
            if made.build == *own {
                return Err(changed(
                    "a record of this build without a seal: it was changed after it was written".into(),
                    "the seal that this build writes into every record".into(),
                ));
            }
            Ok(Some(made))
        }
    }
}

/// The mark of a folder; one of another purpose is refused.
fn known_mark(path: &Path, purpose: &Purpose) -> Result<Mark> {
    let refused = |found: String, expected: String| {
        Error::new(
            path.display().to_string(),
            found,
            expected,
            "Take another folder; results of two formats, or of two files, are not mixed.",
        )
    };
    let text = files::read_text(path, "the mark of a folder of results")?;
    let mark: Mark = serde_json::from_str(&text)
        .map_err(|_| refused("no mark of this format".into(), format!("{FORMAT}, {}", purpose.format)))?;
    if (mark.ledger.as_str(), mark.format.as_str()) != (FORMAT, purpose.format) {
        return Err(refused(format!("{}, {}", mark.ledger, mark.format), format!("{FORMAT}, {}", purpose.format)));
    }
    if mark.of != purpose.of {
        return Err(refused("results of another file".into(), "those of this file".into()));
    }
    Ok(mark)
}

/// A file that this program wrote; `None` where it is not there.
pub fn read_record<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    if !path.exists() {
        return Ok(None);
    }
    parse_record(path, &files::read_text(path, "JSON")?).map(Some)
}

fn parse_record<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T> {
    serde_json::from_str(text).map_err(|cause| {
        Error::new(
            format!("{}, line {}", path.display(), cause.line()),
            cause.to_string(),
            "what this version writes",
            "Remove the file: it is made again.",
        )
    })
}

/// A document as files hold it.
pub fn to_json(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).expect("records serialise") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn purpose(of: Json) -> Purpose {
        Purpose { mark: "test.json", format: "cloudparity-test/1", of }
    }

    fn build(hash: &str, mix_builds: bool) -> Resume {
        Resume { build: Identity::of("0.1.0", hash), mix_builds }
    }

    fn open(folder: &Path, resume: &Resume) -> Result<Ledger> {
        Ledger::open(folder, purpose(Json::Null), resume, Sharing::Alone)
    }

    #[test]
    fn a_record_is_made_once_and_its_key_holds_the_build() {
        let folder = tempfile::tempdir().expect("a folder");
        let first = build("aa", false);
        let left = folder.path().join(".cloudparity-left.json");
        std::fs::write(&left, "{").expect("what a killed process left");
        let key = {
            let ledger = open(folder.path(), &first).expect("a new folder");
            assert!(!left.exists(), "it is removed");
            let key = ledger.key(&json!({"number": 3}));
            assert_ne!(key, ledger.key(&json!({"number": 4})));
            assert_eq!(ledger.obtain("squares", &key, || Ok(9)).expect("it is made"), 9);
            key
        };
        let ledger = open(folder.path(), &first).expect("the same build");
        let never = || -> Result<i32> { panic!("it is there") };
        assert_eq!(ledger.obtain("squares", &key, never).expect("it is read"), 9);
        assert_eq!(ledger.builds(), [Identity::of("0.1.0", "aa")]);
        let other = tempfile::tempdir().expect("a folder");
        let elsewhere = open(other.path(), &build("bb", false)).expect("a new folder");
        assert_ne!(elsewhere.key(&json!({"number": 3})), key);
    }

    #[test]
    fn a_folder_of_another_build_is_refused_or_gone_on_with_and_names_both() {
        let folder = tempfile::tempdir().expect("a folder");
        let [a, b] = ["aa", "bb"].map(|hash| Identity::of("0.1.0", hash));
        let key = {
            let ledger = open(folder.path(), &build("aa", false)).expect("a new folder");
            let key = ledger.key(&json!(1));
            ledger.write("x", &key, 1).expect("written");
            key
        };
        let error = open(folder.path(), &build("bb", false)).err().expect("refused").to_string();
        assert!(error.contains("0.1.0+aa") && error.contains("0.1.0+bb") && error.contains("test.json"), "{error}");
        {
            let ledger = open(folder.path(), &build("bb", true)).expect("knowingly");
            assert_eq!(ledger.key(&json!(1)), key, "what is there is found");
            assert_eq!(ledger.read::<i32>("x", &key).expect("read"), Some(1));
            assert_eq!(ledger.builds(), std::slice::from_ref(&a));
            ledger.write("x", &ledger.key(&json!(2)), 2).expect("written");
            assert_eq!(ledger.builds(), [a, b]);
        }
        // A folder in which both worked is neither's.
        for hash in ["aa", "bb"] {
            assert!(open(folder.path(), &build(hash, false)).is_err(), "{hash}");
        }
    }

    #[test]
    fn another_purpose_a_damaged_mark_and_a_second_process_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let resume = build("aa", false);
        let open = |of: Json, sharing| Ledger::open(folder.path(), purpose(of), &resume, sharing);
        let kept = open(json!("one"), Sharing::Shared).expect("a new folder");
        let second = open(json!("one"), Sharing::Shared).expect("shards share it");
        let error = open(json!("one"), Sharing::Alone).err().expect("it is in use").to_string();
        assert!(error.contains("another process"), "{error}");
        drop((kept, second));
        let alone = open(json!("one"), Sharing::Alone).expect("it is free");
        assert!(open(json!("one"), Sharing::Shared).is_err());
        drop(alone);
        let error = open(json!("two"), Sharing::Alone).err().expect("another file").to_string();
        assert!(error.contains("another file"), "{error}");
        std::fs::write(folder.path().join("test.json"), "{}").expect("written");
        let error = open(json!("one"), Sharing::Alone).err().expect("damaged").to_string();
        assert!(error.contains("another folder"), "{error}");
    }

    #[test]
    fn a_record_that_was_edited_cut_or_renamed_is_refused_by_its_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let ledger = open(folder.path(), &build("aa", false)).expect("a new folder");
        let keys = [1, 2].map(|number| ledger.key(&json!(number)));
        ledger.keep("x", &keys[0], &Found::Record(0.1 + 0.2), None).expect("written");
        let [path, other] = keys.clone().map(|key| ledger.file("x", &key).expect("a file"));
        let text = std::fs::read_to_string(&path).expect("a record");
        assert_eq!(ledger.read::<f64>("x", &keys[0]).expect("sound"), Some(0.1 + 0.2));
        let line = |text: &str| text.lines().position(|line| line.starts_with(SEAL)).expect("a seal");
        let mut without: Vec<&str> = text.lines().collect();
        without.remove(line(&text));
        let edits = [
            text.replace("0.30000000000000004", "0.3"),
            text.replace("  \"record\"", " \"record\""),
            text.replace("0.1.0+aa", "0.1.0+ab"),
            text.replace(SEAL, &format!("{SEAL}0")),
            without.join("\n") + "\n",
            text[..text.len() - 4].to_owned(),
        ];
        for edited in edits {
            assert_ne!(edited, text);
            std::fs::write(&path, &edited).expect("written");
            for error in [
                ledger.read::<f64>("x", &keys[0]).expect_err(&edited),
                ledger.maker("x", &keys[0]).expect_err(&edited),
                ledger.look_at(folder.path(), "x", &keys[0]).expect_err(&edited),
            ] {
                assert!(error.place.contains(&keys[0]) && error.remedy.contains("made again"), "{error}");
            }
        }
        // The record of one job under the name of another.
        std::fs::write(&other, &text).expect("written");
        let error = ledger.read::<f64>("x", &keys[1]).expect_err("another name");
        assert!(error.place.contains(&keys[1]) && error.found.contains("renamed"), "{error}");
        // Whoever else made it may be from before there were seals.
        std::fs::write(&path, (without.join("\n") + "\n").replace("0.1.0+aa", "0.1.0+00")).expect("written");
        assert_eq!(ledger.read::<f64>("x", &keys[0]).expect("an older build's"), Some(0.1 + 0.2));
    }

    #[test]
    fn what_two_shards_need_is_made_by_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let made = std::sync::atomic::AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    let resume = build("aa", false);
                    let ledger =
                        Ledger::open(folder.path(), purpose(Json::Null), &resume, Sharing::Shared).expect("a shard");
                    for number in 0..20 {
                        let slow = || {
                            made.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
                            std::thread::sleep(std::time::Duration::from_millis(2));
                            Ok(number)
                        };
                        assert_eq!(ledger.obtain("x", &ledger.key(&json!(number)), slow).expect("a record"), number);
                    }
                });
            }
        });
        assert_eq!(made.into_inner(), 20);
    }
}
