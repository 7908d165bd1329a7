//! Simulated scans: streets made up from a seed, or a mesh, cast by any sensor.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use lidar::{Sensor, formats};
use scene::street::{StreetConfig, street};
use scene::{Motion, Pose, Scene, cast};

/// What to simulate.
#[derive(Clone, Debug)]
pub struct Simulation {
    /// The sensor.
    pub sensor: Sensor,
    /// Seed of the first street; the k-th scan has seed + k.
    pub seed: u64,
    /// Number of scans, each of a street of its own.
    pub count: usize,
    /// A street's TOML; the defaults without.
    pub street: Option<PathBuf>,
    /// A mesh to cast instead of streets: OBJ, glTF or CityJSON.
    pub mesh: Option<PathBuf>,
    /// Where the sensor is.
    pub pose: Pose,
    /// How it moves.
    pub motion: Motion,
}

/// Casts the scans and writes them: to `out` itself if it is one scan, else to `out/000000.ply`, ….
pub fn simulate(simulation: &Simulation, out: &Path) -> Result<Vec<PathBuf>> {
    ensure!(simulation.count > 0, "count is 0");
    let config: StreetConfig = match &simulation.street {
        Some(path) => {
            let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
            toml::from_str(&text).with_context(|| format!("street {}", path.display()))?
        }
        None => StreetConfig::default(),
    };
    let mesh = match &simulation.mesh {
        Some(path) => {
            Some(Scene::new(scene::mesh_file::load(path).with_context(|| format!("mesh {}", path.display()))?))
        }
        None => None,
    };
    let mut written = Vec::with_capacity(simulation.count);
    for k in 0..simulation.count {
        let made;
        let world = if let Some(mesh) = &mesh {
            mesh
        } else {
            made = street(simulation.seed + k as u64, &config);
            &made
        };
        let scan = cast(world, &simulation.sensor, &simulation.pose, &simulation.motion);
        let path = if simulation.count == 1 { out.to_owned() } else { out.join(format!("{k:06}.ply")) };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        }
        formats::write(&path, &scan.cloud)?;
        tracing::info!(path = %path.display(), points = scan.cloud.len(), "simulated");
        written.push(path);
    }
    Ok(written)
}
