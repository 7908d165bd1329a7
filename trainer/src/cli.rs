//! The command line.

mod benchmark;
mod calibrate;
mod compare;
mod detect;
mod downstream;
mod elevation;
mod from_above;
mod runs;
mod segment;
mod table;
mod unpaired;

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Parser, Subcommand};
use scene::{Motion, Pose};
use trainer::config::load_sensor;
use trainer::sensor_report;
use trainer::simulate::{Simulation, simulate};

use benchmark::BenchmarkArgs;
use calibrate::CalibrateArgs;
use compare::CompareArgs;
use segment::SegmentArgs;

/// Learn what a real lidar makes of a simulated scan.
#[derive(Debug, Parser)]
#[command(name = "realbeam-trainer", version)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Train a network: on real scans alone, or to translate simulated scans into real ones.
    Train(runs::TrainArgs),
    /// Score the best network of a run on its config's test scans, beside doing nothing.
    Evaluate(runs::EvaluateArgs),
    /// Score an exported model ray by ray, on real scans that are made to look simulated, beside doing nothing.
    Score(runs::ScoreArgs),
    /// Measure on real scans how lost rays hang together along their ring, beside what an exported model says of each.
    Bursts(runs::BurstsArgs),
    /// Measure on real scans how reflectances scatter about what an exported model says.
    Scatter(runs::ScatterArgs),
    /// Judge scans that somebody made against scans that a sensor took: how real they look, and how true they are to their simulation.
    Compare(CompareArgs),
    /// Train and score the segmentation network by whose features scans are compared.
    Segment(SegmentArgs),
    /// Train segmentation networks on labelled scans, and score them on real ones: what the scans are worth to perception.
    Downstream(downstream::DownstreamArgs),
    /// Train vehicle detectors on labelled scans seen from above, and score them on real ones.
    Detect(detect::DetectArgs),
    /// Write scans as they are seen from above, with the vehicles that their labels show: for detectors of one's own.
    FromAbove(from_above::FromAboveArgs),
    /// Publish the best networks of runs as the next versions under models/.
    Export(runs::ExportArgs),
    /// Train several methods with several seeds on one budget, and print what came of it side by side.
    Table(table::TableArgs),
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
    /// Reflectance e^(−a r) with this a, in 1/m, whatever a ray hits, instead of the surfaces': 0.004 is CARLA's default.
    #[arg(long)]
    attenuation_per_m: Option<f32>,
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
            Command::Train(args) => args.run()?,
            Command::Evaluate(args) => println!("{}", args.table()?),
            Command::Score(args) => println!("{}", args.table()?),
            Command::Bursts(args) => args.run()?,
            Command::Scatter(args) => args.run()?,
            Command::Compare(args) => args.run()?,
            Command::Segment(args) => args.run()?,
            Command::Downstream(args) => args.run()?,
            Command::Detect(args) => args.run()?,
            Command::FromAbove(args) => args.run()?,
            Command::Export(args) => args.run()?,
            Command::Table(args) => args.run()?,
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
                    attenuation_per_m: args.attenuation_per_m,
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
