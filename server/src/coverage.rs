//! How much of a model's grid a scan covers, and what to say if it is little.

use lidar::{Projection, Sensor};
use serde::Serialize;

/// Share of the rings below which a scan is taken for another sensor's.
const ENOUGH_RINGS: f64 = 0.9;
/// Share of the turn below which a scan is taken for part of a sweep: 300 of 360 degrees.
const ENOUGH_SECTORS: f64 = 300.0 / 360.0;
/// Share of the points that may be hidden behind nearer ones of the same ray; past it the scan's grid is finer than the model's.
const TOLERABLE_LOSS: f64 = 0.5;
/// Sectors that a turn is split into: ten degrees each, so that a scan of fewer columns than the model's still fills them.
const SECTORS: usize = 36;

/// Where on a sensor's grid a scan has returns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Coverage {
    /// Share of the rings that have a return.
    pub rings: f64,
    /// Share of the turn, by sectors of ten degrees, that has a return.
    pub turn: f64,
    /// Share of the points in view that lost their ray to a nearer point.
    pub lost: f64,
}

impl Coverage {
    /// The coverage of a projected scan.
    pub fn of(projection: &Projection) -> Self {
        let (image, report) = (&projection.image, &projection.report);
        let columns = image.columns();
        let seen = |sector: &usize| {
            // The columns whose share of the turn, column · SECTORS / columns, is this sector.
            let [from, to] = [*sector, sector + 1].map(|sector| (sector * columns).div_ceil(SECTORS));
            image.range_m().chunks(columns.max(1)).any(|row| row[from..to].iter().any(|range_m| *range_m > 0.0))
        };
        let seen = (0..SECTORS).filter(seen).count();
        Self {
            rings: report.rings_seen as f64 / image.rings().max(1) as f64,
            turn: seen as f64 / SECTORS as f64,
            lost: report.lost as f64 / (report.projected + report.lost).max(1) as f64,
        }
    }

    /// What the sender should change so that the scan fits the model's sensor; `None` if it does.
    pub fn warning(&self, sensor: &Sensor) -> Option<String> {
        let rings = sensor.rings().len();
        let mut findings = Vec::new();
        if self.rings < ENOUGH_RINGS {
            let seen = (self.rings * rings as f64).round();
            findings.push(format!("the scan has points on {seen} of the model's {rings} rings"));
        }
        if self.lost > TOLERABLE_LOSS {
            let percent = self.lost * 100.0;
            findings.push(format!("{percent:.0} % of the points share a ray with a nearer point and are lost"));
        }
        let other_grid = !findings.is_empty();
        if self.turn < ENOUGH_SECTORS {
            findings.push(format!("the scan covers {:.0} of 360 degrees: send whole sweeps", self.turn * 360.0));
        }
        if other_grid {
            let elevations = || sensor.rings().iter().map(|ring| ring.elevation_rad.to_degrees());
            let (top, bottom) = (elevations().fold(f64::MIN, f64::max), elevations().fold(f64::MAX, f64::min));
            findings.push(format!(
                "simulate {rings} rings from {top:+.1} to {bottom:+.1} deg with {} columns; GET /info has the list",
                sensor.columns()
            ));
        }
        (!findings.is_empty()).then(|| findings.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use lidar::sensor::SensorError;

    use super::*;

    #[test]
    fn a_warning_says_which_rings_to_simulate() -> Result<(), SensorError> {
        let sensor = Sensor::builtin("hdl64e")?;
        let good = Coverage { rings: 1.0, turn: 1.0, lost: 0.1 };
        assert_eq!(good.warning(&sensor), None);
        assert_eq!(
            Coverage { rings: 0.5, ..good }.warning(&sensor).as_deref(),
            Some(
                "the scan has points on 32 of the model's 64 rings; simulate 64 rings from +1.9 to -24.9 deg with 2048 columns; \
                 GET /info has the list"
            )
        );
        assert_eq!(
            Coverage { turn: 0.5, ..good }.warning(&sensor).as_deref(),
            Some("the scan covers 180 of 360 degrees: send whole sweeps")
        );
        assert!(Coverage { lost: 0.6, ..good }.warning(&sensor).is_some_and(|w| w.starts_with("60 % of the points")));
        Ok(())
    }
}
