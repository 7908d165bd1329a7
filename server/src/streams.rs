//! Streams of scans in which only the latest one counts, as in a simulation that runs on while an answer is made.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

/// Of each stream the one scan that waits for a worker.
#[derive(Debug, Default)]
pub(crate) struct Streams {
    waiting: Mutex<Waiting>,
}

#[derive(Debug, Default)]
struct Waiting {
    /// By the stream's id: the number of the scan's place, and how to tell it that a later one has come.
    places: HashMap<String, (u64, oneshot::Sender<()>)>,
    last_number: u64,
}

/// A scan's place in its stream while it waits; dropped when it is begun.
#[derive(Debug)]
pub(crate) struct Place {
    streams: Arc<Streams>,
    id: String,
    number: u64,
}

/// Completes with `Ok` if a later scan takes the place, with an error if the scan is begun.
pub(crate) type Superseded = oneshot::Receiver<()>;

impl Streams {
    /// Takes the stream's place, from an earlier scan if that still waits.
    pub(crate) fn enter(self: &Arc<Self>, id: &str) -> (Place, Superseded) {
        let (tell, superseded) = oneshot::channel();
        let mut waiting = self.lock();
        waiting.last_number += 1;
        let number = waiting.last_number;
        if let Some((_, earlier)) = waiting.places.insert(id.into(), (number, tell)) {
            // Its client may have gone.
            let _ = earlier.send(());
        }
        (Place { streams: Arc::clone(self), id: id.into(), number }, superseded)
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut waiting = self.streams.lock();
        if waiting.places.get(&self.id).is_some_and(|(number, _)| *number == self.number) {
            waiting.places.remove(&self.id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_later_scan_takes_the_place_of_one_that_waits_but_not_of_one_that_is_begun() {
        let streams = Arc::new(Streams::default());
        let (first, first_superseded) = streams.enter("ego");
        let (other, other_superseded) = streams.enter("other");
        let (second, second_superseded) = streams.enter("ego");
        assert!(first_superseded.await.is_ok());
        // That the first one leaves its place, which is no longer its own, changes nothing for the second.
        drop(first);
        drop(second);
        assert!(second_superseded.await.is_err());
        let (third, mut third_superseded) = streams.enter("ego");
        assert!(third_superseded.try_recv().is_err());
        drop((third, other));
        assert!(other_superseded.await.is_err());
        assert!(streams.lock().places.is_empty(), "nothing is left of streams that have ended");
    }
}
