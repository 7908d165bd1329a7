//! Vehicles that drive and park, and people on the pavements.

use std::f32::consts::PI;

use glam::{Affine3A, Mat3A, Vec3A};
use lidar::label::CLASS_IDS;
use rand::RngExt;

use super::marking::{BAY_M, bay_edges};
use super::plan::{Plan, Side};
use super::{Dice, Site};
use super::{bicycle, car, lorry, person};

/// `SemanticKITTI` ids of what moves.
const MOVING_CAR: u32 = 252;
const MOVING_LORRY: u32 = 258;
const MOVING_BUS: u32 = 257;
const MOVING_PERSON: u32 = 254;
const MOVING_BICYCLIST: u32 = 253;
const MOVING_MOTORCYCLIST: u32 = 255;

/// No vehicle comes nearer along the sensor's own lane.
const CLEAR_AHEAD_M: f32 = 10.0;

/// Fills lanes and parking bays.
pub(super) fn vehicles(site: &mut Site, plan: &Plan, dice: &mut Dice) {
    for lane in 0..plan.lanes {
        for sign in [1.0, -1.0] {
            driving(site, plan, sign * plan.lane_width_m * (lane as f32 + 0.5), dice);
        }
    }
    for (i, side) in plan.sides.iter().enumerate() {
        parked(site, plan, i, side, dice);
        driveways(site, plan, side, dice);
    }
}

/// One lane's traffic; on the left of the road's middle it comes towards the sensor.
fn driving(site: &mut Site, plan: &Plan, lane_m: f32, dice: &mut Dice) {
    if plan.config.vehicles_per_m <= 0.0 {
        return;
    }
    let mean_m = (1.0 / plan.config.vehicles_per_m).max(14.0);
    let turn = if lane_m > 0.0 { PI } else { 0.0 };
    let mut along = -plan.reach_m + 8.0 + dice.random_range(0.0..mean_m);
    while along < plan.reach_m - 8.0 {
        // The sensor's own car is there, and vehicles beside it keep to the middle of their lanes.
        let beside = along.abs() < CLEAR_AHEAD_M;
        let own_lane = plan.road.at(0.0, lane_m, 0.0).y.abs() < 0.5;
        let drift = if beside { 0.0 } else { dice.random_range(-0.3..0.3) };
        if !(beside && own_lane) {
            let kerbside = lane_m + lane_m.signum() * 0.3 * plan.lane_width_m;
            match dice.random_range(0..100) {
                0..64 => {
                    let label = site.instance(MOVING_CAR);
                    put(site, plan, &car::build(label, dice), [along, lane_m + drift], turn);
                }
                64..74 => {
                    let label = site.instance(MOVING_LORRY);
                    put(site, plan, &lorry::lorry(label, dice), [along, lane_m], turn);
                }
                74..82 => {
                    let label = site.instance(MOVING_BUS);
                    put(site, plan, &lorry::bus(label, dice), [along, lane_m], turn);
                }
                82..93 => {
                    let label = site.instance(MOVING_BICYCLIST);
                    put(site, plan, &bicycle::bicycle(label, true, dice), [along, kerbside], turn);
                }
                _ => {
                    let label = site.instance(MOVING_MOTORCYCLIST);
                    put(site, plan, &bicycle::motorcycle(label, true, dice), [along, lane_m + drift], turn);
                }
            }
        }
        along += 13.0 + dice.random_range(0.0..2.0) * (mean_m - 13.0);
    }
}

fn parked(site: &mut Site, plan: &Plan, i: usize, side: &Side, dice: &mut Dice) {
    let Some([from, to]) = side.parking_m else { return };
    let middle = side.sign * 0.5 * (from + to);
    // Most park the way they drive.
    let with_traffic = if side.sign > 0.0 { PI } else { 0.0 };
    let mut edges = bay_edges(plan, i);
    while let Some(edge) = edges.next() {
        let along = edge + 0.5 * BAY_M + dice.random_range(-0.35..0.35);
        if dice.random::<f32>() > plan.config.parked_share || plan.to_junction_m(i, along) < 6.0 {
            continue;
        }
        let reversed = if dice.random_bool(0.8) { 0.0 } else { PI };
        let turn = with_traffic + reversed + dice.random_range(-0.03..0.03);
        let at = [along, middle + dice.random_range(-0.1..0.1)];
        match dice.random_range(0..100) {
            0..87 => {
                let label = site.instance(CLASS_IDS[1]);
                put(site, plan, &car::build(label, dice), at, turn);
            }
            87..91 => {
                let label = site.instance(CLASS_IDS[5]);
                put(site, plan, &lorry::trailer(label, dice), at, turn);
            }
            91..94 => {
                // It takes the next bay too.
                edges.next();
                let label = site.instance(CLASS_IDS[4]);
                put(site, plan, &lorry::lorry(label, dice), [edge + BAY_M, middle], turn);
            }
            _ => {
                for k in 0..dice.random_range(1..4) {
                    let label = site.instance(CLASS_IDS[3]);
                    let at = [along + 0.9 * k as f32 - 1.5, at[1]];
                    put(site, plan, &bicycle::motorcycle(label, false, dice), at, turn + 0.5 * PI);
                }
            }
        }
    }
}

fn driveways(site: &mut Site, plan: &Plan, side: &Side, dice: &mut Dice) {
    for lot in &side.lots {
        let Some([a, b]) = lot.driveway_m else { continue };
        if dice.random_bool(0.5) {
            let label = site.instance(CLASS_IDS[1]);
            let turn = if dice.random() { 0.5 * PI } else { -0.5 * PI };
            put(site, plan, &car::build(label, dice), [0.5 * (a + b), side.sign * (lot.front_m + 1.5)], turn);
        }
    }
}

/// People on the pavements and on the zebra crossings.
pub(super) fn people(site: &mut Site, plan: &Plan, dice: &mut Dice) {
    for (i, side) in plan.sides.iter().enumerate() {
        let count = (2.0 * plan.reach_m * plan.config.people_per_m) as usize;
        for _ in 0..count {
            let along = dice.random_range(-plan.reach_m + 1.0..plan.reach_m - 1.0);
            let away = dice.random_range(side.pavement_m[0] + 0.3..side.pavement_m[1] - 0.3);
            if plan.to_junction_m(i, along) > 0.5 {
                let moving = dice.random_bool(0.7);
                let turn = if dice.random() { 0.0 } else { PI } + dice.random_range(-0.4..0.4);
                somebody(site, plan, [along, side.sign * away], turn, moving, dice);
            }
        }
    }
    for along in &plan.zebras_m {
        if along.abs() < CLEAR_AHEAD_M {
            continue;
        }
        for _ in 0..dice.random_range(0..4) {
            let left = dice.random_range(-plan.half_m..plan.half_m);
            let turn = if dice.random() { 0.5 * PI } else { -0.5 * PI };
            somebody(site, plan, [along + dice.random_range(-1.3..1.3), left], turn, true, dice);
        }
    }
}

fn somebody(site: &mut Site, plan: &Plan, at: [f32; 2], turn: f32, moving: bool, dice: &mut Dice) {
    let label = site.instance(if moving { MOVING_PERSON } else { CLASS_IDS[6] });
    put(site, plan, &person::walking(label, dice), at, turn);
}

/// Puts something on the ground at (along, left), leaning as the ground does.
fn put(site: &mut Site, plan: &Plan, thing: &crate::mesh::Mesh, at: [f32; 2], turn_rad: f32) {
    let [along, left] = at;
    let flat = plan.road.frame(along, left, plan.step_m(along, left), turn_rad);
    let ahead = plan.road.at(along + 1.3, left, 0.0) - plan.road.at(along - 1.3, left, 0.0);
    let across = plan.road.at(along, left + 0.8, 0.0) - plan.road.at(along, left - 0.8, 0.0);
    let up = Vec3A::from(ahead.cross(across)).normalize();
    let y = up.cross(flat.matrix3.x_axis).normalize();
    let world_from_thing = Affine3A { matrix3: Mat3A::from_cols(y.cross(up), y, up), translation: flat.translation };
    site.put(thing, &world_from_thing);
}
