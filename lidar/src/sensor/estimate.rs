//! A spinning sensor's geometry, measured from its own scans.

mod beams;
mod columns;
mod firing;
mod line;

use std::f64::consts::{PI, TAU};

use serde::Serialize;
use thiserror::Error;

use crate::cloud::PointCloud;
use crate::projection::{ProjectionError, Projector};
use crate::rings::RingSource;
use crate::sensor::{Ring, Sensor, SensorError};

use beams::Beam;
use columns::Pitch;

/// What the scans cannot tell.
#[derive(Clone, Debug)]
pub struct EstimateOptions {
    /// The sensor's name.
    pub name: String,
    /// Turns a second.
    pub rotation_hz: f32,
    /// Nearest and farthest range it reports, in metres; by default half the nearest and twice the farthest seen.
    pub range_m: Option<(f32, f32)>,
}

impl Default for EstimateOptions {
    fn default() -> Self {
        Self { name: "estimated".into(), rotation_hz: 10.0, range_m: None }
    }
}

/// A sensor as its scans show it, and how well it explains them.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The sensor, its rings from the highest to the lowest. Azimuth offsets are those within half a column, so that neighbouring
    /// pixels look in neighbouring directions; for the offset in time see [`RingFit::firing_offset_rad`].
    pub sensor: Sensor,
    /// How the rings were told.
    pub ring_source: RingSource,
    /// What is known of the columns.
    pub columns: Columns,
    /// How each ring fits.
    pub rings: Vec<RingFit>,
    /// Points of the scans.
    pub points: usize,
    /// Points that the estimated sensor's grid loses to nearer ones, in all the scans.
    pub lost: usize,
}

/// How the firings of a turn lie.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Columns {
    /// On the ticks of an encoder, at the same azimuths every turn: the sensor's columns are these ticks.
    Encoder {
        /// Length of the mean of exp(i·phase) over the points, phases within a column: 1 if all lie at its centre.
        concentration: f64,
    },
    /// Evenly, but not a whole number of them a turn, so that they lie elsewhere every turn; the sensor's columns are the next whole
    /// number, so that only firings closer together than usual share one.
    FreeRunning {
        /// Firings a turn.
        per_turn: f64,
    },
    /// Not to be told: the scans are motion compensated, jittered or from a scene too small. The columns are merely as many as a turn
    /// has firings.
    Unknown,
}

/// How one ring fits its points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RingFit {
    /// The ring's points.
    pub points: usize,
    /// Root mean square distance in height between the points and the beam, outliers left out, in metres.
    pub height_residual_m: f64,
    /// Points farther from the beam than four times the usual distance.
    pub outliers: usize,
    /// Root mean square distance between the points' azimuths and their columns' centres, as an arc, in metres; `None` if the columns
    /// are not an encoder's.
    pub azimuth_residual_m: Option<f64>,
    /// Azimuth offset against the ring with the most points, in radians: how far apart the two look when they fire together.
    /// Known only where the firings skip ticks, in a pattern that all rings share.
    pub firing_offset_rad: Option<f64>,
}

/// Scans that tell no sensor.
#[derive(Clone, Debug, Error)]
pub enum EstimateError {
    /// There is nothing to measure.
    #[error("{points} points in {clouds} scans; at least {} a ring are needed", beams::MIN_POINTS)]
    TooFewPoints {
        /// Points of all scans.
        points: usize,
        /// Scans.
        clouds: usize,
    },
    /// The points cannot be sorted into rings.
    #[error(
        "rings cannot be told: the scans have no ring field, are not in KITTI's order (ring after ring, each counter-clockwise from \
         straight ahead), and their elevations form no separate groups"
    )]
    NoRings,
    /// The result is no sensor.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// A scan is not fit to be projected.
    #[error(transparent)]
    Projection(#[from] ProjectionError),
}

impl Sensor {
    /// Measures the sensor that took these scans, each in the sensor's own frame and over a whole turn.
    ///
    /// A ring's elevation, height and lateral distance come from the line and the turn that its points lie on
    /// (z = √(d² − lateral²)·tan(elevation) + height, azimuth = encoder + offset + asin(lateral / d)); the columns from the number of
    /// ticks a turn at which the azimuths, so corrected, concentrate.
    pub fn estimate(clouds: &[PointCloud], options: &EstimateOptions) -> Result<Estimate, EstimateError> {
        let (mut beams, ring_source) = beams::sort(clouds)?;
        let lines: Vec<line::Line> = beams.iter().map(|beam| line::fit(beam, 0.0, 0.0)).collect();
        let mut order: Vec<usize> = (0..beams.len()).collect();
        order.sort_by(|a, b| lines[*b].tangent.total_cmp(&lines[*a].tangent));
        beams = order.iter().map(|i| std::mem::take(&mut beams[*i])).collect();

        let usual_height_m = line::median(&mut lines.iter().map(|line| line.height_m).collect::<Vec<_>>());

        let pitch = columns::find(&beams);
        let phases = if let Pitch::Encoder { phases, .. } = &pitch { phases.clone() } else { vec![None; beams.len()] };
        let mut rings = Vec::with_capacity(beams.len());
        let mut fits = Vec::with_capacity(beams.len());
        for (beam, phase) in beams.iter().zip(&phases) {
            let lateral_m = phase.map_or(0.0, |phase| phase.lateral_m);
            let line = line::fit(beam, lateral_m, usual_height_m);
            rings.push(Ring {
                elevation_rad: line.tangent.atan(),
                azimuth_offset_rad: phase.map_or(0.0, |phase| phase.offset_rad),
                height_m: line.height_m,
                lateral_m,
            });
            fits.push(RingFit {
                points: beam.len(),
                height_residual_m: line.residual_m,
                outliers: line.outliers,
                azimuth_residual_m: phase.map(|phase| phase.residual_m),
                firing_offset_rad: None,
            });
        }
        let (count, columns) = match pitch {
            Pitch::Encoder { columns, .. } => {
                firing::offsets(&beams, &rings, columns, &mut fits);
                (columns, Columns::Encoder { concentration: columns::concentration(&beams, &rings, columns) })
            }
            Pitch::FreeRunning { per_turn } => (per_turn.ceil() as usize, Columns::FreeRunning { per_turn }),
            Pitch::Unknown { columns } => (columns, Columns::Unknown),
        };
        let range_m = options.range_m.unwrap_or_else(|| seen_range_m(&beams));
        let sensor = Sensor::new(&options.name, rings, count, range_m, options.rotation_hz)?;
        let (mut points, mut lost) = (0, 0);
        let mut projector = Projector::new(&sensor);
        for cloud in clouds {
            let report = projector.project(cloud)?.report;
            points += report.points_in;
            lost += report.lost;
        }
        Ok(Estimate { sensor, ring_source, columns, rings: fits, points, lost })
    }
}

/// Half the nearest range and twice the farthest.
fn seen_range_m(beams: &[Beam]) -> (f32, f32) {
    let (mut nearest, mut farthest) = (f64::INFINITY, 0f64);
    for beam in beams {
        for (away, z) in beam.away_m.iter().zip(&beam.z_m) {
            let range = away.hypot(*z);
            (nearest, farthest) = (nearest.min(range), farthest.max(range));
        }
    }
    ((nearest / 2.0) as f32, (farthest * 2.0).min(10_000.0) as f32)
}

/// Azimuth from −½ to ½ column about the centre of the column that it lies in, and that column, clockwise from straight behind.
fn in_column(azimuth_rad: f64, columns: usize) -> (f64, usize) {
    let turn = ((PI - azimuth_rad) / TAU).rem_euclid(1.0) * columns as f64;
    let column = (turn as usize).min(columns - 1);
    (column as f64 + 0.5 - turn, column)
}
