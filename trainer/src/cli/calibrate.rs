//! `calibrate`: closes the loop on a set, or on one that it makes for itself.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use clap::Args;
use hidden::{Defect, Recipe};
use indicatif::{ProgressBar, ProgressStyle};
use lidar::Sensor;
use rand::SeedableRng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use trainer::closed_loop::base::Base;
use trainer::closed_loop::calibrate::calibrate;
use trainer::closed_loop::delivery::Delivery;
use trainer::closed_loop::folder;
use trainer::effects::library;
use trainer::sets::{Frame, PairedSet};

/// Rings and columns of the demo's sensor.
const DEMO_SIZE: [usize; 2] = [32, 512];

#[derive(Debug, Args)]
pub(super) struct CalibrateArgs {
    /// Folder of a paired set: sensor.toml, sim/ and measured/, frames paired by name.
    #[arg(required_unless_present = "demo")]
    set: Option<PathBuf>,
    /// Exported model to start from, or `ideal`: a sensor that reports what it is shown. The effects that a model has are refitted.
    #[arg(long, default_value = "ideal", conflicts_with = "demo")]
    model: String,
    /// Make a set with an effect hidden in it, find the effect, and show the answer beside the truth.
    #[arg(long, conflicts_with = "set")]
    demo: bool,
    /// What chance depends on: which scenes are for what, and what the demo hides.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Folder for model.onnx, its card and the report: a new or empty one, or one of an earlier calibration, which is replaced.
    #[arg(long)]
    out: PathBuf,
}

impl CalibrateArgs {
    pub(super) fn run(&self) -> Result<()> {
        folder::check(&self.out)?;
        let Some(path) = &self.set else { return self.run_demo() };
        let set = PairedSet::read(path)?;
        let base = match self.model.as_str() {
            "ideal" => Base::ideal(&set.sensor),
            path => Base::read(Path::new(path), &set.sensor)?,
        };
        self.close(&set, &base)
    }

    fn run_demo(&self) -> Result<()> {
        let recipe = demo(self.seed)?;
        let set = made(&recipe)?;
        self.close(&set, &Base::ideal(&set.sensor))?;
        println!("\nHidden in the measured half was:");
        for defect in &recipe.hidden {
            let values = defect.truth().into_iter().map(|(name, value)| format!("{name} {value:.4}"));
            println!("  {}: {}", defect.title(), values.collect::<Vec<_>>().join(", "));
        }
        Ok(())
    }

    fn close(&self, set: &PairedSet, base: &Base) -> Result<()> {
        let pairs = base.pairs(set)?;
        let bar = progress_bar();
        let known = library();
        let calibration = calibrate(set, &pairs, &base.declared, self.seed, &|what| {
            if known.iter().any(|effect| effect.about().name == what) {
                bar.set_message(what.to_owned());
                bar.inc(1);
            } else {
                bar.println(what);
                bar.set_position(0);
            }
        });
        bar.finish_and_clear();
        let delivery = Delivery::new(set, base, calibration, self.seed)?;
        delivery.write(&self.out)?;
        println!("{}", delivery.report.words());
        for file in folder::FILES {
            println!("{}", self.out.join(file).display());
        }
        Ok(())
    }
}

fn progress_bar() -> ProgressBar {
    let bar = ProgressBar::new(library().len() as u64);
    let style = ProgressStyle::with_template("{elapsed:>5} {bar:24} {pos}/{len} {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

/// A set with one of the library's effects hidden in it, at its typical size.
fn demo(seed: u64) -> Result<Recipe> {
    let mut dice = ChaCha8Rng::seed_from_u64(seed);
    let known: Vec<&str> = library().iter().map(|effect| effect.about().name).collect();
    let both: Vec<&str> = hidden::LIBRARY.iter().copied().filter(|name| known.contains(name)).collect();
    let sensor = demo_sensor()?;
    let name = both.choose(&mut dice).context("an effect that can be hidden")?;
    let defect: Defect = hidden::typical(name, 1.0, &sensor, &mut dice).context("an effect that can be hidden")?;
    Ok(Recipe::new(seed, sensor, vec![defect]))
}

fn demo_sensor() -> Result<Sensor> {
    let [rings, columns] = DEMO_SIZE;
    let elevations_deg = (0..rings).map(|ring| 6.0 - 0.875 * ring as f64);
    Ok(Sensor::from_elevations_deg("demo", elevations_deg, columns, (1.0, 100.0), 10.0)?)
}

fn made(recipe: &Recipe) -> Result<PairedSet> {
    let frame = |(number, frame): (usize, hidden::HiddenFrame)| Frame {
        name: format!("{number:06}"),
        scene: frame.scene,
        simulated: frame.simulated,
        measured: frame.measured,
        measured_extra: 0,
    };
    let frames = hidden::frames(recipe).into_iter().enumerate().map(frame).collect();
    let scenes = (0..recipe.scenes).map(|scene| format!("street-{scene:02}")).collect();
    Ok(PairedSet::from_frames("demo", recipe.sensor.clone(), scenes, frames)?)
}
