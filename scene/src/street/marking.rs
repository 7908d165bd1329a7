//! Paint on the road, and the other grounds that are laid over the strips along it.

use rand::RngExt;

use super::Dice;
use super::plan::{Junction, LAND_M, Patch, Plan, Side, ZEBRA_HALF_M};
use super::surface::Surface;

/// Width of a line.
const LINE_M: f32 = 0.13;

/// All patches of a street, in the order in which they are laid.
pub(super) fn patches(plan: &Plan, dice: &mut Dice) -> Vec<Patch> {
    let mut patches = Vec::new();
    repairs(plan, &mut patches, dice);
    bays(plan, &mut patches);
    lines(plan, &mut patches, dice);
    driveways(plan, &mut patches);
    for junction in &plan.junctions {
        for (side, _) in plan.sides.iter().zip(junction.goes).filter(|(_, goes)| *goes) {
            side_street(plan, *junction, side, &mut patches);
        }
    }
    for along_m in &plan.zebras_m {
        zebra(plan, *along_m, &mut patches);
    }
    patches
}

fn patch(along_m: [f32; 2], left_m: [f32; 2], surface: Surface) -> Patch {
    let sorted = |span: [f32; 2]| [span[0].min(span[1]), span[0].max(span[1])];
    Patch { along_m: sorted(along_m), left_m: sorted(left_m), surface }
}

/// A line along the road, its middle at `left_m`.
fn line(along_m: [f32; 2], left_m: f32) -> Patch {
    patch(along_m, [left_m - 0.5 * LINE_M, left_m + 0.5 * LINE_M], Surface::Paint)
}

/// Trenches that were dug and closed again, and lids.
fn repairs(plan: &Plan, patches: &mut Vec<Patch>, dice: &mut Dice) {
    for _ in 0..dice.random_range(2..9) {
        let along = dice.random_range(-plan.reach_m..plan.reach_m);
        let left = dice.random_range(-plan.half_m..plan.half_m - 1.2);
        let (length, width) = (dice.random_range(1.5..14.0), dice.random_range(0.6..1.2));
        patches.push(patch([along, along + length], [left, left + width], Surface::Repair));
    }
    for _ in 0..(plan.reach_m / 12.0) as usize {
        let along = dice.random_range(-plan.reach_m..plan.reach_m);
        let left = dice.random_range(-plan.half_m..plan.half_m - 0.7);
        patches.push(patch([along, along + 0.6], [left, left + 0.6], Surface::Lid));
    }
}

/// Lines between parking bays.
fn bays(plan: &Plan, patches: &mut Vec<Patch>) {
    for (i, side) in plan.sides.iter().enumerate() {
        let Some([from, to]) = side.parking_m else { continue };
        for along in bay_edges(plan, i) {
            let span = [along - 0.5 * LINE_M, along + 0.5 * LINE_M];
            patches.push(patch(span, [side.sign * from, side.sign * to], Surface::Paint));
        }
    }
}

/// Length of a parking bay.
pub(super) const BAY_M: f32 = 5.8;

/// Where one parking bay ends and the next begins.
pub(super) fn bay_edges(plan: &Plan, side: usize) -> impl Iterator<Item = f32> {
    let count = (plan.reach_m / BAY_M) as i32;
    (-count..=count)
        .map(|k| k as f32 * BAY_M)
        .filter(move |along| plan.to_junction_m(side, *along) > 5.0 && plan.to_zebra_m(*along) > ZEBRA_HALF_M + 5.0)
}

/// Middle, lane and edge lines.
fn lines(plan: &Plan, patches: &mut Vec<Patch>, dice: &mut Dice) {
    let (dash_m, gap_m) = [(3.0, 6.0), (3.0, 3.0), (6.0, 6.0)][dice.random_range(0..3)];
    let double = plan.lanes > 1 && dice.random_bool(0.6);
    let edge_lines = dice.random_bool(0.6);
    let whole = [-plan.reach_m, plan.reach_m];
    if double {
        patches.extend([line(whole, 0.14), line(whole, -0.14)]);
    }
    let mut along = -plan.reach_m + 1.0;
    while along + dash_m < plan.reach_m {
        let dash = [along, along + dash_m];
        if !double {
            patches.push(line(dash, 0.0));
        }
        for lane in 1..plan.lanes {
            let left = lane as f32 * plan.lane_width_m;
            patches.extend([line(dash, left), line(dash, -left)]);
        }
        along += dash_m + gap_m;
    }
    if edge_lines {
        let left = plan.half_m - 0.2;
        patches.extend([line(whole, left), line(whole, -left)]);
    }
}

fn driveways(plan: &Plan, patches: &mut Vec<Patch>) {
    for side in &plan.sides {
        for lot in &side.lots {
            if let Some(along_m) = lot.driveway_m {
                let span = [side.sign * (side.pavement_m[1] + 0.02), side.sign * (lot.front_m + 6.0)];
                patches.push(patch(along_m, span, Surface::Parking));
            }
        }
    }
}

/// A side street: its pavements, kerbs and asphalt out to the land's edge, and its own paint.
fn side_street(plan: &Plan, junction: Junction, side: &Side, patches: &mut Vec<Patch>) {
    let Junction { along_m, half_m, .. } = junction;
    let across = |from: f32, to: f32| [side.sign * from, side.sign * to];
    let around = |more: f32| [along_m - half_m - more, along_m + half_m + more];
    let out = across(side.pavement_m[0], LAND_M);
    patches.push(patch(around(2.4), out, Surface::Pavement));
    patches.push(patch(around(0.15), across(side.kerb_m, LAND_M), Surface::Kerb));
    patches.push(patch(around(0.0), across(plan.half_m, LAND_M), Surface::Road));
    // Traffic keeps right: who comes out of the left-hand street stops on its north side as seen along the road.
    let stop_m = plan.half_m + 0.5;
    let half = if side.sign > 0.0 { [along_m - half_m, along_m] } else { [along_m, along_m + half_m] };
    patches.push(patch(half, across(stop_m, stop_m + 0.5), Surface::Paint));
    let mut from = stop_m + 2.5;
    while from < 45.0 {
        let span = [along_m - 0.5 * LINE_M, along_m + 0.5 * LINE_M];
        patches.push(patch(span, across(from, from + 3.0), Surface::Paint));
        from += 7.0;
    }
}

/// A zebra crossing with the lines before which traffic stops.
fn zebra(plan: &Plan, along_m: f32, patches: &mut Vec<Patch>) {
    let span = [along_m - ZEBRA_HALF_M, along_m + ZEBRA_HALF_M];
    // Lines and lids do not run on across it.
    patches.push(patch([span[0] - 1.5, span[1] + 1.5], [-plan.half_m, plan.half_m], Surface::Road));
    let stripes = ((2.0 * plan.half_m - 0.4) / 1.0) as usize;
    for k in 0..stripes {
        let left = -0.5 * stripes as f32 + 0.25 + k as f32;
        patches.push(patch(span, [left, left + 0.5], Surface::Paint));
    }
    let stop = |at: f32, left: [f32; 2]| patch([at, at + 0.4], left, Surface::Paint);
    patches.push(stop(span[0] - 1.2, [-plan.half_m + 0.3, -0.15]));
    patches.push(stop(span[1] + 0.8, [0.15, plan.half_m - 0.3]));
}
