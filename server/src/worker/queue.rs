//! A bounded queue between those who ask and those who work.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Items in the order in which they came, as many as may wait and as workers have nothing to do. Items that nobody wants any more make room for others.
#[derive(Debug)]
pub(super) struct Queue<T> {
    state: Mutex<State<T>>,
    not_empty: Condvar,
    room: usize,
}

#[derive(Debug)]
struct State<T> {
    items: VecDeque<T>,
    /// Workers that have nothing to do: each may have an item beyond those that wait.
    idle: usize,
    closed: bool,
}

/// Why an item was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refused {
    Full,
    Closed,
}

/// What somebody may stop wanting.
pub(super) trait Wanted {
    fn is_wanted(&self) -> bool;
}

impl<T: Wanted> Queue<T> {
    /// A queue in which `room` items may wait for so many workers, who have nothing to do yet.
    pub(super) fn new(room: usize, workers: usize) -> Self {
        let state = State { items: VecDeque::new(), idle: workers, closed: false };
        Self { state: Mutex::new(state), not_empty: Condvar::new(), room }
    }

    pub(super) fn push(&self, item: T) -> Result<(), Refused> {
        let mut state = self.lock();
        if state.closed {
            return Err(Refused::Closed);
        }
        if !state.has_room(self.room) {
            return Err(Refused::Full);
        }
        state.items.push_back(item);
        self.not_empty.notify_one();
        Ok(())
    }

    /// The next item that is wanted, once there is one; `None` at the end. Whoever has it is busy until he [rests](Self::rest).
    pub(super) fn pop(&self) -> Option<T> {
        let mut state = self.lock();
        loop {
            while let Some(item) = state.items.pop_front() {
                if item.is_wanted() {
                    state.idle -= 1;
                    return Some(item);
                }
            }
            if state.closed {
                return None;
            }
            state = self.not_empty.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// A worker has nothing to do any more.
    pub(super) fn rest(&self) {
        self.lock().idle += 1;
    }

    /// True if an item would be taken now.
    pub(super) fn has_room(&self) -> bool {
        self.lock().has_room(self.room)
    }

    /// Items that wait.
    pub(super) fn len(&self) -> usize {
        self.lock().items.len()
    }

    /// Takes no more items; what waits is still worked off.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.not_empty.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Wanted> State<T> {
    fn has_room(&mut self, room: usize) -> bool {
        let room = room + self.idle;
        if self.items.len() >= room {
            self.items.retain(T::is_wanted);
        }
        self.items.len() < room
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq)]
    struct Item(u8, bool);

    impl Wanted for Item {
        fn is_wanted(&self) -> bool {
            self.1
        }
    }

    #[test]
    fn items_come_out_in_their_order_and_what_is_not_wanted_does_not_come_out() {
        // Two wait, and one is for the worker.
        let queue = Queue::new(2, 1);
        for item in [Item(1, true), Item(2, false), Item(3, true)] {
            assert_eq!(queue.push(item), Ok(()));
        }
        // The unwanted one gives its place away.
        assert_eq!(queue.push(Item(4, true)), Ok(()));
        assert_eq!(queue.push(Item(5, true)), Err(Refused::Full));
        assert!(!queue.has_room());
        queue.close();
        assert_eq!(queue.push(Item(6, true)), Err(Refused::Closed));
        let left: Vec<_> = std::iter::from_fn(|| queue.pop().inspect(|_| queue.rest())).map(|item| item.0).collect();
        assert_eq!(left, [1, 3, 4]);
    }

    #[test]
    fn where_nothing_may_wait_only_a_worker_without_work_takes_an_item() {
        let queue = Queue::new(0, 1);
        assert_eq!(queue.push(Item(1, true)), Ok(()));
        assert_eq!(queue.push(Item(2, true)), Err(Refused::Full), "the worker has not taken the first one yet");
        assert_eq!(queue.pop(), Some(Item(1, true)));
        assert_eq!(queue.push(Item(3, true)), Err(Refused::Full), "it is busy");
        queue.rest();
        assert_eq!(queue.push(Item(4, true)), Ok(()));
        assert_eq!(queue.pop(), Some(Item(4, true)));
    }
}
