//! Houses with their gardens, and what stands on the pavements.

use std::f32::consts::PI;

use glam::{Affine3A, vec3};
use rand::RngExt;

use super::bicycle;
use super::fence::fence;
use super::house::{House, Roof};
use super::plan::{Lot, LotKind, Plan, Side};
use super::pole;
use super::tree::{bush, hedge};
use super::{Dice, Site};
use crate::material::Material;
use crate::mesh::Mesh;
use crate::shape::{Bar, bar, cuboid};
use lidar::label::CLASS_IDS;

/// `SemanticKITTI` ids that its learning map has no class for.
const OTHER_STRUCTURE: u32 = 52;
const OTHER_OBJECT: u32 = 99;

impl Plan {
    /// A frame on one side of the road: x along it, y away from it.
    pub(super) fn side_frame(&self, side: &Side, along_m: f32, away_m: f32) -> Affine3A {
        let left = side.sign * away_m;
        let turn = if side.sign > 0.0 { 0.0 } else { PI };
        self.road.frame(along_m, left, self.step_m(along_m, left), turn)
    }

    /// The frame of a lot so far from the road's middle, and its width there: x runs along it, y away from the street. In a bend
    /// lots are wider or narrower there than at the road.
    fn lot_frame(&self, side: &Side, lot: &Lot, away_m: f32) -> (Affine3A, f32) {
        let left = side.sign * away_m;
        let [from, to] = if side.sign > 0.0 { lot.along_m } else { [lot.along_m[1], lot.along_m[0]] };
        self.road.frame_towards([from, left], [to, left], self.step_m(from, left))
    }
}

/// Puts a house on every lot that is built on, and something green or a fence around it.
pub(super) fn houses(site: &mut Site, plan: &Plan, dice: &mut Dice) {
    for side in &plan.sides {
        let shared_storeys = dice.random_range(2..4usize);
        let shared_roof = if dice.random_bool(0.75) { Roof::Along } else { Roof::Across };
        for lot in &side.lots {
            let (frame, width_m) = plan.lot_frame(side, lot, lot.front_m);
            if let Some((house, x)) = house_for(lot.kind, width_m, shared_storeys, shared_roof, dice) {
                let place = frame * Affine3A::from_translation(vec3(x, 0.0, 0.0));
                site.put(&house.build(dice), &place);
            }
            garden(site, plan, side, lot, dice);
        }
    }
}

/// A house that fits the lot, and how far from the lot's corner it begins.
fn house_for(kind: LotKind, width_m: f32, storeys: usize, roof: Roof, dice: &mut Dice) -> Option<(House, f32)> {
    let any_roof = [Roof::Along, Roof::Across, Roof::Hipped][dice.random_range(0..3)];
    let house = House {
        width_m,
        depth_m: dice.random_range(8.0..11.5),
        storeys,
        storey_m: dice.random_range(2.7..3.1),
        roof,
        shop: false,
        balconies: false,
        open_sides: false,
    };
    match kind {
        LotKind::Open => None,
        LotKind::Terrace => {
            let storeys = if dice.random_bool(0.3) { storeys + 1 } else { storeys };
            Some((House { storeys, shop: dice.random_bool(0.12), ..house }, 0.0))
        }
        LotKind::Detached => {
            let width_m = (width_m - dice.random_range(5.0..7.0)).clamp(5.0, 13.0);
            let storeys = dice.random_range(1..3);
            Some((House { width_m, storeys, roof: any_roof, open_sides: true, ..house }, 4.0))
        }
        LotKind::Block => {
            let width_m = (width_m - 3.0).max(5.0);
            let storeys = dice.random_range(3..6);
            let roof = if dice.random_bool(0.7) { Roof::Flat } else { any_roof };
            let (shop, balconies) = (dice.random_bool(0.35), dice.random_bool(0.5));
            let depth_m = dice.random_range(10.0..15.0);
            Some((House { width_m, depth_m, storeys, roof, shop, balconies, open_sides: true, ..house }, 1.5))
        }
    }
}

/// A hedge, a fence or bushes between the pavement and the house, and a fence between neighbours' back gardens.
fn garden(site: &mut Site, plan: &Plan, side: &Side, lot: &Lot, dice: &mut Dice) {
    let edge_m = side.pavement_m[1] + 0.35;
    let detail = detail_at(0.5 * (lot.along_m[0] + lot.along_m[1]));
    if lot.front_m - edge_m > 1.5 {
        let kind = dice.random_range(0..4);
        for span in free_of_driveway(lot) {
            let start = if side.sign > 0.0 { span[0] } else { span[1] };
            let place = plan.side_frame(side, start, edge_m);
            match kind {
                0 => site.put(&hedge(span[1] - span[0], dice.random_range(0.7..1.8), detail, dice), &place),
                1 => site.put(&fence(span[1] - span[0], dice), &place),
                _ => {}
            }
        }
        for _ in 0..dice.random_range(0..3) {
            let along = dice.random_range(lot.along_m[0] + 0.8..lot.along_m[1] - 0.8);
            if lot.driveway_m.is_none_or(|d| along < d[0] - 1.2 || along > d[1] + 1.2) {
                let away = dice.random_range(edge_m + 1.0..lot.front_m.max(edge_m + 1.2));
                site.put(&bush(detail, dice), &plan.side_frame(side, along, away));
            }
        }
    }
    if lot.kind != LotKind::Block {
        let (back, width_m) = plan.lot_frame(side, lot, lot.front_m + 12.0);
        let turned = back * Affine3A::from_rotation_z(0.5 * PI);
        site.put(&if dice.random() { fence(9.0, dice) } else { hedge(9.0, 1.7, 0.5 * detail, dice) }, &turned);
        if dice.random_bool(0.5) {
            site.put(&fence(width_m, dice), &(back * Affine3A::from_translation(vec3(0.0, 9.0, 0.0))));
        }
    }
}

/// The lot's front without its driveway.
fn free_of_driveway(lot: &Lot) -> Vec<[f32; 2]> {
    let [from, to] = lot.along_m;
    let spans = match lot.driveway_m {
        Some([a, b]) => vec![[from, a - 0.2], [b + 0.2, to]],
        None => vec![[from, to]],
    };
    spans.into_iter().filter(|s| s[1] - s[0] > 1.0).collect()
}

/// Share of a plant's leaves that are worth building so far from the sensor.
pub(super) fn detail_at(along_m: f32) -> f32 {
    (30.0 / along_m.abs().max(30.0)).max(0.3)
}

/// Lamps, signs, lights, bollards, bins, benches, shelters and bicycles along the pavements.
pub(super) fn furniture(site: &mut Site, plan: &Plan, dice: &mut Dice) {
    for (i, side) in plan.sides.iter().enumerate() {
        let row_m = side.kerb_m + 0.13 + 0.4;
        let lamps_m = dice.random_range(22.0..38.0f32);
        let mut along = -plan.reach_m + dice.random_range(2.0..lamps_m);
        while along < plan.reach_m - 2.0 {
            if plan.to_junction_m(i, along) > 1.5 && plan.to_zebra_m(along) > 3.0 {
                site.put(&pole::lamp_post(dice), &plan.side_frame(side, along, row_m));
            }
            along += lamps_m;
        }
        let mut along = -plan.reach_m + dice.random_range(3.0..12.0f32);
        while along < plan.reach_m - 4.0 {
            let beside = side.verge_m.map_or(side.pavement_m[0] + 0.3, |verge| 0.5 * (verge[0] + verge[1]));
            if plan.to_junction_m(i, along) > 4.0 && plan.to_zebra_m(along) > 4.0 && along.abs() > 5.0 {
                one_thing(site, plan, side, along, [row_m, beside], dice);
            }
            along += dice.random_range(6.0..16.0f32);
        }
    }
    crossings(site, plan, dice);
}

/// Something at random; `away_m` is where poles stand and where wider things do.
fn one_thing(site: &mut Site, plan: &Plan, side: &Side, along: f32, away_m: [f32; 2], dice: &mut Dice) {
    let pole_frame = facing_traffic(plan, side, along, away_m[0]);
    let wide = plan.side_frame(side, along, away_m[1]);
    let back = plan.side_frame(side, along, side.pavement_m[1] - 0.35);
    match dice.random_range(0..20) {
        0..6 => site.put(&pole::traffic_sign(dice), &pole_frame),
        6 => site.put(&pole::board(dice), &pole_frame),
        7 | 8 => {
            for k in 0..dice.random_range(2..6) {
                let at = along + 1.4 * k as f32;
                site.put(&pole::plain(0.9, 0.06, dice), &plan.side_frame(side, at, away_m[0]));
            }
        }
        9 => site.put(&pole::plain(dice.random_range(6.0..8.5), 0.11, dice), &pole_frame),
        10..13 => site.put(&bin(dice), &wide),
        13 => site.put(&bench(dice), &back),
        14 if side.pavement_m[1] - side.pavement_m[0] > 2.4 => {
            site.put(&shelter(dice), &plan.side_frame(side, along, side.pavement_m[1] - 1.3));
        }
        _ => {
            for k in 0..dice.random_range(1..5) {
                let label = site.instance(CLASS_IDS[2]);
                let lean = Affine3A::from_rotation_z(dice.random_range(-0.2..0.2) + 0.5 * PI);
                let frame = plan.side_frame(side, along + 0.7 * k as f32, away_m[1] + 0.9);
                site.put(&bicycle::bicycle(label, false, dice), &(frame * lean));
            }
        }
    }
}

/// A frame whose x runs with the traffic of this side's lane.
fn facing_traffic(plan: &Plan, side: &Side, along_m: f32, away_m: f32) -> Affine3A {
    plan.side_frame(side, along_m, away_m) * Affine3A::from_rotation_z(PI)
}

/// Signs and lights at zebra crossings and side streets.
fn crossings(site: &mut Site, plan: &Plan, dice: &mut Dice) {
    for along in &plan.zebras_m {
        let lights = dice.random_bool(0.5);
        for side in &plan.sides {
            let frame = facing_traffic(plan, side, along + side.sign * 2.6, side.kerb_m + 0.5);
            let thing = if lights { pole::traffic_light(dice) } else { pole::traffic_sign(dice) };
            site.put(&thing, &frame);
        }
    }
    for junction in &plan.junctions {
        for (i, side) in plan.sides.iter().enumerate() {
            if junction.goes[i] {
                let along = junction.along_m - side.sign * (junction.half_m + 0.7);
                let turn = Affine3A::from_rotation_z(-0.5 * PI);
                site.put(&pole::traffic_sign(dice), &(plan.side_frame(side, along, side.pavement_m[1] + 0.5) * turn));
            }
        }
    }
}

fn bin(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let material = mesh.add_material(Material::diffuse(OTHER_OBJECT, dice.random_range(0.1..0.6)));
    if dice.random() {
        cuboid(&mut mesh, vec3(-0.3, -0.35, 0.0), vec3(0.3, 0.35, 1.05), material);
    } else {
        bar(&mut mesh, Bar::even(vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.9), 0.25, 12), material);
    }
    mesh
}

fn bench(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let material = mesh.add_material(Material::diffuse(OTHER_OBJECT, dice.random_range(0.2..0.5)));
    cuboid(&mut mesh, vec3(-0.9, -0.25, 0.4), vec3(0.9, 0.2, 0.46), material);
    cuboid(&mut mesh, vec3(-0.9, 0.2, 0.46), vec3(0.9, 0.25, 0.9), material);
    for x in [-0.75, 0.7] {
        cuboid(&mut mesh, vec3(x, -0.2, -0.1), vec3(x + 0.06, 0.2, 0.4), material);
    }
    mesh
}

/// A bus shelter, open towards the road.
fn shelter(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let frame = mesh.add_material(Material::diffuse(OTHER_STRUCTURE, dice.random_range(0.15..0.5)));
    let glass = mesh.add_material(Material::diffuse(OTHER_STRUCTURE, 0.06));
    cuboid(&mut mesh, vec3(-1.9, -0.3, 2.35), vec3(1.9, 1.0, 2.45), frame);
    for x in [-1.85, -0.05, 1.75] {
        cuboid(&mut mesh, vec3(x, 0.85, -0.1), vec3(x + 0.1, 0.95, 2.35), frame);
    }
    cuboid(&mut mesh, vec3(-1.75, 0.89, 0.2), vec3(1.75, 0.91, 2.2), glass);
    cuboid(&mut mesh, vec3(-1.4, 0.5, 0.42), vec3(1.4, 0.85, 0.48), frame);
    mesh
}
