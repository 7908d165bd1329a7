//! Sensors of many kinds, small enough that hundreds of sets can be judged.

use lidar::Sensor;
use lidar::sensor::SensorError;
use rand::{RngExt, SeedableRng};

use crate::dice::Dice;

/// A made-up sensor: 16, 24 or 32 rings over some span, evenly or denser towards its top, 256 or 512 columns, up to 80–120 m.
pub fn small_sensor(seed: u64) -> Sensor {
    let mut dice = Dice::seed_from_u64(seed);
    let rings = [16, 24, 32][dice.random_range(0..3)];
    let columns = [256, 512][dice.random_range(0..2)];
    let (top_deg, bottom_deg) = (dice.random_range(1.0..8.0), dice.random_range(-26.0..-16.0));
    let crowding = if dice.random() { 1.0 } else { dice.random_range(1.1..1.3) };
    let elevations_deg = (0..rings).map(|i| {
        let share = (i as f64 / (rings - 1) as f64).powf(crowding);
        // Hundredths of a degree: what a data sheet says.
        ((top_deg + (bottom_deg - top_deg) * share) * 100.0_f64).round() / 100.0
    });
    let farthest_m = [80.0, 100.0, 120.0][dice.random_range(0..3)];
    let rotation_hz = [10.0, 20.0][dice.random_range(0..2)];
    let name = format!("spinning-{rings}-{columns}-{seed}");
    Sensor::from_elevations_deg(&name, elevations_deg, columns, (1.0, farthest_m), rotation_hz)
        .unwrap_or_else(|_| unreachable!("every number above is within what a sensor may have"))
}

/// A made-up sensor of any size: rings evenly from 5° above to 25° below, up to 100 m.
///
/// # Errors
/// If no sensor has so many rings or columns.
pub fn even_sensor(rings: usize, columns: usize) -> Result<Sensor, SensorError> {
    let gap_deg = 30.0 / rings.saturating_sub(1).max(1) as f64;
    let elevations_deg = (0..rings).map(|i| 5.0 - gap_deg * i as f64);
    Sensor::from_elevations_deg(&format!("even-{rings}-{columns}"), elevations_deg, columns, (1.0, 100.0), 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn sensors_differ_in_size_and_every_one_looks_down_ring_by_ring() {
        let sensors: Vec<Sensor> = (0..40).map(small_sensor).collect();
        let sizes: BTreeSet<[usize; 2]> = sensors.iter().map(|s| [s.rings().len(), s.columns()]).collect();
        assert_eq!(sizes.len(), 6);
        for sensor in &sensors {
            let gaps_rad = sensor.rings().windows(2).map(|w| w[0].elevation_rad - w[1].elevation_rad);
            let narrowest_rad = gaps_rad.fold(f64::INFINITY, f64::min);
            assert!(narrowest_rad > 0.15_f64.to_radians(), "{}: rings {narrowest_rad} rad apart", sensor.name);
        }
    }
}
