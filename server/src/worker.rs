//! Worker threads: each owns its own tools, takes inputs from one bounded queue and sends each output back to whoever waits for it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, Receiver, SyncSender, TrySendError};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use thiserror::Error;
use tokio::sync::oneshot;

/// Threads that turn inputs `I` into outputs `O`. Dropping the pool lets them finish what they have begun, and waits for it.
#[derive(Debug)]
pub struct Pool<I, O> {
    /// `None` only while the pool is dropped.
    queue: Option<SyncSender<Task<I, O>>>,
    threads: Vec<JoinHandle<()>>,
}

/// How many threads a pool has, and how many inputs may wait for them.
#[derive(Clone, Debug)]
pub struct Size {
    /// What the threads are called in a debugger.
    pub name: String,
    /// Threads.
    pub workers: usize,
    /// Inputs that may wait.
    pub queue: usize,
}

/// An output and how long its input waited for a thread.
#[derive(Debug)]
pub struct Done<O> {
    /// The output.
    pub output: O,
    /// Time in the queue.
    pub queued_for: Duration,
}

/// An input without an output.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum PoolError {
    /// As many inputs wait as may.
    #[error("the queue is full")]
    Full,
    /// The work panicked; the worker's tools are made anew for the next input.
    #[error("the work panicked")]
    Panicked,
    /// A worker could not make its tools anew.
    #[error("the worker could not be rebuilt")]
    NotRebuilt,
    /// The pool ends.
    #[error("the pool has ended")]
    Ended,
}

#[derive(Debug)]
struct Task<I, O> {
    input: I,
    queued_at: Instant,
    reply: oneshot::Sender<Result<Done<O>, PoolError>>,
}

impl<I: Send + 'static, O: Send + 'static> Pool<I, O> {
    /// Starts the threads and returns once each has made its tools: `build` gives the function that does the work, and is called on
    /// the worker's thread, at the start and after a panic.
    pub fn start<W, E>(size: &Size, build: impl Fn() -> Result<W, E> + Send + Sync + 'static) -> Result<Self, E>
    where
        W: FnMut(I) -> O + 'static,
        E: Send + std::fmt::Display + 'static,
    {
        let (queue, tasks) = mpsc::sync_channel(size.queue.max(1));
        let (tasks, build) = (Arc::new(Mutex::new(tasks)), Arc::new(build));
        let (ready, built) = mpsc::channel();
        let mut pool = Self { queue: Some(queue), threads: Vec::new() };
        for _ in 0..size.workers.max(1) {
            let (tasks, build, ready) = (Arc::clone(&tasks), Arc::clone(&build), ready.clone());
            let worker = move || {
                let (work, outcome) = match build() {
                    Ok(work) => (Some(work), Ok(())),
                    Err(error) => (None, Err(error)),
                };
                let failed = work.is_none();
                // Whoever started the pool has gone only if another worker failed.
                if ready.send(outcome).is_ok() && !failed {
                    serve(&tasks, work, &*build);
                }
            };
            let thread = thread::Builder::new().name(size.name.clone()).spawn(worker);
            // Without threads the process cannot do anything at all; the standard library's own `spawn` panics here too.
            pool.threads.push(thread.unwrap_or_else(|error| panic!("no thread for a worker: {error}")));
        }
        built.iter().take(pool.threads.len()).collect::<Result<(), E>>()?;
        Ok(pool)
    }

    /// Hands an input over and waits for its output. If the caller stops waiting, an input that no worker has begun is skipped.
    pub async fn run(&self, input: I) -> Result<Done<O>, PoolError> {
        let (reply, answer) = oneshot::channel();
        let queue = self.queue.as_ref().ok_or(PoolError::Ended)?;
        queue.try_send(Task { input, queued_at: Instant::now(), reply }).map_err(|error| match error {
            TrySendError::Full(_) => PoolError::Full,
            TrySendError::Disconnected(_) => PoolError::Ended,
        })?;
        answer.await.unwrap_or(Err(PoolError::Ended))
    }
}

impl<I, O> Drop for Pool<I, O> {
    fn drop(&mut self) {
        self.queue = None;
        for thread in self.threads.drain(..) {
            // A worker that panicked outside its work has said so on stderr.
            let _ = thread.join();
        }
    }
}

/// Works off tasks until the queue ends.
fn serve<I, O, W, E>(tasks: &Mutex<Receiver<Task<I, O>>>, mut work: Option<W>, build: &impl Fn() -> Result<W, E>)
where
    W: FnMut(I) -> O,
    E: std::fmt::Display,
{
    loop {
        let next = tasks.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(task) = next else { return };
        if task.reply.is_closed() {
            continue;
        }
        let queued_for = task.queued_at.elapsed();
        if work.is_none() {
            match build() {
                Ok(rebuilt) => work = Some(rebuilt),
                Err(error) => tracing::error!("a worker could not be rebuilt: {error}"),
            }
        }
        let answer = match &mut work {
            None => Err(PoolError::NotRebuilt),
            // What a panic leaves half done is thrown away below.
            Some(work) => match catch_unwind(AssertUnwindSafe(|| work(task.input))) {
                Ok(output) => Ok(Done { output, queued_for }),
                Err(_) => Err(PoolError::Panicked),
            },
        };
        if answer.as_ref().is_err_and(|error| *error == PoolError::Panicked) {
            work = None;
        }
        // The caller may have gone meanwhile.
        let _ = task.reply.send(answer);
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    fn size(queue: usize) -> Size {
        Size { name: "test".into(), workers: 1, queue }
    }

    #[tokio::test]
    async fn a_panic_fails_its_own_input_and_the_worker_is_built_anew() -> Result<(), PoolError> {
        let built = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&built);
        let build = move || {
            let number = counter.fetch_add(1, Ordering::SeqCst);
            Ok::<_, Infallible>(move |input: usize| {
                assert!(input != 13, "13 is not for me");
                (number, input)
            })
        };
        let Ok(pool) = Pool::start(&size(4), build);
        assert_eq!(pool.run(1).await?.output, (0, 1));
        assert_eq!(pool.run(13).await.err(), Some(PoolError::Panicked));
        assert_eq!(pool.run(2).await?.output, (1, 2));
        assert_eq!(built.load(Ordering::SeqCst), 2);
        Ok(())
    }

    #[tokio::test]
    async fn a_worker_that_cannot_be_built_anew_says_so_and_tries_again() -> Result<(), Box<dyn std::error::Error>> {
        let builds = AtomicUsize::new(0);
        let build = move || match builds.fetch_add(1, Ordering::SeqCst) {
            1 => Err("no tools today"),
            _ => Ok(|input: usize| assert!(input != 13, "13 is not for me")),
        };
        let pool = Pool::start(&size(4), build)?;
        assert_eq!(pool.run(13).await.err(), Some(PoolError::Panicked));
        assert_eq!(pool.run(1).await.err(), Some(PoolError::NotRebuilt));
        pool.run(1).await?;
        Ok(())
    }

    #[tokio::test]
    async fn a_full_queue_turns_away_and_who_has_left_is_skipped() -> Result<(), PoolError> {
        let (go, wait) = mpsc::channel::<()>();
        let wait = Arc::new(Mutex::new(wait));
        let done = Arc::new(Mutex::new(Vec::new()));
        let record = Arc::clone(&done);
        let build = move || {
            let (wait, record) = (Arc::clone(&wait), Arc::clone(&record));
            Ok::<_, Infallible>(move |input: usize| {
                let _ = wait.lock().unwrap_or_else(PoisonError::into_inner).recv();
                record.lock().unwrap_or_else(PoisonError::into_inner).push(input);
            })
        };
        let Ok(pool) = Pool::start(&size(1), build);
        let pool = Arc::new(pool);
        let ask = |input| {
            let pool = Arc::clone(&pool);
            tokio::spawn(async move { pool.run(input).await.map(|done| done.output) })
        };
        let first = ask(1);
        // The worker has taken the first input once the second one finds room.
        let second = loop {
            tokio::task::yield_now().await;
            let second = ask(2);
            tokio::time::sleep(Duration::from_millis(20)).await;
            if !second.is_finished() {
                break second;
            }
        };
        assert_eq!(pool.run(3).await.err(), Some(PoolError::Full));
        second.abort();
        assert!(second.await.is_err_and(|error| error.is_cancelled()));
        let _ = go.send(());
        assert_eq!(first.await.ok(), Some(Ok(())));
        // The second one frees its place without being worked on; `go` releases only one more.
        let fourth = loop {
            let fourth = ask(4);
            tokio::time::sleep(Duration::from_millis(20)).await;
            if !fourth.is_finished() {
                break fourth;
            }
        };
        let _ = go.send(());
        assert_eq!(fourth.await.ok(), Some(Ok(())));
        assert_eq!(*done.lock().unwrap_or_else(PoisonError::into_inner), [1, 4]);
        Ok(())
    }

    #[test]
    fn a_pool_whose_tools_cannot_be_made_does_not_start() {
        let build = || Err::<fn(usize), _>("no tools");
        assert_eq!(Pool::<usize, ()>::start(&size(1), build).err(), Some("no tools"));
    }
}
