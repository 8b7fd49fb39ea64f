//! Latest-value slots between two threads: the reader sees only the newest. [`Slot`] wakes a reader that waits for large
//! values; [`Latest`] is for the controller, who waits for nobody and allocates nothing.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

/// A slot for values that are copied. The lock is held for the copy alone, less than a microsecond; the `try_` side
/// does not wait even for that.
pub struct Latest<T>(Mutex<(u64, Option<T>)>);

impl<T> Default for Latest<T> {
    fn default() -> Self {
        Latest(Mutex::new((0, None)))
    }
}

impl<T: Clone> Latest<T> {
    /// Replaces the value.
    pub fn put(&self, value: T) {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *held = (held.0 + 1, Some(value));
    }

    /// Replaces the value unless the other side is at it; says whether it did.
    pub fn try_put(&self, value: T) -> bool {
        let Some(mut held) = try_lock(&self.0) else { return false };
        *held = (held.0 + 1, Some(value));
        true
    }

    /// The newest value, if any was put.
    pub fn latest(&self) -> Option<T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).1.clone()
    }

    /// Updates `mine` if there is one newer than generation `seen`. While the other side is at it, `mine` stays.
    pub fn try_update(&self, seen: &mut u64, mine: &mut Option<T>) {
        if let Some(held) = try_lock(&self.0)
            && held.0 != *seen
        {
            *seen = held.0;
            mine.clone_from(&held.1);
        }
    }
}

/// Locks if nobody else has; a panic elsewhere does not make the value unusable here.
pub fn try_lock<T>(mutex: &Mutex<T>) -> Option<MutexGuard<'_, T>> {
    match mutex.try_lock() {
        Ok(guard) => Some(guard),
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}

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
    }

    #[test]
    fn a_reader_that_does_not_wait_keeps_what_it_has_while_the_writer_is_at_it() {
        let (slot, mut seen, mut mine) = (Latest::default(), 0, None);
        slot.put(1);
        slot.try_update(&mut seen, &mut mine);
        assert!(slot.try_put(2));
        let writing = slot.0.lock().unwrap();
        slot.try_update(&mut seen, &mut mine);
        assert_eq!(mine, Some(1));
        assert!(!slot.try_put(3));
        drop(writing);
        slot.try_update(&mut seen, &mut mine);
        assert_eq!((mine, slot.latest()), (Some(2), Some(2)));
    }
}
