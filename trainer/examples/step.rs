//! Steps of a translation's training, one whenever a line comes in, on made-up scans: what `scripts/compare_steps.py` times.
//!
//!     cargo run --release -p trainer --example step -- CONFIG BACKEND BATCH COLUMNS
//!
//! The first line out says as JSON what the networks are like, each further one how many seconds a step took.

use std::io::{BufRead, Write};
use std::time::Instant;

use anyhow::{Context, Result};
use burn::module::Module;
use burn::tensor::{Distribution, Tensor};
use trainer::backend::Backend;
use trainer::network::PatchHeads;
use trainer::network::resnet::IMAGE_CHANNELS;
use trainer::translation::TranslationConfig;
use trainer::translation::method::{Setting, Step, approach};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, backend, batch, columns] = arguments.as_slice() else {
        anyhow::bail!("expected CONFIG BACKEND BATCH COLUMNS");
    };
    let config = TranslationConfig::read(path.as_ref())?;
    let backend: Backend = serde_json::from_value(backend.as_str().into())?;
    let (batch, columns): (usize, usize) = (batch.parse()?, columns.parse()?);
    let rings = config.grid()?.sensor.rings().len();

    let device = backend.device()?.autodiff();
    device.seed(1);
    let (generator, reporting) = (config.training_generator()?, config.reporting()?);
    let image_numbers = IMAGE_CHANNELS * rings * columns;
    let setting = Setting { generator, reporting, losses: config.losses, image_numbers };
    let mut method = approach(&config, setting, &device)?.context("a method with a discriminator")?;
    println!(
        "{}",
        serde_json::json!({
            "method": config.method, "generator": generator, "discriminator": config.discriminator, "losses": config.losses,
            "size": [batch, rings, columns],
            "parameters": {
                "generator": method.generator().num_params(),
                "discriminator": config.discriminator.init(&device).num_params(),
                "heads": PatchHeads::new(&generator.feature_channels(), generator.gain, &device).num_params(),
            },
        })
    );

    let scan = || {
        let uniform =
            |from, to| Tensor::<4>::random([batch, 1, rings, columns], Distribution::Uniform(from, to), &device);
        reporting.coding.view(&Tensor::cat(vec![uniform(2.0, 80.0), uniform(0.0, 1.0), uniform(0.0, 19.0)], 1))
    };
    let (simulated, real) = (scan(), scan());
    for (number, line) in std::io::stdin().lock().lines().enumerate() {
        line?;
        let (simulated, real) = (simulated.clone(), real.clone());
        let started = Instant::now();
        // The losses are numbers: whatever a backend puts off is done.
        method.step(&Step { simulated, real, twins: None, seed: 1, number, rate: config.schedule.rate(number) });
        println!("{}", started.elapsed().as_secs_f64());
        std::io::stdout().flush()?;
    }
    Ok(())
}
