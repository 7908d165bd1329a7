//! What a sensor's scans say of its geometry, and what each way to project them loses.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result};
use lidar::formats::{self, Limits};
use lidar::projection::loss::{losses, usual_candidates};
use lidar::sensor::estimate::{Columns, Estimate, EstimateOptions};
use lidar::{Measured, PointCloud, Projection, Projector, Sensor};

use crate::data::scans::scan_files;

/// How often the projection is repeated for its time.
const REPEATS: usize = 20;

/// A measured sensor and the comparison.
#[derive(Clone, Debug)]
pub struct SensorReport {
    /// The sensor.
    pub sensor: Sensor,
    /// What was found, for a terminal or a README.
    pub table: String,
}

/// Estimates a sensor from its scans (files or folders), and compares its grid with the usual projections.
pub fn report(scans: &[PathBuf], model: &Sensor) -> Result<SensorReport> {
    let mut clouds = Vec::new();
    for path in scans {
        for file in scan_files(path)? {
            let cloud = formats::read(&file, &Limits::default());
            clouds.push(cloud.with_context(|| format!("scan {}", file.display()))?);
        }
    }
    // One scan is enough to measure a sensor; all of them are projected.
    let started = Instant::now();
    let options = EstimateOptions { rotation_hz: model.rotation_hz(), ..EstimateOptions::default() };
    let estimate = Sensor::estimate(&clouds[..1], &options).with_context(|| format!("{}", scans[0].display()))?;
    let estimate_s = started.elapsed().as_secs_f64();

    let mut table = String::from(
        "| projection | grid | points lost | of | lost % | farthest from its place |\n|---|---|---|---|---|---|\n",
    );
    for loss in losses(&clouds, &usual_candidates(model, &estimate.sensor)?)? {
        writeln!(
            table,
            "| {} | {}×{} | {} | {} | {:.3} | {:.2} mm |",
            loss.name,
            loss.rings,
            loss.columns,
            loss.lost,
            loss.points,
            loss.lost_percent(),
            1e3 * loss.max_error_m
        )?;
    }
    let (project_s, reconstruct_s) = times(&clouds[0], &estimate.sensor)?;
    writeln!(
        table,
        "\n{}; {} rings. Estimate from one scan {estimate_s:.2} s, projection {:.2} ms, reconstruction {:.2} ms for {} points (fastest of {REPEATS}).",
        describe(&estimate),
        estimate.sensor.rings().len(),
        1e3 * project_s,
        1e3 * reconstruct_s,
        clouds[0].len()
    )?;
    Ok(SensorReport { sensor: estimate.sensor, table })
}

fn describe(estimate: &Estimate) -> String {
    let columns = estimate.sensor.columns();
    match estimate.columns {
        Columns::Encoder { concentration } => {
            format!("An encoder of {columns} ticks a turn (concentration {concentration:.3})")
        }
        Columns::FreeRunning { per_turn } => format!("Free-running, {per_turn:.1} firings a turn"),
        Columns::Unknown => "The columns cannot be told from these scans".into(),
    }
}

/// Shortest time to project a cloud and to take it back, in seconds.
fn times(cloud: &PointCloud, sensor: &Sensor) -> Result<(f64, f64)> {
    let mut projector = Projector::new(sensor);
    let (mut projection, mut back) = (Projection::default(), PointCloud::default());
    let (mut project_s, mut reconstruct_s) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..REPEATS {
        let started = Instant::now();
        projector.project_into(cloud, &mut projection)?;
        project_s = project_s.min(started.elapsed().as_secs_f64());
        let (range_m, reflectance) = (projection.image.range_m().to_vec(), projection.image.reflectance().to_vec());
        let keep = vec![true; range_m.len()];
        let started = Instant::now();
        let measured = Measured { range_m: &range_m, reflectance: &reflectance, keep: &keep };
        projection.reconstruct_into(cloud, measured, &mut back);
        reconstruct_s = reconstruct_s.min(started.elapsed().as_secs_f64());
    }
    Ok((project_s, reconstruct_s))
}
