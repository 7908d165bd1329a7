//! Which vehicles a labelled scan shows.

use std::collections::BTreeMap;

use lidar::PointCloud;
use lidar::label::class_of;

use super::footprint::Footprint;

/// Classes of the learning map: car, truck, other vehicle.
const VEHICLES: [u8; 3] = [1, 4, 5];

/// Returns without an instance are of one vehicle if cells of this side that hold some are at most so many cells apart: a vehicle's side
/// seen at a grazing angle has gaps, and parked cars are half a metre apart at least.
const CELL_M: f32 = 0.25;
const APART: i32 = 2;

/// Fewer returns show too little of a vehicle.
const FEWEST: usize = 20;

/// No car or van is larger, in metres: larger ones are several that stand too close, or lorries.
const LONGEST_M: f32 = 6.5;
const WIDEST_M: f32 = 2.6;

/// The vehicles of a scan, as far as they were seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Vehicles {
    /// Those that a detector should find.
    pub clear: Vec<Footprint>,
    /// Those of which too little is seen, or that cannot be told from others: to find them is neither right nor wrong.
    pub unclear: Vec<Footprint>,
}

impl Vehicles {
    /// Those that a cloud's labels show: by their instances where labels have some, else by the gaps between them.
    pub fn of(cloud: &PointCloud) -> Self {
        let mut instances: BTreeMap<u32, Vec<[f32; 2]>> = BTreeMap::new();
        let mut rest = vec![];
        for (i, label) in cloud.label.iter().flatten().enumerate() {
            if VEHICLES.contains(&class_of(*label)) {
                let place = [cloud.x[i], cloud.y[i]];
                match label >> 16 {
                    0 => rest.push(place),
                    instance => instances.entry(instance).or_default().push(place),
                }
            }
        }
        let mut vehicles = Self::default();
        for seen in instances.into_values().chain(apart(&rest)) {
            let footprint = Footprint::around(&seen);
            let too_large = footprint.length_m > LONGEST_M || footprint.width_m > WIDEST_M;
            let list = if seen.len() < FEWEST || too_large { &mut vehicles.unclear } else { &mut vehicles.clear };
            list.push(footprint);
        }
        vehicles
    }

    /// The same, turned about the sensor, and mirrored before, if they are to be.
    #[must_use]
    pub fn turned(&self, yaw_rad: f32, mirrored: bool) -> Self {
        let turned = |list: &[Footprint]| list.iter().map(|vehicle| vehicle.turned(yaw_rad, mirrored)).collect();
        Self { clear: turned(&self.clear), unclear: turned(&self.unclear) }
    }
}

/// Groups of places with gaps between them.
fn apart(places: &[[f32; 2]]) -> Vec<Vec<[f32; 2]>> {
    let mut cells: BTreeMap<[i32; 2], Vec<[f32; 2]>> = BTreeMap::new();
    for place in places {
        cells.entry(place.map(|along| (along / CELL_M).floor() as i32)).or_default().push(*place);
    }
    let mut groups = vec![];
    while let Some((first, places)) = cells.pop_first() {
        let (mut group, mut open) = (places, vec![first]);
        while let Some([row, column]) = open.pop() {
            for beside in (-APART..=APART)
                .flat_map(|i| (-APART..=APART).map(move |k| [row.saturating_add(i), column.saturating_add(k)]))
            {
                if let Some(places) = cells.remove(&beside) {
                    group.extend(places);
                    open.push(beside);
                }
            }
        }
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: u32 = 10;
    const BUILDING: u32 = 50;

    /// Two sides of a car of 4 m × 1.8 m whose near corner is at (x, y), 60 returns.
    fn car(x: f32, y: f32, label: u32, cloud: &mut PointCloud) {
        let side = (0..40).map(|i| [x + i as f32 / 10.0, y]).chain((0..20).map(|i| [x, y + 0.09 * i as f32]));
        for [x, y] in side {
            cloud.x.push(x);
            cloud.y.push(y);
            cloud.z.push(-1.0);
            cloud.intensity.push(0.2);
            cloud.label.get_or_insert_default().push(label);
        }
    }

    fn vehicles(cars: &[(f32, f32, u32)]) -> Vehicles {
        let mut cloud = PointCloud::new(1.0);
        for (x, y, label) in cars {
            car(*x, *y, *label, &mut cloud);
        }
        Vehicles::of(&cloud)
    }

    #[test]
    fn gaps_tell_vehicles_apart_and_instances_do_where_there_are_some() {
        let found = vehicles(&[(5.0, 2.0, CAR), (9.8, 2.0, CAR), (5.0, -4.0, BUILDING)]);
        assert_eq!((found.clear.len(), found.unclear.len()), (2, 0));
        let first = found.clear[0];
        assert!((first.length_m - 3.9).abs() < 0.1 && (first.width_m - 1.71).abs() < 0.1, "{first:?}");
        // Bumper to bumper they are one, and one that is too long.
        let touching = [(5.0, 2.0, CAR), (9.0, 2.0, CAR)];
        let found = vehicles(&touching);
        assert_eq!((found.clear.len(), found.unclear.len()), (0, 1));
        let found = vehicles(&touching.map(|(x, y, label)| (x, y, label | (x as u32) << 16)));
        assert_eq!((found.clear.len(), found.unclear.len()), (2, 0));
    }

    #[test]
    fn of_a_few_returns_nothing_is_claimed() {
        let mut cloud = PointCloud::new(1.0);
        car(5.0, 2.0, CAR, &mut cloud);
        let few = cloud.select(&(0..19).collect::<Vec<u32>>());
        let found = Vehicles::of(&few);
        assert_eq!((found.clear.len(), found.unclear.len()), (0, 1));
        cloud.label = None;
        assert_eq!(Vehicles::of(&cloud), Vehicles::default());
    }
}
