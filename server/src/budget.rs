//! Memory that requests under way may take: bytes of bodies that arrive and of answers that leave.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use tokio::sync::Notify;

/// Bytes that all requests share. What is taken comes back when its [`Share`] is dropped.
#[derive(Debug)]
pub(crate) struct Budget {
    limit: usize,
    in_use: Arc<InUse>,
}

/// What is taken, and whoever waits for less of it.
#[derive(Debug, Default)]
struct InUse {
    bytes: AtomicUsize,
    changed: Notify,
}

/// One request's part of a [`Budget`].
#[derive(Debug)]
pub(crate) struct Share {
    bytes: usize,
    in_use: Arc<InUse>,
}

impl Budget {
    /// A budget of `limit` bytes.
    pub(crate) fn new(limit: usize) -> Self {
        Self { limit, in_use: Arc::default() }
    }

    /// A share of so many bytes, if they are left.
    pub(crate) fn take(&self, bytes: usize) -> Option<Share> {
        let fits = |used: usize| used.checked_add(bytes).filter(|sum| *sum <= self.limit);
        self.in_use.bytes.fetch_update(Ordering::AcqRel, Ordering::Acquire, fits).ok()?;
        Some(Share { bytes, in_use: Arc::clone(&self.in_use) })
    }

    /// A share of so many bytes, once they are left: never if that is more than the whole budget.
    pub(crate) async fn wait_for(&self, bytes: usize) -> Share {
        loop {
            // It hears of every change from here on.
            let changed = self.in_use.changed.notified();
            if let Some(share) = self.take(bytes) {
                return share;
            }
            changed.await;
        }
    }

    /// Bytes in use.
    pub(crate) fn used(&self) -> usize {
        self.in_use.bytes.load(Ordering::Acquire)
    }
}

impl Share {
    /// Counts so many bytes from here on, even beyond the budget: an answer that is there already is not thrown away, but nobody new gets
    /// in until it has left.
    pub(crate) fn resize(&mut self, bytes: usize) {
        self.in_use.bytes.fetch_add(bytes, Ordering::AcqRel);
        self.in_use.bytes.fetch_sub(self.bytes, Ordering::AcqRel);
        self.bytes = bytes;
        self.in_use.changed.notify_waiters();
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.in_use.bytes.fetch_sub(self.bytes, Ordering::AcqRel);
        self.in_use.changed.notify_waiters();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_is_missing_until_it_comes_back() {
        let budget = Budget::new(10);
        let first = budget.take(6);
        assert!(first.is_some() && budget.take(5).is_none() && budget.take(usize::MAX).is_none());
        let second = budget.take(4);
        assert_eq!(budget.used(), 10);
        drop(first);
        assert_eq!(budget.used(), 4);
        let Some(mut second) = second else { panic!("4 of 4 bytes were left") };
        second.resize(12);
        assert_eq!(budget.used(), 12);
        assert!(budget.take(0).is_none(), "an answer beyond the budget keeps others out");
        drop(second);
        assert_eq!(budget.used(), 0);
    }

    #[tokio::test]
    async fn who_waits_gets_a_share_once_it_is_left() {
        let budget = Budget::new(10);
        let first = budget.take(6);
        let leave = async {
            tokio::task::yield_now().await;
            drop(first);
        };
        let (second, ()) = tokio::join!(budget.wait_for(5), leave);
        assert_eq!(second.bytes, 5);
    }

    #[test]
    fn many_takers_never_get_more_than_there_is() {
        let budget = Budget::new(100);
        // Every share is held until all takers have ended: one that comes back early may be taken again.
        let taken: Vec<Share> = std::thread::scope(|scope| {
            let threads: Vec<_> =
                (0..8).map(|_| scope.spawn(|| (0..1000).map(|_| budget.take(7)).collect::<Vec<_>>())).collect();
            let ended: Vec<_> = threads.into_iter().map(|thread| thread.join().unwrap_or_default()).collect();
            ended.into_iter().flatten().flatten().collect()
        });
        assert_eq!((taken.len(), budget.used()), (14, 98));
        drop(taken);
        assert_eq!(budget.used(), 0);
    }
}
