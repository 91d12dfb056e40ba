//! What was worked out last, by what it follows from: for what the next picture asks again.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// How often all was forgotten.
static FORGOTTEN: AtomicU64 = AtomicU64::new(0);

/// Forgets what all of them keep: for measurements of what making it takes.
pub fn forget_all() {
    FORGOTTEN.fetch_add(1, Ordering::Relaxed);
}

struct Entry<K, V> {
    key: K,
    value: V,
    /// [`FORGOTTEN`] when it was kept: it counts no more after a change.
    age: u64,
}

/// The last values by their keys, newest first; for all threads.
pub struct Recent<K, V> {
    most: usize,
    kept: Mutex<VecDeque<Entry<K, V>>>,
}

impl<K: PartialEq, V: Clone> Recent<K, V> {
    /// Room for so many values, at least 1.
    pub const fn new(most: usize) -> Self {
        Self { most, kept: Mutex::new(VecDeque::new()) }
    }

    fn kept(&self) -> MutexGuard<'_, VecDeque<Entry<K, V>>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The value of a key, where it is kept.
    pub fn get(&self, key: &K) -> Option<V> {
        let now = FORGOTTEN.load(Ordering::Relaxed);
        self.kept().iter().find(|entry| entry.age == now && entry.key == *key).map(|entry| entry.value.clone())
    }

    /// Keeps a value; the oldest goes where there is no room.
    pub fn keep(&self, key: K, value: V) {
        let mut kept = self.kept();
        kept.truncate(self.most - 1);
        kept.push_front(Entry { key, value, age: FORGOTTEN.load(Ordering::Relaxed) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_goes_and_all_are_forgotten() {
        let recent = Recent::new(2);
        for key in 0..3 {
            recent.keep(key, 10 * key);
        }
        assert_eq!([0, 1, 2].map(|key| recent.get(&key)), [None, Some(10), Some(20)]);
        forget_all();
        assert_eq!([0, 1, 2].map(|key| recent.get(&key)), [None; 3]);
        recent.keep(1, 11);
        assert_eq!(recent.get(&1), Some(11));
    }
}
