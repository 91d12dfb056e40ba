//! Sizes of submissions that leave an adapter to others.

use std::ops::RangeInclusive;
use std::time::Duration;

/// A slice that takes longer makes the next one smaller.
const SLICE_SECONDS: f64 = 0.1;

/// A size of slices of work that follows the adapter's speed: it starts small, and grows while slices stay below a third of a tenth of a second.
#[derive(Debug, Clone)]
pub struct Slices {
    size: usize,
    range: RangeInclusive<usize>,
}

impl Slices {
    /// Slices that begin with a size and stay in a range.
    pub fn within(size: usize, range: RangeInclusive<usize>) -> Self {
        Self { size, range }
    }

    /// Work of the next slice.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Follows the time that the last slice took.
    pub fn adapt(&mut self, elapsed: Duration) {
        let seconds = elapsed.as_secs_f64();
        if seconds > SLICE_SECONDS {
            self.size /= 2;
        } else if seconds < SLICE_SECONDS / 3.0 {
            self.size *= 2;
        }
        self.size = self.size.clamp(*self.range.start(), *self.range.end());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_follow_the_time_and_stay_in_their_range() {
        let mut slices = Slices::within(64, 16..=256);
        let mut after = |milliseconds| {
            slices.adapt(Duration::from_millis(milliseconds));
            slices.size()
        };
        let sizes = [1, 1, 1, 50, 200, 200, 200, 200, 200].map(&mut after);
        assert_eq!(sizes, [128, 256, 256, 256, 128, 64, 32, 16, 16]);
    }
}
