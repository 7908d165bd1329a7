//! The way of a scan, from bytes to bytes: written here once, for the service and for conversion.

use std::path::Path;
use std::sync::Arc;

use axum::body::Bytes;
use lidar::formats::{self, Format, FormatError, Limits};
use lidar::picture::PictureError;
use lidar::projection::{ProjectionError, Report};
use lidar::{EmptyRays, PointCloud, Projection, Projector, RangeImage};
use proto::open_inference::Tensor;
use proto::{Form, Frame};
use runtime::Threads;
use thiserror::Error;

use crate::batch::Batches;
use crate::coverage::Coverage;
use crate::generator::{Chance, Generator, InferenceError};
use crate::model::{Model, SessionError};
use crate::sampled::{NotANumber, SampleError, Sampled};
use crate::stopwatch::{Stage, StageTimes, Stopwatch};
use crate::tensors::{self, TensorError};
use crate::view::{self, View};
use crate::worker::Caller;

/// A model, loaded and ready, with all the memory that a scan needs on its way.
#[derive(Debug)]
pub struct Pipeline {
    model: Arc<Model>,
    projector: Projector,
    projection: Projection,
    generator: Generator,
    sampled: Sampled,
    realistic: PointCloud,
}

/// A scan to make realistic.
#[derive(Clone, Debug)]
pub struct ScanJob {
    /// The simulated scan.
    pub bytes: Bytes,
    /// Its format.
    pub format: Format,
    /// What the answer shows.
    pub answer: Form,
    /// The frame of its coordinates, and of the answer's.
    pub frame: Frame,
    /// Points of each of the model's rings, where the sender says so: the scan lists them ring after ring, from the highest to the lowest.
    pub ring_counts: Option<Vec<u32>>,
    /// What is left to chance.
    pub chance: Chance,
    /// What the reader accepts.
    pub limits: Limits,
}

/// A realistic scan.
#[derive(Clone, Debug)]
pub struct ScanAnswer {
    /// The scan, or a view of it, in the form that was asked for.
    pub bytes: Vec<u8>,
    /// How the scan fitted the model.
    pub fit: Fit,
    /// Time by stage.
    pub times: StageTimes,
}

/// A scan in a file to make realistic.
#[derive(Clone, Copy, Debug)]
pub struct FileJob {
    /// The frame of its coordinates, and of the answer's.
    pub frame: Frame,
    /// What is left to chance.
    pub chance: Chance,
    /// What the reader accepts.
    pub limits: Limits,
}

/// How a scan fitted the model, and what became of its points.
#[derive(Clone, Debug)]
pub struct Fit {
    /// What became of the points on their way into the range image.
    pub report: Report,
    /// Points of the scan that are in the answer.
    pub kept: usize,
    /// Points of the answer on rays where the scan has none; they follow the others.
    pub added: usize,
    /// How the scan fits the model's sensor.
    pub coverage: Coverage,
    /// What the sender should change so that it fits better.
    pub warning: Option<String>,
}

/// A scan that did not get through.
#[derive(Debug, Error)]
pub enum ScanError {
    /// Its bytes are not of its format.
    #[error("scan: {0}")]
    Decode(#[source] FormatError),
    /// It cannot be projected.
    #[error("scan: {0}")]
    Project(#[from] ProjectionError),
    /// The model's run failed.
    #[error("model: {0}")]
    Infer(#[from] InferenceError),
    /// The model's answer is no answer.
    #[error(transparent)]
    NotANumber(#[from] NotANumber),
    /// The answer does not fit its format.
    #[error("answer: {0}")]
    Encode(#[source] FormatError),
    /// The answer would list more points than such an answer may.
    #[error(
        "answer: {points} points are more than the {} that JSON lists; ask for a cloud or for image/png",
        view::MAX_LISTED
    )]
    TooManyToList {
        /// Points of the scan, and of the answer on rays where the scan has none.
        points: usize,
    },
    /// The answer is no picture.
    #[error("answer: {0}")]
    Draw(#[from] PictureError),
    /// Nobody waits for the answer any more.
    #[error("whoever asked has left")]
    Abandoned,
}

/// A pipeline that cannot be built.
#[derive(Debug, Error)]
pub enum PipelineError {
    /// The model does not load.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The model does not run, not even on an empty scan.
    #[error("model `{name}` does not run: {source}")]
    TrialRun {
        /// The model.
        name: String,
        /// What happens.
        source: InferenceError,
    },
}

impl Pipeline {
    /// Loads a model, with `threads` within an operator, and tries it on an empty scan.
    pub fn new(model: &Arc<Model>, threads: impl Into<Threads>) -> Result<Self, PipelineError> {
        Self::with(model, Generator::new(model, threads)?)
    }

    /// A pipeline that shares its model's sessions with others, tried on an empty scan.
    pub(crate) fn sharing(model: &Arc<Model>, batches: &Arc<Batches>) -> Result<Self, PipelineError> {
        Self::with(model, Generator::sharing(model, Arc::clone(batches)))
    }

    fn with(model: &Arc<Model>, mut generator: Generator) -> Result<Self, PipelineError> {
        let sensor = &model.card.sensor;
        generator.fill(&RangeImage::empty(sensor.rings().len(), sensor.columns()), Chance::default());
        generator.run().map_err(|source| PipelineError::TrialRun { name: model.name.clone(), source })?;
        Ok(Self {
            projector: Projector::new(sensor),
            model: Arc::clone(model),
            projection: Projection::default(),
            generator,
            sampled: Sampled::new(&model.card),
            realistic: PointCloud::default(),
        })
    }

    /// Makes a scan realistic. The same bytes, model, seed and kind of noise give the same bytes, whatever ran before. Stops between two
    /// stages if the caller has left.
    pub fn run(&mut self, job: &ScanJob, caller: Caller<'_>) -> Result<ScanAnswer, ScanError> {
        let mut watch = Stopwatch::start();
        let mut simulated = formats::decode(job.format, &job.bytes, &job.limits).map_err(ScanError::Decode)?;
        if job.answer == Form::Points {
            view::check_listed(simulated.len())?;
        }
        let asked = Asked { frame: job.frame, ring_counts: job.ring_counts.as_deref(), chance: job.chance };
        let fit = self.transform(&mut simulated, asked, Escort { watch: &mut watch, caller })?;
        let bytes = self.answer(job, &mut simulated, &fit)?;
        watch.lap(Stage::Encode);
        Ok(ScanAnswer { bytes, fit, times: watch.times() })
    }

    /// The answer's bytes, once the scan is through.
    fn answer(&self, job: &ScanJob, simulated: &mut PointCloud, fit: &Fit) -> Result<Vec<u8>, ScanError> {
        if let Form::Scan(format) = job.answer {
            return formats::encode(format, &self.realistic).map_err(ScanError::Encode);
        }
        change_frame(simulated, job.frame);
        let view = View {
            simulated,
            realistic: &self.realistic,
            projection: &self.projection,
            measured: self.sampled.measured(),
            fit,
        };
        match job.answer {
            Form::Points => view.json(&self.model, job.chance.seed),
            Form::PointRecords => Ok(view.records()),
            Form::Picture | Form::Scan(_) => Ok(view.picture()?),
        }
    }

    /// Makes the scan in a file realistic, and writes it to another; labels beside a `.bin` are read and written there too.
    pub fn run_file(&mut self, from: &Path, to: &Path, file: FileJob) -> Result<Fit, ScanError> {
        let mut simulated = formats::read(from, &file.limits).map_err(ScanError::Decode)?;
        let escort = Escort { watch: &mut Stopwatch::start(), caller: Caller::PATIENT };
        let asked = Asked { frame: file.frame, ring_counts: None, chance: file.chance };
        let fit = self.transform(&mut simulated, asked, escort)?;
        formats::write(to, &self.realistic).map_err(ScanError::Encode)?;
        Ok(fit)
    }

    /// Runs the generator alone, on tensors that somebody else has made, in batches of at most `max_batch`.
    pub(crate) fn generate(&mut self, inputs: &[Tensor], max_batch: usize) -> Result<Vec<Tensor>, TensorError> {
        tensors::run(&self.model, &mut self.generator, inputs, max_batch)
    }

    /// The way of a scan between its decoding and its encoding; the result is `self.realistic`, and `simulated` is in our frame.
    fn transform(
        &mut self,
        simulated: &mut PointCloud,
        Asked { frame, ring_counts, chance }: Asked<'_>,
        mut escort: Escort<'_>,
    ) -> Result<Fit, ScanError> {
        change_frame(simulated, frame);
        escort.lap(Stage::Decode)?;

        self.projector.project_counted_into(simulated, ring_counts, &mut self.projection)?;
        escort.lap(Stage::Project)?;

        self.generator.fill(&self.projection.image, chance);
        escort.lap(Stage::Tensor)?;

        let outputs = self.generator.run()?;
        escort.lap(Stage::Infer)?;

        let card = &self.model.card;
        self.sampled.draw(&self.projection.image, &outputs, chance.seed, card.adds_returns)?;
        escort.lap(Stage::Sample)?;

        self.projection.reconstruct_into(simulated, self.sampled.measured(), &mut self.realistic);
        let kept = self.realistic.len();
        let added = if card.adds_returns {
            let empty = EmptyRays { sensor: &card.sensor, cloud: simulated, projection: &self.projection };
            empty.append_measured(self.sampled.measured(), &mut self.realistic)
        } else {
            0
        };
        change_frame(&mut self.realistic, frame);
        escort.lap(Stage::Reconstruct)?;

        let coverage = Coverage::of(&self.projection);
        let warning = if simulated.is_empty() { None } else { coverage.warning(&card.sensor) };
        Ok(Fit { report: self.projection.report, kept, added, coverage, warning })
    }
}

impl Fit {
    /// Points whose ray the sensor does not report.
    pub fn dropped(&self) -> usize {
        self.report.projected - self.kept
    }

    /// Points that are none: NaN, infinite, or at the sensor's origin.
    pub fn invalid(&self) -> usize {
        self.report.non_finite + self.report.zero_range
    }

    /// Points nearer or farther than the sensor sees, or above or below all its rings.
    pub fn out_of_range(&self) -> usize {
        self.report.out_of_range + self.report.outside_view
    }
}

/// What is asked of a scan's way, wherever it comes from and goes.
struct Asked<'a> {
    frame: Frame,
    ring_counts: Option<&'a [u32]>,
    chance: Chance,
}

/// What goes along with a scan from stage to stage.
struct Escort<'a> {
    watch: &'a mut Stopwatch,
    caller: Caller<'a>,
}

impl Escort<'_> {
    /// Books the time on a stage that is over, and lets the scan go on only if its answer is still wanted.
    fn lap(&mut self, stage: Stage) -> Result<(), ScanError> {
        self.watch.lap(stage);
        if self.caller.has_left() { Err(ScanError::Abandoned) } else { Ok(()) }
    }
}

/// Between the sender's frame and ours; its own inverse.
fn change_frame(cloud: &mut PointCloud, frame: Frame) {
    match frame {
        Frame::Ros => {}
        Frame::Carla => cloud.mirror_y(),
    }
}

impl From<SampleError> for ScanError {
    fn from(error: SampleError) -> Self {
        match error {
            SampleError::Outputs(error) => Self::Infer(error),
            SampleError::NotANumber(error) => Self::NotANumber(error),
        }
    }
}
