//! Several scans in one run: pipelines that share a session lay what they want run side by side, and the session, once it is free, takes all
//! that lies there, up to a number. Nobody waits for company.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};

use ort::session::Session;
use runtime::Threads;

use crate::generator::{self, InferenceError, OUTPUTS};
use crate::model::{Model, SessionError};
use crate::worker::{Pool, Size};

/// Sessions that pipelines share.
#[derive(Debug)]
pub(crate) struct Batches {
    sessions: Pool<Runner>,
    waiting: Arc<Mutex<VecDeque<Order>>>,
    most: usize,
}

/// Sessions to share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sharing {
    /// How many sessions.
    pub(crate) sessions: usize,
    /// Threads within an operator, for each.
    pub(crate) threads: Threads,
    /// Scans that one run may have.
    pub(crate) most: usize,
    /// How many may ask at a time; more are turned away.
    pub(crate) callers: usize,
}

/// A run's inputs, each `[batch, channel, ring, column]`; `noise` is empty where the model has none.
#[derive(Debug)]
pub(crate) struct Inputs {
    /// Batch, rings, columns.
    pub(crate) size: [usize; 3],
    pub(crate) scan: Vec<f32>,
    pub(crate) noise: Vec<f32>,
}

/// Values of each of [`OUTPUTS`].
pub(crate) type Values = [Vec<f32>; OUTPUTS.len()];

/// Inputs that wait, and the way of their outputs. The inputs go back too: their memory is used again.
#[derive(Debug)]
struct Order {
    inputs: Inputs,
    reply: mpsc::SyncSender<(Inputs, Result<Values, InferenceError>)>,
}

/// A session with memory for the inputs of a batch.
#[derive(Debug)]
struct Runner {
    session: Session,
    scan: Vec<f32>,
    noise: Vec<f32>,
}

impl Batches {
    /// Loads the model into each session.
    pub(crate) fn start(model: &Arc<Model>, sharing: Sharing) -> Result<Self, SessionError> {
        let Sharing { sessions, threads, most, callers } = sharing;
        let size = Size { name: format!("batch-{}", model.name), workers: sessions, queue: callers };
        let waiting = Arc::<Mutex<VecDeque<Order>>>::default();
        let (model, orders) = (Arc::clone(model), Arc::clone(&waiting));
        let sessions = Pool::start(&size, move || {
            // An errand that has no session takes no order: what waits fails, rather than wait for nobody.
            let session = model.session(threads).inspect_err(|_| lock(&orders).clear())?;
            Ok::<_, SessionError>(Runner { session, scan: Vec::new(), noise: Vec::new() })
        })?;
        Ok(Self { sessions, waiting, most })
    }

    /// Runs the model on the inputs, in company or alone, and gives them back with the outputs. Blocks.
    pub(crate) fn run(&self, inputs: Inputs) -> Result<(Inputs, Values), InferenceError> {
        let (reply, answer) = mpsc::sync_channel(1);
        let (waiting, most) = (Arc::clone(&self.waiting), self.most);
        let errand = {
            // Under one lock: with orders and errands in the same order, no order is left without an errand that takes it.
            let mut orders = lock(&self.waiting);
            let errand =
                self.sessions.begin(move |runner: &mut Runner, _| runner.run_all(take(&mut lock(&waiting), most)))?;
            orders.push_back(Order { inputs, reply });
            errand
        };
        let answered = answer.recv();
        // If another errand took the order, nobody wants this one any more.
        drop(errand);
        let (inputs, outputs) = answered.map_err(|_| InferenceError::Panicked)?;
        Ok((inputs, outputs?))
    }
}

/// The orders that go into the next run: those that came first, of one grid, up to `most` scans; the first one whatever its size.
fn take(waiting: &mut VecDeque<Order>, most: usize) -> Vec<Order> {
    let mut taken: Vec<Order> = waiting.pop_front().into_iter().collect();
    let mut scans: usize = taken.iter().map(|order| order.inputs.size[0]).sum();
    while let (Some(first), Some(next)) = (taken.first(), waiting.front()) {
        scans += next.inputs.size[0];
        if next.inputs.size[1..] != first.inputs.size[1..] || scans > most {
            break;
        }
        taken.extend(waiting.pop_front());
    }
    taken
}

impl Runner {
    /// Runs orders of one grid as one batch; if that fails, each alone, so that it fails only whom it concerns.
    fn run_all(&mut self, orders: Vec<Order>) {
        match self.run_together(&orders) {
            Some(outputs) => orders.into_iter().zip(outputs).for_each(|(order, outputs)| order.answer(Ok(outputs))),
            None => {
                for order in orders {
                    let Inputs { size, scan, noise } = &order.inputs;
                    let outputs = run(&mut self.session, *size, scan, noise);
                    order.answer(outputs);
                }
            }
        }
    }

    /// Each order's outputs; `None` for a single one, which needs no copy, and for a run that fails.
    fn run_together(&mut self, orders: &[Order]) -> Option<Vec<Values>> {
        let [first, _, ..] = orders else { return None };
        let [_, rings, columns] = first.inputs.size;
        self.scan.clear();
        self.noise.clear();
        for Order { inputs, .. } in orders {
            self.scan.extend_from_slice(&inputs.scan);
            self.noise.extend_from_slice(&inputs.noise);
        }
        let batch = orders.iter().map(|order| order.inputs.size[0]).sum();
        let mut rest = run(&mut self.session, [batch, rings, columns], &self.scan, &self.noise).ok()?;
        let mut outputs: Vec<Values> = orders
            .iter()
            .rev()
            .map(|order| {
                let pixels = order.inputs.size.iter().product::<usize>();
                rest.each_mut().map(|values| values.split_off(values.len() - pixels))
            })
            .collect();
        outputs.reverse();
        Some(outputs)
    }
}

impl Order {
    fn answer(self, outputs: Result<Values, InferenceError>) {
        // Whoever asked waits for this; if not, there is nobody to tell.
        let _ = self.reply.send((self.inputs, outputs));
    }
}

fn run(session: &mut Session, size: [usize; 3], scan: &[f32], noise: &[f32]) -> Result<Values, InferenceError> {
    let outputs = generator::run(session, size, scan, noise)?;
    let mut values = Values::default();
    for (values, name) in values.iter_mut().zip(OUTPUTS) {
        values.extend_from_slice(outputs.of(name)?);
    }
    Ok(values)
}

fn lock(waiting: &Mutex<VecDeque<Order>>) -> MutexGuard<'_, VecDeque<Order>> {
    waiting.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::thread;

    use lidar::ray_drop::uniform;

    use super::*;
    use crate::model::MAX_MODEL_BYTES;
    use crate::worker::PoolError;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    fn order(size: [usize; 3]) -> Order {
        let inputs = Inputs { size, scan: Vec::new(), noise: Vec::new() };
        Order { inputs, reply: mpsc::sync_channel(1).0 }
    }

    #[test]
    fn a_run_takes_who_came_first_of_one_grid_up_to_its_number() {
        let wide = [1, 16, 720];
        let sizes = [[1, 16, 360], [2, 16, 360], [1, 16, 360], wide, [1, 16, 360], [9, 16, 360], [1, 16, 360]];
        let mut waiting: VecDeque<Order> = sizes.map(order).into();
        let mut taken = || -> Vec<[usize; 3]> { take(&mut waiting, 3).iter().map(|o| o.inputs.size).collect() };
        assert_eq!(taken(), [[1, 16, 360], [2, 16, 360]]);
        assert_eq!(taken(), [[1, 16, 360]]);
        assert_eq!(taken(), [wide]);
        assert_eq!(taken(), [[1, 16, 360]]);
        assert_eq!(taken(), [[9, 16, 360]], "more than a run may have goes alone");
        assert_eq!(taken(), [[1, 16, 360]]);
        assert!(taken().is_empty());
    }

    /// Inputs that fit a model, other ones for each number.
    fn inputs(model: &Model, number: u64) -> Inputs {
        let sensor = &model.card.sensor;
        let draw = |channel| {
            let mut drawn = vec![0.0; sensor.pixels()];
            uniform(number, channel, sensor.columns(), &mut drawn);
            drawn
        };
        let range_m = draw(0).into_iter().map(|u| if u < 0.2 { 0.0 } else { 2.0 + 40.0 * u }).collect();
        let noise = (0..model.card.noise_channels as u32).flat_map(|channel| draw(2 + channel)).collect();
        let scan = [range_m, draw(1), vec![0.0; sensor.pixels()]].concat();
        Inputs { size: [1, sensor.rings().len(), sensor.columns()], scan, noise }
    }

    /// Who holds the session until he is told.
    fn occupy(batches: &Batches) -> Result<(mpsc::Sender<()>, impl Sized), Box<dyn std::error::Error>> {
        let (go, wait) = mpsc::channel::<()>();
        let (begin, begun) = mpsc::channel::<()>();
        let busy = batches.sessions.begin(move |_, _| {
            let _ = begin.send(());
            let _ = wait.recv();
        })?;
        begun.recv()?;
        Ok((go, busy))
    }

    #[test]
    fn who_comes_beyond_the_number_of_callers_is_told_so() -> Outcome {
        let file = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/models/passthrough/2/model.onnx");
        let model = Arc::new(Model::read(&file, MAX_MODEL_BYTES)?);
        let batches = Batches::start(&model, Sharing { sessions: 1, threads: 1.into(), most: 4, callers: 1 })?;
        let (go, busy) = occupy(&batches)?;
        let first = thread::scope(|scope| {
            let first = scope.spawn(|| batches.run(inputs(&model, 0)));
            while batches.sessions.has_room() {
                thread::yield_now();
            }
            let second = batches.run(inputs(&model, 1));
            assert!(matches!(second, Err(InferenceError::Refused(PoolError::Full))), "{second:?}");
            let _ = go.send(());
            first.join().map_err(|_| "panicked")
        })?;
        drop(busy);
        assert_eq!(first?.0.scan.len(), inputs(&model, 0).scan.len());
        assert!(lock(&batches.waiting).is_empty());
        Ok(())
    }

    /// Of the stand-in and of every model that we ship.
    #[test]
    fn what_waits_runs_as_one_and_each_gets_what_it_would_get_alone() -> Outcome {
        let files = [
            "tests/data/models/passthrough/2/model.onnx",
            "../models/hdl64e/3/model.onnx",
            "../models/hdl32e/3/model.onnx",
            "../models/hdl64e-cls2r/4/model.onnx",
        ];
        files.into_iter().try_for_each(together_as_alone)
    }

    fn together_as_alone(file: &str) -> Outcome {
        let file = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(file);
        let model = Arc::new(Model::read(&file, MAX_MODEL_BYTES)?);
        let batches = Batches::start(&model, Sharing { sessions: 1, threads: 2.into(), most: 4, callers: 6 })?;
        let alone = |number| Ok::<_, InferenceError>(batches.run(inputs(&model, number))?.1);
        let alone = (0..6).map(alone).collect::<Result<Vec<_>, _>>()?;
        assert!(alone[0] != alone[1]);
        let (go, busy) = occupy(&batches)?;
        let together = thread::scope(|scope| {
            let (batches, model) = (&batches, &model);
            let ask = |number| scope.spawn(move || batches.run(inputs(model, number)));
            let asked: Vec<_> = (0..6).map(ask).collect();
            while lock(&batches.waiting).len() < asked.len() {
                thread::yield_now();
            }
            let _ = go.send(());
            asked.into_iter().map(|asked| asked.join().map_err(|_| "panicked")).collect::<Result<Vec<_>, _>>()
        })?;
        drop(busy);
        for (number, outcome) in together.into_iter().enumerate() {
            let (given_back, outputs) = outcome?;
            assert!(given_back.scan == inputs(&model, number as u64).scan);
            for (output, (found, expected)) in OUTPUTS.into_iter().zip(outputs.iter().zip(&alone[number])) {
                let other =
                    found.iter().zip(expected).filter(|(found, expected)| found.to_bits() != expected.to_bits());
                assert_eq!(
                    (found.len(), other.count()),
                    (expected.len(), 0),
                    "{}: {output} of {number}",
                    file.display()
                );
            }
        }
        let last = batches.sessions.begin(|runner: &mut Runner, _| runner.scan.len())?.blocking_recv()??;
        assert_eq!(last.output, 2 * inputs(&model, 0).scan.len(), "of six, four ran first and then two");
        Ok(())
    }
}
