//! Quality by a budget: of settings whose time and error were measured, the one of least error in a time.

/// A setting that nothing beats in time and error.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// What is set, in words.
    pub words: String,
    /// Milliseconds a pixel where it was measured.
    pub milliseconds_a_pixel: f64,
    /// relMSE and its standard error where it was measured.
    pub error: [f64; 2],
}

/// Weight of a new picture in what is known of a setting's time.
const NEW: f64 = 0.3;

/// Part of the budget below which a slower setting is taken than the one that is there: a picture is not always equally fast, and who looks
/// at it does not want it to change to and fro.
const ROOM: f64 = 0.85;

/// The front, and what its settings took here.
#[derive(Debug, Clone, Default)]
pub struct Quality {
    choices: Vec<Choice>,
    /// Milliseconds a pixel of the pictures here; none where there was none.
    here: Vec<Option<f64>>,
    /// The setting that is there.
    picked: Option<usize>,
}

impl Quality {
    /// Of a front by rising time.
    pub fn new(choices: &[Choice]) -> Self {
        Self { choices: choices.to_vec(), here: vec![None; choices.len()], picked: None }
    }

    /// The settings.
    pub fn choices(&self) -> &[Choice] {
        &self.choices
    }

    /// Takes down what a picture of a setting took.
    pub fn note(&mut self, setting: usize, milliseconds: f64, pixels: f64) {
        let Some(here) = self.here.get_mut(setting) else { return };
        let new = milliseconds / pixels.max(1.0);
        *here = Some(here.map_or(new, |old| old + NEW * (new - old)));
    }

    /// Milliseconds that a picture of a setting takes here: as the last ones of it did, or as it took where it was measured, in the
    /// proportion of the others.
    pub fn expected(&self, setting: usize, pixels: f64) -> f64 {
        let known =
            self.here[setting].unwrap_or_else(|| self.choices[setting].milliseconds_a_pixel * self.proportion());
        known * pixels
    }

    /// Time here over the time there: the geometric mean of the settings that were seen; 1 before.
    fn proportion(&self) -> f64 {
        let pairs = self.choices.iter().zip(&self.here);
        let ratios: Vec<f64> = pairs
            .filter_map(|(choice, here)| Some((*here)? / choice.milliseconds_a_pixel))
            .filter(|ratio| *ratio > 0.0)
            .collect();
        match ratios.len() {
            0 => 1.0,
            count => (ratios.iter().map(|ratio| ratio.ln()).sum::<f64>() / count as f64).exp(),
        }
    }

    /// The setting of least error that a picture of so many pixels has the time for; the fastest where there is none. None of no front.
    pub fn pick(&mut self, budget: f64, pixels: f64) -> Option<usize> {
        let fits = |setting: usize| {
            let room = if self.picked.is_some_and(|picked| setting > picked) { ROOM } else { 1.0 };
            self.expected(setting, pixels) <= budget * room
        };
        let found = (0..self.choices.len()).rev().find(|&setting| fits(setting)).unwrap_or(0);
        self.picked = Some(found).filter(|found| *found < self.choices.len());
        self.picked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn front() -> Quality {
        let choice =
            |time: f64, error| Choice { words: format!("{time}"), milliseconds_a_pixel: time, error: [error, 0.0] };
        Quality::new(&[choice(1.0, 0.5), choice(10.0, 0.1), choice(100.0, 0.01)])
    }

    #[test]
    fn a_budget_picks_the_least_error() {
        let mut quality = front();
        assert_eq!(quality.pick(50.0, 1.0), Some(1));
        assert_eq!(front().pick(50.0, 100.0), Some(0), "the fastest where there is no time for any");
        assert_eq!(front().pick(1e9, 1.0), Some(2));
        assert_eq!(Quality::default().pick(1.0, 1.0), None);
    }

    /// A machine of twice the time of the study's: known of one setting, expected of the others.
    #[test]
    fn what_is_seen_here_counts() {
        let mut quality = front();
        quality.note(0, 2.0, 1.0);
        assert_eq!(quality.expected(1, 1.0), 20.0);
        assert_eq!(quality.pick(15.0, 1.0), Some(0));
        quality.note(1, 8.0, 1.0);
        assert_eq!(quality.expected(1, 1.0), 8.0, "seen, not expected");
        assert_eq!(quality.pick(15.0, 1.0), Some(1));
    }

    /// A time about the budget leaves the setting as it is, and does not go up and down.
    #[test]
    fn it_does_not_go_to_and_fro() {
        let mut quality = front();
        assert_eq!(quality.pick(9.0, 1.0), Some(0));
        assert_eq!(quality.pick(11.0, 1.0), Some(0), "no room yet");
        assert_eq!(quality.pick(12.0, 1.0), Some(1));
        assert_eq!(quality.pick(10.0, 1.0), Some(1), "it still fits");
    }
}
