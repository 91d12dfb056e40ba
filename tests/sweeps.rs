//! Many records: what docs/sweeps.md says of a plan of a million jobs rests on these measurements.

use cloudparity::Result;
use cloudparity::base::files;
use cloudparity::base::ledger::{Found, Purpose};
use cloudparity::measure::experiment::{Desk, Done, Experiment, Merge, Outcome, Settings, Shard, run};
use serde_json::{Value as Json, json};

fn shard(number: u32, count: u32) -> Settings {
    Settings { shard: Shard::new(number, count).expect("a shard"), ..Settings::default() }
}

/// Made-up records as large as those of a study's runs, with a file each beside them.
struct Many(u32);

impl Experiment for Many {
    type Job = u32;
    type Record = Json;
    type Summary = usize;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "many.json", format: "cloudparity-many/1", of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<u32>> {
        Ok((0..self.0).collect())
    }

    fn inputs(&self, job: &u32) -> Result<Json> {
        // A run's inputs are its settings, those of the truth and of the clock: some 600 bytes.
        Ok(json!({"number": job, "settings": (0..20).map(|name| format!("a setting, {name}")).collect::<Vec<_>>()}))
    }

    fn label(&self, job: &u32) -> String {
        format!("number {job}")
    }

    fn run(&mut self, job: &u32, desk: &Desk<'_>) -> Result<Found<Json>> {
        let picture = desk.folder()?.join("pictures").join(format!("{}.exr", desk.key));
        files::write_atomically(&picture, &[0; 1024])?;
        let errors: Vec<f64> = (1..=40).map(|number| f64::from(*job) / f64::from(number)).collect();
        Ok(Found::Record(json!({"id": desk.key, "picture": "pictures/KEY.exr", "errors": errors})))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, _desk: &Desk<'_>) -> Result<usize> {
        Ok(found.len())
    }
}

#[test]
fn a_thousand_records_of_forty_shards_come_together() {
    measure(1000);
}

/// What docs/sweeps.md says of many records was measured so:
/// `MANY=100000 cargo test --release --test sweeps -- --ignored --nocapture`
#[test]
#[ignore = "minutes, and it measures"]
fn many_records_are_written_merged_and_summed_up_in_this_time() {
    measure(std::env::var("MANY").map_or(10_000, |text| text.parse().expect("a number of records")));
}

fn measure(jobs: u32) {
    let shards = 40;
    let root = tempfile::tempdir().expect("a folder, below TMPDIR");
    let folder = |number: u32| root.path().join(number.to_string());
    let timed = |what: &str, work: &mut dyn FnMut()| {
        let begin = std::time::Instant::now();
        work();
        println!("{what}: {:.2} s", begin.elapsed().as_secs_f64());
    };
    timed("writing, all shards one after another", &mut || {
        for number in 1..=shards {
            let none = run(&mut Many(jobs), Some(&folder(number)), &shard(number, shards), &|_, _| ());
            assert!(matches!(none.expect("a shard"), Outcome::Part { .. }));
        }
    });
    timed("one shard that finds all of its records", &mut || {
        run(&mut Many(jobs), Some(&folder(1)), &shard(1, shards), &|_, _| ()).expect("a shard");
    });
    let from: Vec<_> = (1..=shards).map(folder).collect();
    let settings = Settings { merge: Merge { from, only: true }, ..Settings::default() };
    for what in ["merging and summing up", "the same again, with nothing to take"] {
        timed(what, &mut || {
            let outcome = run(&mut Many(jobs), Some(&folder(0)), &settings, &|_, _| ()).expect("merged");
            assert_eq!(outcome, Outcome::All(jobs as usize));
        });
    }
    timed("summing up", &mut || {
        let outcome = run(&mut Many(jobs), Some(&folder(0)), &Settings::default(), &|_, _| ()).expect("all");
        assert_eq!(outcome, Outcome::All(jobs as usize));
    });
    let entries: Vec<_> = std::fs::read_dir(folder(0).join("records")).expect("records").collect();
    let bytes: u64 = entries.iter().map(|entry| entry.as_ref().expect("an entry").metadata().expect("it").len()).sum();
    assert_eq!(entries.len(), jobs as usize);
    println!("{} records in a folder, {:.0} bytes each", entries.len(), bytes as f64 / entries.len() as f64);
}
