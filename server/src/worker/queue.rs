//! A bounded queue between those who ask and those who work.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Items in the order in which they came. Items that nobody wants any more make room for others.
#[derive(Debug)]
pub(super) struct Queue<T> {
    state: Mutex<State<T>>,
    not_empty: Condvar,
    room: usize,
}

#[derive(Debug)]
struct State<T> {
    items: VecDeque<T>,
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
    /// A queue in which `room` items may wait.
    pub(super) fn new(room: usize) -> Self {
        Self { state: Mutex::new(State { items: VecDeque::new(), closed: false }), not_empty: Condvar::new(), room }
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

    /// The next item that is wanted, once there is one; `None` at the end.
    pub(super) fn pop(&self) -> Option<T> {
        let mut state = self.lock();
        loop {
            while let Some(item) = state.items.pop_front() {
                if item.is_wanted() {
                    return Some(item);
                }
            }
            if state.closed {
                return None;
            }
            state = self.not_empty.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
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
        let queue = Queue::new(3);
        for item in [Item(1, true), Item(2, false), Item(3, true)] {
            assert_eq!(queue.push(item), Ok(()));
        }
        // The unwanted one gives its place away.
        assert_eq!(queue.push(Item(4, true)), Ok(()));
        assert_eq!(queue.push(Item(5, true)), Err(Refused::Full));
        assert!(!queue.has_room());
        queue.close();
        assert_eq!(queue.push(Item(6, true)), Err(Refused::Closed));
        let left: Vec<_> = std::iter::from_fn(|| queue.pop()).map(|item| item.0).collect();
        assert_eq!(left, [1, 3, 4]);
    }
}
