//! Values of releases of Blender beside Cycles of these releases, where their environments are there.

use cloudparity::bridge::releases::{Reading, is_complete, truth_of};
use cloudparity::measure::nodes::suite::{self, Selection};
use cloudparity::scene::Release;
use std::path::Path;

/// Nodes whose values differ between releases from 5.0 on.
const NODES: [&str; 8] =
    ["Math", "Vector Math", "Vector Transform", "Mix", "Magic Texture", "Brick Texture", "RGB to BW", "Blackbody"];

#[test]
fn values_are_those_of_cycles_of_their_release() {
    for release in [Release::V5_1, Release::V5_2, Release::V5_3] {
        let truth = truth_of(release).expect("a release with an environment of its own");
        if !is_complete(truth) {
            eprintln!("left out: Blender {truth} has no environment here");
            continue;
        }
        for node in NODES {
            let cases = suite::cases_of(release, 256, 7, Some(node), Selection::Everything).expect("the suite");
            let found = suite::run(&cases, None, false, |_| ()).expect("an answer");
            assert!(found.blender.starts_with(truth), "{}", found.blender);
            let wrong: Vec<_> = found.rows.iter().filter(|row| !row.pass).collect();
            assert!(wrong.is_empty(), "{release}: {wrong:#?}");
        }
    }
}

#[test]
fn round_is_a_mode_of_the_releases_that_have_it() {
    let modes = |release| {
        let cases = suite::cases_of(release, 2, 1, Some("Vector Math"), Selection::Everything).expect("the suite");
        cases.into_iter().map(|case| case.mode).collect::<Vec<_>>()
    };
    let (before, since) = (modes(Release::V5_0), modes(Release::V5_1));
    assert_eq!(before.len() + 1, since.len());
    assert_eq!(before, since[..before.len()]);
    assert_eq!(since.last().map(String::as_str), Some("ROUND"));
}

#[test]
fn a_file_that_is_no_blend_is_left_to_the_usual_release() {
    let reading = Reading::of(Path::new(file!()), None).expect("a reading");
    assert_eq!((reading.saved_by, reading.values), (None, Release::V5_0));
}
