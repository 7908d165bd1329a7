//! The command line.

mod benchmark;
mod calibrate;
mod elevation;
mod unpaired;

use std::path::PathBuf;

use anyhow::Result;
use burn::tensor::Device;
use clap::{Args, Parser, Subcommand};
use scene::{Motion, Pose};
use trainer::config::{TrainConfig, load_sensor};
use trainer::data::Scans;
use trainer::evaluate::{Scores, evaluate};
use trainer::simulate::{Simulation, simulate};
use trainer::train::{Run, best_network, train};
use trainer::{export, sensor_report};

use benchmark::BenchmarkArgs;
use calibrate::CalibrateArgs;

/// Learn what a real lidar makes of a simulated scan.
#[derive(Debug, Parser)]
#[command(name = "realbeam-trainer", version)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Train a network on real scans.
    Train(TrainArgs),
    /// Score the best network of a run on its config's test scans, beside the pass-through.
    Evaluate(RunArgs),
    /// Publish the best network of a run as the next version under models/.
    Export(ExportArgs),
    /// Ray cast made-up streets, or a mesh: labelled scans where no simulator is at hand.
    Simulate(SimulateArgs),
    /// Find what a sensor does that its model lacks, and add it to the model.
    Calibrate(CalibrateArgs),
    /// The same for real scans without simulated twins, against simulated scans of other places: fewer effects can be seen.
    CalibrateUnpaired(unpaired::UnpairedArgs),
    /// Estimate a spinning sensor from its scans, and report the points that projections lose.
    Sensor(SensorArgs),
    /// Measure from the ground in scans of a drive, without a simulator, by how much the sensor's rays point too high or too low.
    Elevation(elevation::ElevationArgs),
    /// Hide known defects from the closed loop and count how often it finds them.
    BenchmarkLoop(BenchmarkArgs),
}

#[derive(Debug, Args)]
struct TrainArgs {
    /// The run's config (TOML).
    config: PathBuf,
    /// Folder that the config's data paths are relative to.
    #[arg(long, default_value = ".")]
    data: PathBuf,
    /// Folder for checkpoints, log and the best network.
    #[arg(long)]
    out: PathBuf,
    /// Go on from the newest checkpoint in OUT.
    #[arg(long)]
    resume: bool,
    /// Stop after this step, with a checkpoint.
    #[arg(long)]
    stop_after: Option<usize>,
}

#[derive(Debug, Args)]
struct RunArgs {
    /// The run's folder.
    run: PathBuf,
    /// Folder that the config's data paths are relative to.
    #[arg(long, default_value = ".")]
    data: PathBuf,
}

#[derive(Debug, Args)]
struct ExportArgs {
    #[command(flatten)]
    run: RunArgs,
    /// Folder of models.
    #[arg(long, default_value = "models")]
    models: PathBuf,
}

#[derive(Debug, Args)]
struct SimulateArgs {
    /// Name of a built-in sensor, or path of a sensor's TOML file.
    #[arg(long, default_value = "hdl64e")]
    sensor: String,
    /// Seed of the first street.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Number of scans, each of a street of its own.
    #[arg(long, default_value_t = 1)]
    count: usize,
    /// TOML file that says what streets are like.
    #[arg(long)]
    street: Option<PathBuf>,
    /// Mesh to cast instead: .obj, .gltf, .glb, or CityJSON.
    #[arg(long, conflicts_with = "street")]
    mesh: Option<PathBuf>,
    /// Sensor's position: ahead, left, up, in metres.
    #[arg(long, num_args = 3, allow_negative_numbers = true, default_values_t = Pose::default().position_m)]
    position_m: Vec<f32>,
    /// Sensor's heading, in degrees to the left.
    #[arg(long, allow_negative_numbers = true, default_value_t = 0.0)]
    yaw_deg: f32,
    /// Speed ahead, in m/s: each column is cast from where the sensor is then.
    #[arg(long, default_value_t = 0.0)]
    speed_m_s: f32,
    /// File of one scan (any format, by its extension), or folder of several.
    out: PathBuf,
}

#[derive(Debug, Args)]
struct SensorArgs {
    /// Scans of one sensor.
    #[arg(required = true)]
    scans: Vec<PathBuf>,
    /// Where to write the sensor.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Built-in sensor to compare with.
    #[arg(long, default_value = "hdl64e")]
    builtin: String,
}

impl Cli {
    /// Does what was asked.
    pub(crate) fn run(self) -> Result<()> {
        match self.command {
            Command::Train(args) => {
                let config = TrainConfig::read(&args.config)?;
                let run = Run { out: args.out, data: args.data, resume: args.resume, stop_after: args.stop_after };
                if let Some(scores) = train(&config, &run)? {
                    println!("{}", scores.to_table());
                }
            }
            Command::Evaluate(args) => println!("{}", args.scores()?.to_table()),
            Command::Export(args) => {
                let config = args.run.config()?;
                let (network, card) = export::finish(&config, &args.run.run, &args.run.data, &args.run.scores()?)?;
                let onnx = export::to_onnx(&network, &card)?;
                println!("{}", export::publish(&args.models, &card, &onnx)?.display());
            }
            Command::Simulate(args) => {
                let pose = Pose {
                    position_m: [args.position_m[0], args.position_m[1], args.position_m[2]],
                    yaw_rad: args.yaw_deg.to_radians(),
                    ..Pose::default()
                };
                let motion = Motion { velocity_m_s: [args.speed_m_s, 0.0, 0.0], ..Motion::default() };
                let simulation = Simulation {
                    sensor: load_sensor(&args.sensor)?,
                    seed: args.seed,
                    count: args.count,
                    street: args.street,
                    mesh: args.mesh,
                    pose,
                    motion,
                };
                for path in simulate(&simulation, &args.out)? {
                    println!("{}", path.display());
                }
            }
            Command::BenchmarkLoop(args) => args.run()?,
            Command::Calibrate(args) => args.run()?,
            Command::CalibrateUnpaired(args) => args.run()?,
            Command::Elevation(args) => args.run()?,
            Command::Sensor(args) => {
                let report = sensor_report::report(&args.scans, &load_sensor(&args.builtin)?)?;
                println!("{}", report.table);
                if let Some(out) = args.out {
                    lidar::formats::write_atomically(&out, report.sensor.to_toml().as_bytes())?;
                }
            }
        }
        Ok(())
    }
}

impl RunArgs {
    fn config(&self) -> Result<TrainConfig> {
        TrainConfig::read(&self.run.join("config.toml"))
    }

    fn scores(&self) -> Result<Scores> {
        let config = self.config()?;
        let sensor = config.sensor()?;
        let test: Vec<Scans> =
            config.test.iter().map(|data| Scans::load(&self.data, data, &sensor)).collect::<Result<_>>()?;
        let network = best_network(&config, &self.run)?;
        Ok(evaluate(&network, test.iter().flat_map(|s| &s.images), &Device::flex()))
    }
}
