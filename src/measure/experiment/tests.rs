//! The harness with a toy: squares of numbers, of which some have none.

use super::*;
use crate::base::identity::Identity;
use serde_json::json;
use std::sync::Mutex;

/// Squares of the numbers up to 10; 7 is left out. Each square needs a shared record besides its own.
#[derive(Default)]
struct Squares {
    done: Vec<u32>,
    shared: u32,
    heard: Vec<u32>,
    /// Stops with an error before this number.
    stop: Option<u32>,
    /// The first number of the plan.
    first: u32,
}

impl Experiment for Squares {
    type Job = u32;
    type Record = u32;
    type Summary = Vec<u32>;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "squares.json", format: "cloudparity-squares/1", of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<u32>> {
        Ok((self.first..self.first + 10).collect())
    }

    fn inputs(&self, job: &u32) -> Result<Json> {
        Ok(json!({"number": job}))
    }

    fn label(&self, job: &u32) -> String {
        format!("number {job}")
    }

    fn run(&mut self, job: &u32, desk: &Desk<'_>) -> Result<Found<u32>> {
        if self.stop == Some(*job) {
            return Err(Error::new("a number", job.to_string(), "less", "Stop."));
        }
        self.done.push(*job);
        let offset: u32 = desk.obtain("shared", &json!({"what": "offset"}), |_| {
            self.shared += 1;
            Ok(0)
        })?;
        desk.report(0.5, "half");
        Ok(if *job == 7 { Found::LeftOut("seven".into()) } else { Found::Record(job * job + offset) })
    }

    fn heard(&mut self, _job: &u32, record: &u32, _desk: &Desk<'_>) -> Result<()> {
        self.heard.push(*record);
        Ok(())
    }

    fn summary(&mut self, found: Vec<Done<Self>>, _desk: &Desk<'_>) -> Result<Vec<u32>> {
        assert!(
            found.iter().all(|done| (done.job == 7) == matches!(&done.found, Found::LeftOut(why) if why == "seven"))
        );
        Ok(records(found))
    }
}

const ALL: [u32; 9] = [0, 1, 4, 9, 16, 25, 36, 64, 81];

fn shard(number: u32, count: u32) -> Settings {
    Settings { shard: Shard::new(number, count).expect("a shard"), ..Settings::default() }
}

fn go(squares: &mut Squares, folder: &Path, settings: &Settings) -> Result<Outcome<Vec<u32>>> {
    run(squares, Some(folder), settings, &|_, _| ())
}

/// Copies what one folder has into another.
fn copy(from: &Path, to: &Path) {
    for part in ["records", "shared"] {
        std::fs::create_dir_all(to.join(part)).expect("a folder");
        for entry in std::fs::read_dir(from.join(part)).expect("a part") {
            let path = entry.expect("an entry").path();
            std::fs::copy(&path, to.join(part).join(path.file_name().expect("a name"))).expect("copied");
        }
    }
}

#[test]
fn an_interrupted_run_goes_on_and_does_nothing_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut first = Squares { stop: Some(5), ..Squares::default() };
    go(&mut first, folder.path(), &Settings::default()).expect_err("it stops");
    assert_eq!((first.done, first.heard), (vec![0, 1, 2, 3, 4], vec![0, 1, 4, 9, 16]));
    let told = Mutex::new(Vec::new());
    let mut second = Squares::default();
    let progress = |done: f64, what: &str| told.lock().expect("nobody panics").push((done, what.to_owned()));
    let outcome = run(&mut second, Some(folder.path()), &Settings::default(), &progress).expect("it goes on");
    assert_eq!(outcome, Outcome::All(ALL.to_vec()));
    assert_eq!((second.done, second.shared), (vec![5, 6, 7, 8, 9], 0));
    assert_eq!(second.heard, ALL, "records that were there are heard of, too");
    let told = told.into_inner().expect("nobody panics");
    assert!(told.is_sorted_by(|a, b| a.0 <= b.0) && told[1] == (0.55, "number 5: half".to_owned()), "{told:?}");
    // What was left out is tried again, and nothing else.
    let mut third = Squares::default();
    go(&mut third, folder.path(), &Settings::default()).expect("it is done");
    assert_eq!(third.done, [7]);
    // Without a folder everything is done.
    let mut memory = Squares::default();
    let outcome = run(&mut memory, None, &Settings::default(), &|_, _| ()).expect("nothing is kept");
    assert_eq!((outcome, memory.done.len()), (Outcome::All(ALL.to_vec()), 10));
}

#[test]
fn shards_come_together_in_one_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut first = Squares::default();
    let outcome = go(&mut first, folder.path(), &shard(1, 2)).expect("a half");
    assert_eq!(outcome, Outcome::Part { done: 5, of: 10 });
    assert!(outcome.all().expect_err("no summary").found.contains("5 of 10"));
    let mut second = Squares::default();
    let outcome = go(&mut second, folder.path(), &shard(2, 2)).expect("the other half");
    assert_eq!(outcome, Outcome::All(ALL.to_vec()));
    assert_eq!((first.done, second.done), (vec![0, 2, 4, 6, 8], vec![1, 3, 5, 7, 9]));
    assert_eq!((first.shared, second.shared), (1, 0));
    let mut again = Squares::default();
    assert_eq!(go(&mut again, folder.path(), &shard(1, 2)).expect("done"), Outcome::All(ALL.to_vec()));
    assert!(again.done.is_empty(), "what another shard left out is not this one's to try");
}

#[test]
fn shards_of_folders_of_their_own_are_copied_together() {
    let folders = [0; 3].map(|_| tempfile::tempdir().expect("a folder"));
    for (number, folder) in folders.iter().enumerate() {
        let outcome = go(&mut Squares::default(), folder.path(), &shard(number as u32 + 1, 3)).expect("a third");
        assert!(matches!(outcome, Outcome::Part { of: 10, .. }), "{outcome:?}");
    }
    copy(folders[1].path(), folders[0].path());
    copy(folders[2].path(), folders[0].path());
    let mut whole = Squares::default();
    assert_eq!(go(&mut whole, folders[0].path(), &Settings::default()).expect("all"), Outcome::All(ALL.to_vec()));
    assert_eq!((whole.done, whole.shared), (vec![7], 0));
}

/// Records of the folders alone, brought into one.
fn merge(from: &[&Path], resume: Resume) -> Settings {
    let from = from.iter().map(|path| path.to_path_buf()).collect();
    Settings { merge: Merge { from, only: true }, ..Settings::of(resume) }
}

/// Folders of three shards, the last of which stops before `stop`.
fn thirds(stop: Option<u32>) -> [tempfile::TempDir; 3] {
    let folders = [0; 3].map(|_| tempfile::tempdir().expect("a folder"));
    for (number, folder) in (1..).zip(&folders) {
        let mut squares = Squares { stop: stop.filter(|_| number == 3), ..Squares::default() };
        assert_eq!(go(&mut squares, folder.path(), &shard(number, 3)).is_err(), squares.stop.is_some());
    }
    folders
}

/// The records of a folder: name and bytes.
fn files_of(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(folder.join("records")).expect("records");
    let mut found: Vec<_> = entries
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some() && !path.to_string_lossy().contains(".cloudparity-"))
        .map(|path| {
            (path.file_name().expect("a name").to_string_lossy().into_owned(), std::fs::read(path).expect("read"))
        })
        .collect();
    found.sort();
    found
}

#[test]
fn a_merge_brings_every_record_once_and_does_nothing() {
    let folders = thirds(None);
    let paths = folders.each_ref().map(tempfile::TempDir::path);
    // What belongs to a record, and what belongs to none.
    let (name, _) = files_of(paths[1]).remove(0);
    let picture = Path::new("pictures").join(name.replace(".json", ".exr"));
    for (path, text) in [(paths[0], "of an interrupted job"), (paths[1], "of the record")] {
        std::fs::create_dir_all(path.join("pictures")).expect("a folder");
        std::fs::write(path.join(&picture), text).expect("written");
    }
    std::fs::write(paths[2].join("records/.cloudparity-left.json"), "{").expect("what a killed process left");
    let into = tempfile::tempdir().expect("a folder");
    let mut squares = Squares::default();
    let settings = merge(&paths, Resume::default());
    assert_eq!(go(&mut squares, into.path(), &settings).expect("merged"), Outcome::All(ALL.to_vec()));
    assert!(squares.done.is_empty() && squares.shared == 0, "not even what was left out is tried again");
    assert_eq!(squares.heard, ALL);
    let mut wanted: Vec<_> = paths.iter().flat_map(|path| files_of(path)).collect();
    wanted.sort();
    assert_eq!(files_of(into.path()), wanted);
    assert_eq!(wanted.len(), 10);
    assert_eq!(std::fs::read(into.path().join(&picture)).expect("a picture"), b"of the record");
    // Again, and by a shard that has nothing to try again: nothing changes.
    for settings in [settings, shard(1, 3)] {
        assert_eq!(go(&mut Squares::default(), into.path(), &settings).expect("again"), Outcome::All(ALL.to_vec()));
        assert_eq!(files_of(into.path()), wanted);
    }
}

#[test]
fn a_shard_begins_with_what_others_have() {
    let folders = thirds(None);
    let into = tempfile::tempdir().expect("a folder");
    let from = vec![folders[0].path().to_owned()];
    let settings = Settings { merge: Merge { from, only: false }, ..shard(1, 2) };
    let mut squares = Squares::default();
    assert_eq!(go(&mut squares, into.path(), &settings).expect("a half"), Outcome::Part { done: 7, of: 10 });
    assert_eq!((squares.done, squares.shared), (vec![2, 4, 8], 0), "0, 3, 6 and 9 are there");
}

#[test]
fn a_merge_without_a_shard_names_it() {
    let folders = thirds(Some(8));
    let paths = folders.each_ref().map(tempfile::TempDir::path);
    let into = tempfile::tempdir().expect("a folder");
    let error = go(&mut Squares::default(), into.path(), &merge(&paths, Resume::default())).expect_err("8 is lost");
    assert!(error.place.contains("shard 3/3") && error.place.contains("lacks 1 of 3"), "{error}");
    assert!(error.place.contains(&paths[2].display().to_string()) && !error.place.contains("2/3"), "{error}");
    assert!(error.found.contains("9 of 10 records") && error.found.contains("number 8"), "{error}");
    assert!(error.remedy.contains("Run these shards again"), "{error}");
    // A shard whose folder is not named, and one that never began.
    let error = go(&mut Squares::default(), into.path(), &merge(&paths[..2], Resume::default())).expect_err("two");
    assert!(error.place.contains("shard 3/3 is in none"), "{error}");
    let never = into.path().join("never");
    let error = go(&mut Squares::default(), into.path(), &merge(&[&never], Resume::default())).expect_err("none");
    assert!(error.place.contains("never") && error.found == "no folder" && !never.exists(), "{error}");
    // Run again it goes on where it stopped, and the merge has all.
    let mut third = Squares::default();
    go(&mut third, paths[2], &shard(3, 3)).expect("the rest");
    assert_eq!(third.done, [8]);
    let outcome = go(&mut Squares::default(), into.path(), &merge(&paths, Resume::default()));
    assert_eq!(outcome.expect("merged"), Outcome::All(ALL.to_vec()));
}

#[test]
fn a_merge_of_what_does_not_belong_together_is_refused() {
    let folders = thirds(None);
    let paths = folders.each_ref().map(tempfile::TempDir::path);
    let into = tempfile::tempdir().expect("a folder");
    let refused = |paths: &[&Path], resume: Resume| {
        let error = go(&mut Squares::default(), into.path(), &merge(paths, resume)).expect_err("refused");
        assert!(!into.path().join("records").exists(), "{error}");
        error
    };
    // Another build, of all or of one.
    let other = |mix_builds| Resume { build: Identity::of("0.1.0", "bb"), mix_builds };
    let error = refused(&paths, other(false));
    assert!(error.to_string().contains("0.1.0+bb") && error.settings == ["mix_builds"], "{error}");
    let foreign = tempfile::tempdir().expect("a folder");
    let settings = Settings { resume: other(false), ..shard(3, 3) };
    go(&mut Squares::default(), foreign.path(), &settings).expect("a third by another build");
    let error = refused(&[paths[0], paths[1], foreign.path()], Resume::default());
    assert!(error.place.contains(&foreign.path().display().to_string()) && error.found.contains("0.1.0+bb"), "{error}");
    // Keys hold the build that began a folder: not even knowingly.
    let error = refused(&[paths[0], paths[1], foreign.path()], Resume::mixing());
    assert!(error.remedy.contains("anew with that build") && error.place.contains("squares.json"), "{error}");
    // Another plan, and another experiment.
    let second = tempfile::tempdir().expect("a folder");
    go(&mut Squares { first: 5, ..Squares::default() }, second.path(), &shard(3, 3)).expect("another plan");
    let error = refused(&[second.path()], Resume::default());
    assert!(error.found.contains("none of this plan") && error.place.contains("records"), "{error}");
    std::fs::rename(second.path().join("squares.json"), second.path().join("cubes.json")).expect("renamed");
    let error = refused(&[second.path()], Resume::default());
    assert!(error.found.contains("without squares.json"), "{error}");
    // A record that was edited, and one under another's name.
    let [(name, bytes), (second, _), ..] = &files_of(paths[2])[..] else { panic!("three records") };
    let (record, text) = (paths[2].join("records").join(name), String::from_utf8(bytes.clone()).expect("text"));
    for edited in [text.replace("\"record\": ", "\"record\": 1"), text.replace("left_out\": \"", "left_out\": \"1")] {
        if edited != text {
            std::fs::write(&record, edited).expect("written");
            let error = refused(&[paths[2]], Resume::default());
            assert!(error.place.contains(name) && error.found.contains("changed"), "{error}");
        }
    }
    std::fs::copy(paths[2].join("records").join(second), &record).expect("copied");
    assert!(refused(&[paths[2]], Resume::default()).place.contains(name));
    std::fs::write(&record, text).expect("restored");
    // The folder itself.
    let error = go(&mut Squares::default(), paths[0], &merge(&[paths[0]], Resume::default())).expect_err("itself");
    assert!(error.remedy.contains("Leave it out"), "{error}");
    // Begun by one build and gone on with by another, knowingly: their records are found, and both named.
    let mixed = tempfile::tempdir().expect("a folder");
    let settings = Settings { resume: other(true), ..merge(&paths, other(true)) };
    let outcome = go(&mut Squares::default(), mixed.path(), &settings).expect("knowingly");
    assert_eq!(outcome, Outcome::All(ALL.to_vec()));
}

#[test]
fn shards_at_the_same_time_do_each_job_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let done: Vec<Squares> = std::thread::scope(|scope| {
        let path = folder.path();
        let each = |number| {
            scope.spawn(move || {
                let mut squares = Squares::default();
                go(&mut squares, path, &shard(number, 3)).expect("a shard");
                squares
            })
        };
        let all = [1, 2, 3].map(each);
        all.map(|shard| shard.join().expect("it ends")).into_iter().collect()
    });
    let mut numbers: Vec<u32> = done.iter().flat_map(|squares| squares.done.clone()).collect();
    numbers.sort_unstable();
    assert_eq!(numbers, (0..10).collect::<Vec<_>>());
    assert_eq!(done.iter().map(|squares| squares.shared).sum::<u32>(), 1, "what all need is made by one");
    assert_eq!(go(&mut Squares::default(), folder.path(), &shard(1, 3)).expect("all"), Outcome::All(ALL.to_vec()));
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    go(&mut Squares::default(), folder.path(), &shard(1, 2)).expect("a half");
    let other = |mix_builds| Settings::of(Resume { build: Identity::of("0.1.0", "bb"), mix_builds });
    let mut squares = Squares::default();
    let error = go(&mut squares, folder.path(), &other(false)).expect_err("another build").to_string();
    assert!(error.contains("0.1.0+bb") && error.contains(&Identity::current().to_string()), "{error}");
    assert!(squares.done.is_empty());
    let outcome = go(&mut squares, folder.path(), &other(true)).expect("knowingly");
    assert_eq!((outcome, squares.done), (Outcome::All(ALL.to_vec()), vec![1, 3, 5, 7, 9]));
    let error = run(&mut Squares::default(), None, &shard(1, 2), &|_, _| ()).expect_err("nowhere to meet").to_string();
    assert!(error.contains("folder"), "{error}");
    let lock = crate::base::files::Lock::take(folder.path()).expect("nobody has it");
    assert!(go(&mut Squares::default(), folder.path(), &shard(1, 2)).is_err(), "a process has it alone");
    drop(lock);
}
