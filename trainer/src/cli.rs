//! The command line.

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Parser, Subcommand};
use trainer::config::TrainConfig;
use trainer::train::{Run, train};

/// Learn what a real lidar makes of a simulated scan.
#[derive(Debug, Parser)]
#[command(name = "realbeam-trainer", version)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Train a network on real scans.
    Train(TrainArgs),
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

impl Cli {
    /// Does what was asked.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Train(args) => {
                let config = TrainConfig::read(&args.config)?;
                let run = Run { out: args.out, data: args.data, resume: args.resume, stop_after: args.stop_after };
                if let Some(scores) = train(&config, &run)? {
                    println!("{}", scores.to_table());
                }
                Ok(())
            }
        }
    }
}
