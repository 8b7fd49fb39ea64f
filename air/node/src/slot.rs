//! A latest-value slot between two threads: the writer never waits for the reader, the reader sees only the newest.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

struct Inner<T> {
    value: Option<Arc<T>>,
    generation: u64,
}

/// The slot. Clones share it.
pub struct Slot<T>(Arc<(Mutex<Inner<T>>, Condvar)>);

impl<T> Clone for Slot<T> {
    fn clone(&self) -> Self {
        Slot(Arc::clone(&self.0))
    }
}

impl<T> Default for Slot<T> {
    fn default() -> Self {
        Slot(Arc::new((Mutex::new(Inner { value: None, generation: 0 }), Condvar::new())))
    }
}

impl<T> Slot<T> {
    /// Replaces the value and wakes a waiting reader.
    pub fn put(&self, value: Arc<T>) {
        let previous = {
            let mut inner = self.lock();
            inner.generation += 1;
            inner.value.replace(value)
        };
        drop(previous); // freed outside the lock
        self.0.1.notify_one();
    }

    /// The newest value, if any was put.
    #[must_use]
    pub fn latest(&self) -> Option<Arc<T>> {
        self.lock().value.clone()
    }

    /// Waits up to `timeout` for a value newer than generation `seen`; updates `seen` and says how many were
    /// overwritten unread. None after the timeout.
    pub fn wait_newer(&self, seen: &mut u64, timeout: Duration) -> Option<(Arc<T>, u64)> {
        let (guard, _) = self
            .0
            .1
            .wait_timeout_while(self.lock(), timeout, |inner| inner.generation == *seen)
            .unwrap_or_else(PoisonError::into_inner);
        if guard.generation == *seen {
            return None;
        }
        let missed = guard.generation - *seen - 1;
        *seen = guard.generation;
        guard.value.clone().map(|value| (value, missed))
    }

    // A panicking writer cannot leave a half-written value behind: the critical sections only move pointers.
    fn lock(&self) -> MutexGuard<'_, Inner<T>> {
        self.0.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_sees_only_the_newest_and_counts_what_it_missed() {
        let slot = Slot::default();
        let mut seen = 0;
        assert!(slot.wait_newer(&mut seen, Duration::ZERO).is_none());
        for k in 0..5 {
            slot.put(Arc::new(k));
        }
        let (value, missed) = slot.wait_newer(&mut seen, Duration::ZERO).unwrap();
        assert_eq!((*value, missed), (4, 4));
        assert!(slot.wait_newer(&mut seen, Duration::ZERO).is_none());
        assert_eq!(slot.latest().as_deref(), Some(&4));
    }
}
