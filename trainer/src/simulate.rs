//! Simulated scans: streets made up from a seed, or a mesh, cast by any sensor.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use lidar::{PointCloud, Sensor, formats};
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
    /// Reflectance e^(−a r) with this a, in 1/m, as CARLA has it, instead of the surfaces'.
    pub attenuation_per_m: Option<f32>,
}

/// Casts the scans and writes them: to `out` itself if it is one scan, else to `out/000000.ply`, ….
pub fn simulate(simulation: &Simulation, out: &Path) -> Result<Vec<PathBuf>> {
    ensure!(simulation.count > 0, "count is 0");
    if let Some(rate_per_m) = simulation.attenuation_per_m {
        ensure!((0.0..=1.0).contains(&rate_per_m), "attenuation_per_m is {rate_per_m}, expected 0 to 1");
    }
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
        let mut cloud = cast(world, &simulation.sensor, &simulation.pose, &simulation.motion).cloud;
        if let Some(rate_per_m) = simulation.attenuation_per_m {
            attenuate(&mut cloud, rate_per_m);
        }
        let path = if simulation.count == 1 { out.to_owned() } else { out.join(format!("{k:06}.ply")) };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        }
        formats::write(&path, &cloud)?;
        tracing::info!(path = %path.display(), points = cloud.len(), "simulated");
        written.push(path);
    }
    Ok(written)
}

/// Gives a cloud the reflectance that CARLA reports, whatever a ray hit.
fn attenuate(cloud: &mut PointCloud, rate_per_m: f32) {
    for i in 0..cloud.len() {
        cloud.intensity[i] = (-rate_per_m * cloud.range_m(i)).exp() * cloud.full_scale;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lidar::formats::Limits;

    #[test]
    fn attenuated_scans_differ_in_reflectance_alone() -> Result<()> {
        let folder = tempfile::tempdir()?;
        let scan = |name: &str, attenuation_per_m| {
            let simulation = Simulation {
                sensor: Sensor::builtin("vlp16")?.with_columns(64)?,
                seed: 5,
                count: 1,
                street: None,
                mesh: None,
                pose: Pose::default(),
                motion: Motion::default(),
                attenuation_per_m,
            };
            let written = simulate(&simulation, &folder.path().join(name))?;
            Ok::<_, anyhow::Error>(formats::read(&written[0], &Limits::default())?)
        };
        let (surfaces, attenuated) = (scan("surfaces.ply", None)?, scan("attenuated.ply", Some(0.01))?);
        assert_eq!((&surfaces.x, &surfaces.label), (&attenuated.x, &attenuated.label));
        assert_ne!(surfaces.intensity, attenuated.intensity);
        assert!(scan("none.ply", Some(-0.01)).is_err_and(|e| e.to_string().contains("attenuation_per_m is -0.01")));
        for i in 0..attenuated.len() {
            let expected = (-0.01 * attenuated.range_m(i)).exp();
            assert!((attenuated.intensity[i] / attenuated.full_scale - expected).abs() < 1e-6);
        }
        Ok(())
    }
}
