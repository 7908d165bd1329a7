//! Worker threads: each owns its own tools, takes work from one bounded queue and sends each output back to whoever waits for it.

mod queue;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, mpsc};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use thiserror::Error;
use tokio::sync::oneshot;

use queue::{Queue, Refused, Wanted};

/// Threads that work with tools `T`. Dropping the pool lets them finish what they have begun, and waits for it.
#[derive(Debug)]
pub struct Pool<T> {
    queue: Arc<Queue<Order<T>>>,
    threads: Vec<JoinHandle<()>>,
}

/// How many threads a pool has, and how much work may wait for them.
#[derive(Clone, Debug)]
pub struct Size {
    /// What the threads are called in a debugger.
    pub name: String,
    /// Threads.
    pub workers: usize,
    /// Pieces of work that may wait while all threads work.
    pub queue: usize,
}

/// An output and how long its work waited for a thread.
#[derive(Debug)]
pub struct Done<O> {
    /// The output.
    pub output: O,
    /// Time in the queue.
    pub queued_for: Duration,
}

/// What work will give.
pub(crate) type Outcome<O> = oneshot::Receiver<Result<Done<O>, PoolError>>;

/// Work without an output.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum PoolError {
    /// As much work waits as may.
    #[error("the queue is full")]
    Full,
    /// The work panicked; the worker's tools are made anew for the next.
    #[error("the work panicked")]
    Panicked,
    /// A worker could not make its tools anew.
    #[error("the worker could not be rebuilt")]
    NotRebuilt,
    /// The pool ends.
    #[error("the pool has ended")]
    Ended,
}

/// Whoever waits for an output.
#[derive(Clone, Copy)]
pub struct Caller<'a>(&'a dyn Fn() -> bool);

/// Work in the queue.
struct Order<T>(Box<dyn Work<T>>);

/// Work with its output's way home.
struct Errand<F, O> {
    work: F,
    queued_at: Instant,
    reply: oneshot::Sender<Result<Done<O>, PoolError>>,
}

/// What a worker needs to know of work.
trait Work<T>: Send {
    fn is_wanted(&self) -> bool;
    /// Does the work, says so by `rest`, and sends the output, or the reason why there are no tools: whoever has his answer finds a worker
    /// with nothing to do. Says whether the tools are still good.
    fn run(self: Box<Self>, tools: Result<&mut T, PoolError>, rest: &dyn Fn()) -> bool;
}

impl<T: 'static> Pool<T> {
    /// Starts the threads and returns once each has made its tools: `build` is called on the worker's thread, at the start and after a
    /// panic.
    pub fn start<E>(size: &Size, build: impl Fn() -> Result<T, E> + Send + Sync + 'static) -> Result<Self, E>
    where
        E: Send + std::fmt::Display + 'static,
    {
        let (queue, build) = (Arc::new(Queue::new(size.queue, size.workers.max(1))), Arc::new(build));
        let (ready, built) = mpsc::channel();
        let mut pool = Self { queue, threads: Vec::new() };
        for _ in 0..size.workers.max(1) {
            let (queue, build, ready) = (Arc::clone(&pool.queue), Arc::clone(&build), ready.clone());
            let worker = move || {
                let (tools, outcome) = match build() {
                    Ok(tools) => (Some(tools), Ok(())),
                    Err(error) => (None, Err(error)),
                };
                let failed = tools.is_none();
                // Whoever started the pool has gone only if another worker failed.
                if ready.send(outcome).is_ok() && !failed {
                    serve(&queue, tools, &*build);
                }
            };
            let thread = thread::Builder::new().name(size.name.clone()).spawn(worker);
            // Without threads the process cannot do anything at all; the standard library's own `spawn` panics here too.
            pool.threads.push(thread.unwrap_or_else(|error| panic!("no thread for a worker: {error}")));
        }
        built.iter().take(pool.threads.len()).collect::<Result<(), E>>()?;
        Ok(pool)
    }

    /// Has work done and waits for its output. If the caller stops waiting, work that no worker has begun is skipped, and work that one
    /// has begun is told so when it asks.
    pub async fn run<O: Send + 'static>(
        &self,
        work: impl FnOnce(&mut T, Caller<'_>) -> O + Send + 'static,
    ) -> Result<Done<O>, PoolError> {
        self.begin(work)?.await.unwrap_or(Err(PoolError::Ended))
    }

    /// Has work done; whoever drops what is returned has stopped waiting.
    pub(crate) fn begin<O: Send + 'static>(
        &self,
        work: impl FnOnce(&mut T, Caller<'_>) -> O + Send + 'static,
    ) -> Result<Outcome<O>, PoolError> {
        let (reply, answer) = oneshot::channel();
        let errand = Errand { work, queued_at: Instant::now(), reply };
        let pushed = self.queue.push(Order(Box::new(errand)));
        pushed.map(|()| answer).map_err(|refused| match refused {
            Refused::Full => PoolError::Full,
            Refused::Closed => PoolError::Ended,
        })
    }

    /// True if work would be taken now.
    pub fn has_room(&self) -> bool {
        self.queue.has_room()
    }

    /// Pieces of work that wait.
    pub fn waiting(&self) -> usize {
        self.queue.len()
    }
}

impl Caller<'_> {
    /// One who never leaves.
    pub const PATIENT: Self = Self(&|| false);

    /// True once nobody waits for the output any more.
    pub fn has_left(self) -> bool {
        self.0()
    }
}

impl<T> Drop for Pool<T> {
    fn drop(&mut self) {
        self.queue.close();
        let this = thread::current().id();
        // Work may be the last to hold its own pool: a worker does not wait for itself.
        for thread in self.threads.drain(..).filter(|thread| thread.thread().id() != this) {
            // A worker that panicked outside its work has said so on stderr.
            let _ = thread.join();
        }
    }
}

impl<T> Wanted for Order<T> {
    fn is_wanted(&self) -> bool {
        self.0.is_wanted()
    }
}

impl<T, O, F> Work<T> for Errand<F, O>
where
    O: Send,
    F: FnOnce(&mut T, Caller<'_>) -> O + Send,
{
    fn is_wanted(&self) -> bool {
        !self.reply.is_closed()
    }

    fn run(self: Box<Self>, tools: Result<&mut T, PoolError>, rest: &dyn Fn()) -> bool {
        let Self { work, queued_at, reply } = *self;
        let queued_for = queued_at.elapsed();
        let has_left = || reply.is_closed();
        let answer = tools.and_then(|tools| {
            // What a panic leaves half done is thrown away with the tools.
            catch_unwind(AssertUnwindSafe(|| work(tools, Caller(&has_left)))).map_err(|_| PoolError::Panicked)
        });
        let good = answer.as_ref().err() != Some(&PoolError::Panicked);
        rest();
        // The caller may have gone meanwhile.
        let _ = reply.send(answer.map(|output| Done { output, queued_for }));
        good
    }
}

impl<T> std::fmt::Debug for Order<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Order")
    }
}

/// Works off the queue until it ends.
fn serve<T, E: std::fmt::Display>(queue: &Queue<Order<T>>, mut tools: Option<T>, build: &impl Fn() -> Result<T, E>) {
    while let Some(Order(work)) = queue.pop() {
        if tools.is_none() {
            match build() {
                Ok(rebuilt) => tools = Some(rebuilt),
                Err(error) => tracing::error!("a worker could not be rebuilt: {error}"),
            }
        }
        if !work.run(tools.as_mut().ok_or(PoolError::NotRebuilt), &|| queue.rest()) {
            tools = None;
        }
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

    fn fails_at_13(tools: &mut usize, input: usize) -> (usize, usize) {
        assert!(input != 13, "13 is not for me");
        (*tools, input)
    }

    #[tokio::test]
    async fn a_panic_fails_its_own_work_and_the_tools_are_built_anew() -> Result<(), PoolError> {
        let built = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&built);
        let Ok(pool) = Pool::start(&size(4), move || Ok::<_, Infallible>(counter.fetch_add(1, Ordering::SeqCst)));
        assert_eq!(pool.run(|tools, _| fails_at_13(tools, 1)).await?.output, (0, 1));
        assert_eq!(pool.run(|tools, _| fails_at_13(tools, 13)).await.err(), Some(PoolError::Panicked));
        assert_eq!(pool.run(|tools, _| fails_at_13(tools, 2)).await?.output, (1, 2));
        assert_eq!(built.load(Ordering::SeqCst), 2);
        Ok(())
    }

    #[tokio::test]
    async fn a_worker_that_cannot_be_built_anew_says_so_and_tries_again() -> Result<(), Box<dyn std::error::Error>> {
        let builds = AtomicUsize::new(0);
        let build = move || match builds.fetch_add(1, Ordering::SeqCst) {
            1 => Err("no tools today"),
            number => Ok(number),
        };
        let pool = Pool::start(&size(4), build)?;
        assert_eq!(pool.run(|tools, _| fails_at_13(tools, 13)).await.err(), Some(PoolError::Panicked));
        assert_eq!(pool.run(|tools, _| fails_at_13(tools, 1)).await.err(), Some(PoolError::NotRebuilt));
        assert_eq!(pool.run(|tools, _| fails_at_13(tools, 1)).await?.output, (2, 1));
        Ok(())
    }

    /// A pool of one worker that is busy until `go` is sent, and its first work.
    async fn busy(queue: usize) -> (Arc<Pool<()>>, oneshot::Sender<()>, tokio::task::JoinHandle<bool>) {
        let Ok(pool) = Pool::start(&size(queue), || Ok::<_, Infallible>(()));
        let pool = Arc::new(pool);
        let (go, wait) = oneshot::channel::<()>();
        let (begin, begun) = oneshot::channel();
        let busy = Arc::clone(&pool);
        let first = tokio::spawn(async move {
            let work = move |(): &mut (), caller: Caller<'_>| {
                let _ = begin.send(());
                let _ = wait.blocking_recv();
                caller.has_left()
            };
            busy.run(work).await.is_ok_and(|done| done.output)
        });
        assert!(begun.await.is_ok());
        (pool, go, first)
    }

    #[tokio::test]
    async fn a_full_queue_turns_away_and_who_has_left_makes_room() -> Result<(), PoolError> {
        let (pool, go, first) = busy(1).await;
        let ran = Arc::new(AtomicUsize::new(0));
        let ask = |number: usize| {
            let (pool, ran) = (Arc::clone(&pool), Arc::clone(&ran));
            tokio::spawn(async move { pool.run(move |(), _| ran.fetch_add(number, Ordering::SeqCst)).await.map(drop) })
        };
        let second = ask(2);
        while pool.waiting() == 0 {
            tokio::task::yield_now().await;
        }
        assert!(!pool.has_room());
        assert_eq!(pool.run(|(), _| ()).await.err(), Some(PoolError::Full));
        second.abort();
        assert!(second.await.is_err_and(|error| error.is_cancelled()));
        assert!(pool.has_room());
        let fourth = ask(4);
        while pool.waiting() == 0 {
            tokio::task::yield_now().await;
        }
        let _ = go.send(());
        assert_eq!(first.await.ok(), Some(false));
        assert_eq!(fourth.await.ok(), Some(Ok(())));
        assert_eq!(ran.load(Ordering::SeqCst), 4, "the second one was not worked on");
        Ok(())
    }

    #[tokio::test]
    async fn work_under_way_learns_that_its_caller_has_left() -> Result<(), Box<dyn std::error::Error>> {
        let Ok(pool) = Pool::start(&size(1), || Ok::<_, Infallible>(()));
        let (begin, begun) = oneshot::channel();
        let (told, learned) = oneshot::channel();
        let work = move |(): &mut (), caller: Caller<'_>| {
            let stayed = !caller.has_left();
            let _ = begin.send(());
            let until = Instant::now() + Duration::from_secs(20);
            while !caller.has_left() && Instant::now() < until {
                thread::yield_now();
            }
            let _ = told.send((stayed, caller.has_left()));
        };
        tokio::select! {
            _ = pool.run(work) => return Err("nobody has told the work to end".into()),
            begun = begun => begun?,
        }
        assert_eq!(learned.await?, (true, true));
        Ok(())
    }

    #[test]
    fn a_pool_whose_tools_cannot_be_made_does_not_start() {
        assert_eq!(Pool::<usize>::start(&size(1), || Err("no tools")).err(), Some("no tools"));
    }
}
