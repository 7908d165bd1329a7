//! The vehicle detector: a heat map whose peaks are centres, and at every cell the rectangle around it.
//!
//! Zhou et al., "Objects as points" (2019), as Yin et al., "Center-based 3D object detection and tracking" (CVPR 2021), have it from above;
//! its loss of the heat map is that of Law and Deng, "`CornerNet`" (ECCV 2018).

use burn::tensor::activation::{log_sigmoid, sigmoid};
use burn::tensor::{Device, Tensor, TensorData, s};
use lidar::birds_eye::{BirdsEye, CHANNELS, Grid};

use super::footprint::Footprint;
use super::vehicles::Vehicles;
use crate::network::Border;
use crate::segmentation::darknet::Shape;
use crate::segmentation::{Darknet, DarknetConfig};

/// Channels of what the network says: heat; ahead and left from the cell's middle to the vehicle's, in metres; the sides' logarithms; cosine
/// and sine of twice the direction.
const SAID: usize = 7;

/// The heat of a cell in an untrained network is about e^−4: nearly all cells are no centre.
const PRIOR: f64 = 4.0;

/// Standard deviation of the heat around a centre, in metres.
const SPREAD_M: f32 = 0.5;

/// Cells warmer than this say where the vehicle is.
const WARM: f32 = 0.3;

/// Weight of these beside the heat.
pub(super) const SHAPE_WEIGHT: f64 = 2.0;

/// Peaks below this score are not told.
const LEAST_SCORE: f32 = 0.05;

/// Most vehicles of a scan.
const MOST: usize = 100;

/// Nearer to another's than this no centre of a vehicle is, in metres.
const APART_M: f32 = 1.2;

/// Shortest and longest side that is believed, in metres.
const SIDES_M: [f32; 2] = [0.1, 20.0];

/// What is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    /// Where.
    pub(super) footprint: Footprint,
    /// How sure, 0 to 1.
    pub(super) score: f32,
}

/// What a network should say of scans.
#[derive(Clone, Debug)]
pub(super) struct Target {
    /// `[batch, 7, row, column]`; heat from 0 to 1.
    said: Tensor<4>,
    /// What a cell's heat counts, and what the rest of it does, `[batch, 2, row, column]`.
    weight: Tensor<4>,
}

/// A network with random weights.
pub(super) fn init(config: &DarknetConfig, device: &Device) -> Darknet {
    config.shaped(Shape { seen: CHANNELS, said: SAID, strides: [[2, 2]; 4] }, device)
}

/// Scans of one size as one tensor, `[batch, channel, row, column]`.
pub(super) fn tensor(scans: &[BirdsEye], device: &Device) -> Tensor<4> {
    let cells = scans.first().map_or(0, |scan| scan.cells);
    let values: Vec<f32> = scans.iter().flat_map(|scan| scan.values.iter().copied()).collect();
    Tensor::from_data(TensorData::new(values, [scans.len(), CHANNELS, cells, cells]), device)
}

impl Target {
    /// For scans that show these vehicles.
    pub(super) fn new(scans: &[Vehicles], grid: &Grid, device: &Device) -> Self {
        let cells = grid.cells();
        let area = cells * cells;
        let (mut said, mut weight) = (vec![0.0; scans.len() * SAID * area], vec![0.0; scans.len() * 2 * area]);
        for (vehicles, (said, weight)) in
            scans.iter().zip(said.chunks_mut(SAID * area).zip(weight.chunks_mut(2 * area)))
        {
            for (cell, counts) in weight[..area].iter_mut().enumerate() {
                let at = grid.on_ground([(cell / cells) as f32, (cell % cells) as f32]);
                *counts = f32::from(!vehicles.unclear.iter().any(|vehicle| vehicle.holds(at)));
            }
            for vehicle in &vehicles.clear {
                paint(vehicle, grid, said, weight);
            }
        }
        let tensor = |values, channels| {
            Tensor::from_data(TensorData::new(values, [scans.len(), channels, cells, cells]), device)
        };
        Self { said: tensor(said, SAID), weight: tensor(weight, 2) }
    }

    /// How far what a network said is from it: its heat, a vehicle, and all else, a warm cell.
    pub(super) fn miss(&self, said: &Tensor<4>) -> [Tensor<1>; 2] {
        let channels = |x: &Tensor<4>, from: usize, to: usize| x.clone().slice(s![.., from..to, .., ..]);
        let (logit, heat) = (channels(said, 0, 1) - PRIOR, channels(&self.said, 0, 1));
        let counted = channels(&self.weight, 0, 1);
        // 1 at the middle cell of a vehicle alone.
        let centre = heat.clone().greater_equal_elem(1.0).float();
        let (hot, cold) = (sigmoid(logit.clone()), sigmoid(-logit.clone()));
        let missed = log_sigmoid(logit.clone()) * cold.square() * centre.clone();
        let invented =
            log_sigmoid(-logit) * hot.square() * (heat * -1.0 + 1.0).powi_scalar(4) * (centre.clone() * -1.0 + 1.0);
        let vehicles = centre.sum().clamp_min(1.0);
        let heat_loss = -((missed + invented) * counted).sum() / vehicles;
        let warm = channels(&self.weight, 1, 2);
        let off = (channels(said, 1, SAID) - channels(&self.said, 1, SAID)).abs().sum_dim(1) * warm.clone();
        [heat_loss, off.sum() / warm.sum().clamp_min(1.0)]
    }
}

/// Adds a vehicle to what a network should say of its scan, `[7, row, column]`, and to the weights, `[2, row, column]`.
fn paint(vehicle: &Footprint, grid: &Grid, said: &mut [f32], weight: &mut [f32]) {
    let cells = grid.cells();
    let area = cells * cells;
    let Some(middle) = grid.cell(vehicle.center_m) else { return };
    let reach = (3.0 * SPREAD_M / grid.cell_m).ceil() as usize;
    let span = |at: usize| at.saturating_sub(reach)..(at + reach + 1).min(cells);
    for (row, column) in span(middle / cells).flat_map(|row| span(middle % cells).map(move |column| (row, column))) {
        let i = row * cells + column;
        let at = grid.on_ground([row as f32, column as f32]);
        let to = [0, 1].map(|k| vehicle.center_m[k] - at[k]);
        let warmth = (-(to[0] * to[0] + to[1] * to[1]) / (2.0 * SPREAD_M * SPREAD_M)).exp().min(0.999);
        let heat = if i == middle { 1.0 } else { warmth };
        if heat <= said[i] {
            continue;
        }
        said[i] = heat;
        if heat > WARM {
            weight[area + i] = 1.0;
            for (channel, value) in shape(vehicle, to).into_iter().enumerate() {
                said[(1 + channel) * area + i] = value;
            }
        }
    }
}

/// A vehicle as the network says it at a place from which its centre is so far ahead and left.
fn shape(vehicle: &Footprint, to: [f32; 2]) -> [f32; SAID - 1] {
    let side = |length: f32| length.clamp(SIDES_M[0], SIDES_M[1]).ln();
    let (sin, cos) = (2.0 * vehicle.yaw_rad).sin_cos();
    [to[0], to[1], side(vehicle.length_m), side(vehicle.width_m), cos, sin]
}

/// The vehicles that networks found, scan by scan, of what they say, `[batch, 7, row, column]`: peaks of the heat, the hottest first.
pub(super) fn found(said: Tensor<4>, grid: &Grid) -> Vec<Vec<Found>> {
    let cells = grid.cells();
    let area = cells * cells;
    let values: Vec<f32> = said.into_data().iter::<f32>().collect();
    values.chunks(SAID * area).map(|said| peaks(said, grid)).collect()
}

fn peaks(said: &[f32], grid: &Grid) -> Vec<Found> {
    let cells = grid.cells();
    let area = cells * cells;
    let least = (LEAST_SCORE / (1.0 - LEAST_SCORE)).ln() + PRIOR as f32;
    let peak = |i: &usize| {
        let (row, column) = (i / cells, i % cells);
        let span = |at: usize| at.saturating_sub(1)..(at + 2).min(cells);
        let mut beside = span(row).flat_map(|row| span(column).map(move |column| row * cells + column));
        said[*i] >= least && beside.all(|k| said[k] < said[*i] || (said[k] == said[*i] && k >= *i))
    };
    let mut peaks: Vec<usize> = (0..area).filter(peak).collect();
    peaks.sort_by(|a, b| said[*b].total_cmp(&said[*a]));
    let mut found: Vec<Found> = vec![];
    for i in peaks {
        let channel = |k: usize| said[k * area + i];
        let at = grid.on_ground([(i / cells) as f32, (i % cells) as f32]);
        let side = |k: usize| channel(k).exp().clamp(SIDES_M[0], SIDES_M[1]);
        let footprint = Footprint::new(
            [at[0] + channel(1), at[1] + channel(2)],
            [side(3), side(4)],
            channel(6).atan2(channel(5)) / 2.0,
        );
        if found.len() < MOST && found.iter().all(|other| other.footprint.distance_m(&footprint) >= APART_M) {
            let score = 1.0 / (1.0 + (PRIOR as f32 - said[i]).exp());
            found.push(Found { footprint, score });
        }
    }
    found
}

/// What a network finds in scans.
pub(super) fn detect(network: &Darknet, scans: &[BirdsEye], grid: &Grid) -> Vec<Vec<Found>> {
    let one = |scan: &BirdsEye| {
        let said = network.forward(tensor(std::slice::from_ref(scan), &Device::flex()), Border::Mirror);
        found(said, grid).pop().unwrap_or_default()
    };
    scans.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid { reach_m: 16.0, cell_m: 0.5, height_m: [-2.0, 2.0] };

    fn vehicles() -> Vehicles {
        Vehicles {
            clear: vec![Footprint::new([6.2, -3.1], [4.1, 1.7], 0.4), Footprint::new([-9.0, 8.3], [1.8, 0.4], -1.2)],
            unclear: vec![Footprint::new([0.0, 0.0], [4.0, 4.0], 0.0)],
        }
    }

    /// What a network that knows everything says: the target, its heat as logits.
    fn perfect(target: &Target) -> Tensor<4> {
        let heat = target.said.clone().slice(s![.., 0..1, .., ..]).clamp(1e-4, 1.0 - 1e-4);
        let logit = (heat.clone() / (heat * -1.0 + 1.0)).log() + PRIOR;
        Tensor::cat(vec![logit, target.said.clone().slice(s![.., 1.., .., ..])], 1)
    }

    #[test]
    fn who_says_what_should_be_said_finds_every_vehicle_and_no_other() {
        let (device, vehicles) = (Device::flex(), vehicles());
        let target = Target::new(std::slice::from_ref(&vehicles), &GRID, &device);
        let said = perfect(&target);
        let found = found(said.clone(), &GRID).remove(0);
        let sure: Vec<&Found> = found.iter().filter(|found| found.score > 0.99).collect();
        assert_eq!(sure.len(), 2, "{found:?}");
        for vehicle in &vehicles.clear {
            assert!(sure.iter().any(|found| found.footprint.overlap(vehicle) > 0.99), "{found:?}");
        }
        let miss = |said: &Tensor<4>| target.miss(said).map(|miss| miss.into_scalar::<f32>());
        // A warm cell costs a little even so: no heat but 0 and 1 is ever right.
        let ([heat, shape], silent) = (miss(&said), miss(&said.zeros_like()));
        assert!(heat < 0.1 && shape == 0.0 && silent[0] > 3.0 && silent[1] > 1.0, "{heat} {shape} {silent:?}");
    }

    #[test]
    fn what_is_said_of_unclear_vehicles_does_not_count() {
        let device = Device::flex();
        let target = Target::new(&[vehicles()], &GRID, &device);
        let said = perfect(&target);
        let heat_at = |place: [f32; 2]| {
            let cell = GRID.cell(place).unwrap_or(0);
            let mut values = vec![0.0; 64 * 64];
            values[cell] = 12.0;
            let heat = Tensor::<4>::from_data(TensorData::new(values, [1, 1, 64, 64]), &device);
            let rest = Tensor::zeros([1, SAID - 1, 64, 64], &device);
            let [heat, _] = target.miss(&(said.clone() + Tensor::cat(vec![heat, rest], 1)));
            heat.into_scalar::<f32>()
        };
        let right = target.miss(&said)[0].clone().into_scalar::<f32>();
        assert!((heat_at([0.2, 0.2]) - right).abs() < 1e-6, "within the unclear one");
        assert!(heat_at([12.0, 12.0]) > right + 1.0, "where there is nothing");
    }
}
