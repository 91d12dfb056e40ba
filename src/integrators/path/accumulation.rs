//! What a progressive render has so far, how far from the truth it is, and its state on disk.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, Resume};
use crate::integrators::path::Counters;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// First bytes of a state file.
const MAGIC: &[u8] = b"cloudparity path state 2\n";

/// Sums over the passes of one replica.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Accumulation {
    pub(crate) progress: Progress,
    /// Red, green, blue and opacity of each pixel, summed over samples.
    pub(crate) sums: Vec<[f64; 4]>,
    /// Sum over passes of the samples in the pass times the square of its mean, of the first three.
    pub(crate) squares: Vec<[f64; 3]>,
}

/// How far a render is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Progress {
    /// What is rendered and how: a state of another picture is of no use.
    pub(crate) identity: String,
    /// The builds that took the samples.
    pub(crate) builds: Vec<Identity>,
    /// Samples per pixel.
    pub(crate) samples: u32,
    /// Passes in which they were taken.
    pub(crate) passes: u32,
    /// Time that they took.
    pub(crate) seconds: f64,
    /// What the paths did.
    pub(crate) counters: Counters,
}

impl Accumulation {
    /// Nothing yet, of so many pixels.
    pub(crate) fn new(identity: String, build: &Identity, pixels: usize) -> Self {
        let progress = Progress { identity, builds: vec![build.clone()], ..Progress::default() };
        Self { progress, sums: vec![[0.0; 4]; pixels], squares: vec![[0.0; 3]; pixels] }
    }

    /// Adds a pass: sums over its samples, pixel by pixel.
    pub(crate) fn add(&mut self, pass: &[[f64; 4]], samples: u32) {
        self.progress.samples += samples;
        self.progress.passes += 1;
        for ((sum, square), pass) in self.sums.iter_mut().zip(&mut self.squares).zip(pass) {
            for channel in 0..4 {
                sum[channel] += pass[channel];
            }
            for channel in 0..3 {
                square[channel] += pass[channel] * pass[channel] / f64::from(samples);
            }
        }
    }

    /// Estimate of the relative mean squared error: the mean over pixels and channels of v / (m^2 + (0.01 M)^2)
    /// with the pixel's mean m, the variance v of that mean, and M the mean of the picture. None before
    /// the second pass. The variance comes from the spread of the passes; these share a stratified sequence, so that the
    /// true error is rather smaller.
    pub(crate) fn relative_error(&self) -> Option<f64> {
        if self.progress.passes < 2 {
            return None;
        }
        let samples = f64::from(self.progress.samples);
        let freedom = f64::from(self.progress.passes - 1);
        let values = || self.sums.iter().flat_map(|sum| &sum[..3]).map(|sum| sum / samples);
        let count = 3.0 * self.sums.len() as f64;
        let floor = (0.01 * values().sum::<f64>() / count).powi(2);
        if floor == 0.0 {
            return Some(0.0);
        }
        let total: f64 = values()
            .zip(self.squares.iter().flatten())
            .map(|(mean, square)| {
                let variance = (square - samples * mean * mean).max(0.0) / (freedom * samples);
                variance / (mean * mean + floor)
            })
            .sum();
        Some(total / count)
    }

    /// Writes the state, atomically.
    pub(crate) fn save(&self, path: &Path) -> Result<()> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(serde_json::to_string(&self.progress).expect("progress serialises").bytes());
        bytes.push(b'\n');
        for value in self.sums.iter().flatten().chain(self.squares.iter().flatten()) {
            bytes.extend(value.to_le_bytes());
        }
        files::write_atomically(path, &bytes)
    }

    /// Goes on from a state file, if there is one; one of another picture is an error, and one of another build, unless these may be mixed.
    pub(crate) fn load(path: &Path, fresh: Self, resume: &Resume) -> Result<Self> {
        files::check_input(path, "the state of an interrupted render")?;
        let bytes = match std::fs::read(path) {
            Ok(bytes) => bytes,
            Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => return Ok(fresh),
            Err(cause) => return Err(Error::io(path, "the state of an interrupted render", &cause)),
        };
        let wrong = |found: &str| {
            Error::new(
                path.display().to_string(),
                found,
                "the state of this very picture, interrupted",
                "Give the same scene and settings to go on with it, or remove the file.",
            )
        };
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| wrong("something else"))?;
        let end = rest.iter().position(|&byte| byte == b'\n').ok_or_else(|| wrong("a cut file"))?;
        let mut progress: Progress = serde_json::from_slice(&rest[..end]).map_err(|_| wrong("a damaged head"))?;
        if progress.identity != fresh.progress.identity {
            return Err(wrong("the state of another picture"));
        }
        progress.builds = resume.join(&path.display().to_string(), &progress.builds)?;
        let pixels = fresh.sums.len();
        if rest.len() - end - 1 != pixels * 7 * 8 {
            return Err(wrong("a cut file"));
        }
        let values: Vec<f64> = rest[end + 1..]
            .chunks_exact(8)
            .map(|bytes| f64::from_le_bytes(bytes.try_into().expect("chunks of eight bytes")))
            .collect();
        let (sums, squares) = values.split_at(4 * pixels);
        Ok(Self { progress, sums: sums.as_chunks::<4>().0.to_vec(), squares: squares.as_chunks::<3>().0.to_vec() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn build(hash: &str) -> Identity {
        Identity::of("0.1.0", hash)
    }

    fn passes() -> Accumulation {
        let mut sums = Accumulation::new("a picture".into(), &build("aa"), 2);
        for pass in [1.0, 2.0, 4.0] {
            sums.add(&[[4.0 * pass, 8.0, 0.0, 1.0], [4.0, 4.0, 4.0, 0.0]], 4);
        }
        sums
    }

    #[test]
    fn the_relative_error_is_that_of_the_formula() {
        // Only the first value varies: pass means 1, 2, 4 have the mean 7/3 and the variance 7/3; of
        // the mean a third of it. The picture's mean is (7/3 + 2 + 0 + 3) / 6.
        let mean = (7.0 / 3.0 + 5.0) / 6.0;
        let expected = 7.0 / 9.0 / (49.0 / 9.0 + (0.01_f64 * mean).powi(2)) / 6.0;
        let found = passes().relative_error().expect("three passes");
        assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
        assert_eq!(Accumulation::new(String::new(), &build("aa"), 2).relative_error(), None);
    }

    #[test]
    fn a_state_goes_on_where_it_was_and_one_of_another_picture_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr.state");
        let fresh = |identity: &str| Accumulation::new(identity.into(), &build("aa"), 2);
        let load = |identity: &str| {
            Accumulation::load(&path, fresh(identity), &Resume { build: build("aa"), mix_builds: false })
        };
        assert_eq!(load("a picture").expect("nothing there"), fresh("a picture"));
        passes().save(&path).expect("it is written");
        assert_eq!(load("a picture").expect("it is read"), passes());
        let error = load("another").expect_err("it is refused");
        assert!(error.found.contains("another picture"), "{error}");
        let bytes = std::fs::read(&path).expect("it is there");
        std::fs::write(&path, &bytes[..bytes.len() - 8]).expect("it is written");
        assert!(load("a picture").is_err(), "a cut file is refused");
    }

    #[test]
    fn the_state_of_another_build_is_refused_or_gone_on_with_under_both_names() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr.state");
        passes().save(&path).expect("it is written");
        let load = |mix_builds| {
            let fresh = Accumulation::new("a picture".into(), &build("bb"), 2);
            Accumulation::load(&path, fresh, &Resume { build: build("bb"), mix_builds })
        };
        let error = load(false).expect_err("it is refused").to_string();
        assert!(error.contains("0.1.0+aa") && error.contains("0.1.0+bb") && error.contains("a.exr.state"), "{error}");
        let mixed = load(true).expect("knowingly");
        assert_eq!(mixed.progress.builds, [build("aa"), build("bb")]);
        assert_eq!(mixed.sums, passes().sums);
    }
}
