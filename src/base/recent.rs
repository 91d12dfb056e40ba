//! What was worked out last, by what it follows from: for what the next picture asks again.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The last values by their keys, newest first; for all threads.
pub struct Recent<K, V> {
    most: usize,
    kept: Mutex<VecDeque<(K, V)>>,
}

impl<K: PartialEq, V: Clone> Recent<K, V> {
    /// Room for so many values, at least 1.
    pub const fn new(most: usize) -> Self {
        Self { most, kept: Mutex::new(VecDeque::new()) }
    }

    fn kept(&self) -> MutexGuard<'_, VecDeque<(K, V)>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The value of a key, where it is kept.
    pub fn get(&self, key: &K) -> Option<V> {
        self.kept().iter().find(|(other, _)| other == key).map(|(_, value)| value.clone())
    }

    /// Keeps a value; the oldest goes where there is no room.
    pub fn keep(&self, key: K, value: V) {
        let mut kept = self.kept();
        kept.truncate(self.most - 1);
        kept.push_front((key, value));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_goes() {
        let recent = Recent::new(2);
        for key in 0..3 {
            recent.keep(key, 10 * key);
        }
        assert_eq!([0, 1, 2].map(|key| recent.get(&key)), [None, Some(10), Some(20)]);
    }
}
