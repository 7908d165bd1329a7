//! `realbeam-demo`: a made-up street goes to a real server, and what a real sensor would have measured comes back.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Parser;
use lidar::formats::{self, Format};
use lidar::{Projector, Sensor, picture};
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, cast};
use tests::RunningServer;

/// Ray cast a street, send it to the service, and show the scan before and after.
#[derive(Debug, Parser)]
struct Demo {
    /// Folder for the two clouds and the picture.
    #[arg(long, default_value = "build/demo")]
    out: PathBuf,
    /// Seed of the street.
    #[arg(long, default_value_t = 3)]
    seed: u64,
    /// Folder of models.
    #[arg(long, default_value = "models")]
    models: PathBuf,
    /// Model to use.
    #[arg(long, default_value = "hdl64e")]
    model: String,
}

fn main() -> Result<()> {
    let demo = Demo::parse();
    let server = RunningServer::start(&demo.models, &["--default-model", &demo.model])?;
    let client = server.client();
    let info = client.get("/info")?.json()?;
    let card = info["models"]
        .as_array()
        .and_then(|models| models.iter().find(|m| m["name"] == demo.model.as_str()))
        .map(|model| &model["card"])
        .with_context(|| format!("the server does not know {}", demo.model))?;
    let sensor: Sensor = serde_json::from_value(card["sensor"].clone()).context("the model's sensor in /info")?;

    let world = street(demo.seed, &StreetConfig::default());
    let before = cast(&world, &sensor, &Pose::default(), &Motion::default()).cloud;
    let (answer, after) = client.convert("?seed=1", Format::Ply, &before)?;

    std::fs::create_dir_all(&demo.out).with_context(|| format!("cannot make {}", demo.out.display()))?;
    let file = |name: &str| demo.out.join(name);
    formats::write(&file("before.ply"), &before)?;
    formats::write(&file("after.ply"), &after)?;
    let mut projector = Projector::new(&sensor);
    let images = (projector.project(&before)?.image, projector.project(&after)?.image);
    formats::write_atomically(&file("before_after.png"), &picture::before_after(&images.0, &images.1)?)?;

    let count = |name: &str| answer.count(&format!("x-realbeam-points-{name}"));
    println!("{} at {}", card["summary"].as_str().unwrap_or(&demo.model), server.address());
    println!(
        "points: {} in, {} kept, {} dropped as the sensor drops them, {} lost in projection",
        count("in")?,
        count("kept")?,
        count("dropped")?,
        count("lost")?
    );
    println!("time in ms: {}", answer.header("server-timing").unwrap_or_default().replace(";dur=", " "));
    for name in ["before.ply", "after.ply", "before_after.png"] {
        println!("{}", file(name).display());
    }
    Ok(())
}
