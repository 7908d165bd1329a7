//! The plan of a street: what lies where, before anything is built.

use rand::RngExt;

use super::Dice;
use super::config::{Span, StreetConfig, pick};
use super::marking;
use super::road::Road;
use super::surface::Surface;

/// How far the land goes on to either side of the road's middle.
pub(super) const LAND_M: f32 = 85.0;

/// Height of the pavement above the road.
pub(super) const KERB_M: f32 = 0.12;

/// Everything about a street that several of its builders need.
pub(super) struct Plan {
    pub(super) road: Road,
    pub(super) reach_m: f32,
    pub(super) lane_width_m: f32,
    /// Lanes of each direction.
    pub(super) lanes: usize,
    /// Half the width between the outermost lanes' edges.
    pub(super) half_m: f32,
    /// Left (+1) and right (−1).
    pub(super) sides: [Side; 2],
    pub(super) junctions: Vec<Junction>,
    /// Where the zebra crossings are.
    pub(super) zebras_m: Vec<f32>,
    /// Grounds that lie over the bands, later ones over earlier ones.
    pub(super) patches: Vec<Patch>,
    pub(super) config: Picked,
}

/// What this seed picked from the configuration's spans.
pub(super) struct Picked {
    pub(super) parked_share: f32,
    pub(super) vehicles_per_m: f32,
    pub(super) people_per_m: f32,
    pub(super) trees_per_m: f32,
}

/// One side of the road. Distances across are from the road's middle, whatever the side.
pub(super) struct Side {
    /// +1 on the left, −1 on the right: `left_m` = sign · distance.
    pub(super) sign: f32,
    pub(super) bands: Vec<Band>,
    pub(super) kerb_m: f32,
    pub(super) parking_m: Option<Span>,
    pub(super) verge_m: Option<Span>,
    pub(super) pavement_m: Span,
    pub(super) lots: Vec<Lot>,
}

/// A strip along the road.
#[derive(Clone, Copy)]
pub(super) struct Band {
    pub(super) to_m: f32,
    pub(super) surface: Surface,
}

/// A side street that meets the road.
#[derive(Clone, Copy)]
pub(super) struct Junction {
    pub(super) along_m: f32,
    pub(super) half_m: f32,
    /// Whether it goes off to the left and to the right.
    pub(super) goes: [bool; 2],
}

/// A rectangle of another ground.
#[derive(Clone, Copy)]
pub(super) struct Patch {
    pub(super) along_m: Span,
    pub(super) left_m: Span,
    pub(super) surface: Surface,
}

/// A piece of land beside the street.
#[derive(Clone, Copy)]
pub(super) struct Lot {
    pub(super) along_m: Span,
    pub(super) front_m: f32,
    pub(super) kind: LotKind,
    /// Where a driveway crosses the pavement.
    pub(super) driveway_m: Option<Span>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum LotKind {
    /// One of a row of houses, wall to wall.
    Terrace,
    /// A house in its garden.
    Detached,
    /// A block of flats or of shops.
    Block,
    /// Grass and trees.
    Open,
}

impl Plan {
    pub(super) fn new(config: &StreetConfig, dice: &mut Dice) -> Self {
        let lane_width_m = pick(config.lane_width_m, dice);
        let lanes = if dice.random_bool(0.25) { 2 } else { 1 };
        let half_m = lanes as f32 * lane_width_m + 0.3;
        let lane = dice.random_range(0..lanes);
        let mut sides = [1.0, -1.0].map(|sign| Side::new(sign, half_m, dice));
        let even_m = sides[0].pavement_m[1].max(sides[1].pavement_m[1]);
        let road = Road::new(config, [half_m, even_m], -lane_width_m * (lane as f32 + 0.5), dice);
        let junctions = junctions(config, dice);
        let zebras_m = zebras(config.reach_m, &junctions, dice);
        let built_share = pick(config.built_share, dice);
        for (i, side) in sides.iter_mut().enumerate() {
            side.lots = lots(config.reach_m, side.pavement_m[1], &junctions, i, built_share, dice);
        }
        let picked = Picked {
            parked_share: pick(config.parked_share, dice),
            vehicles_per_m: pick(config.vehicles_per_100_m, dice) / 100.0,
            people_per_m: pick(config.people_per_100_m, dice) / 100.0,
            trees_per_m: pick(config.trees_per_100_m, dice) / 100.0,
        };
        let mut plan = Self {
            road,
            reach_m: config.reach_m,
            lane_width_m,
            lanes,
            half_m,
            sides,
            junctions,
            zebras_m,
            patches: Vec::new(),
            config: picked,
        };
        plan.patches = marking::patches(&plan, dice);
        plan
    }

    /// Distance from the nearest side street's edge on this side (0 is left); negative inside it.
    pub(super) fn to_junction_m(&self, side: usize, along_m: f32) -> f32 {
        let goes = self.junctions.iter().filter(|j| j.goes[side]);
        goes.map(|j| (along_m - j.along_m).abs() - j.half_m).fold(f32::INFINITY, f32::min)
    }

    /// Distance from the middle of the nearest zebra crossing.
    pub(super) fn to_zebra_m(&self, along_m: f32) -> f32 {
        self.zebras_m.iter().map(|z| (along_m - z).abs()).fold(f32::INFINITY, f32::min)
    }

    /// How far the pavement is raised above the road: 1 in general, 0 where it is lowered for wheels to cross.
    pub(super) fn raised(&self, side: usize, along_m: f32) -> f32 {
        let ramp = |distance_m: f32, ramp_m: f32| (distance_m / ramp_m).clamp(0.0, 1.0);
        let at_junction = ramp(self.to_junction_m(side, along_m), JUNCTION_RAMP_M);
        let at_zebra = ramp(self.to_zebra_m(along_m) - ZEBRA_HALF_M, RAMP_M).max(0.1);
        let driveways = self.sides[side].lots.iter().filter_map(|lot| lot.driveway_m);
        let at_driveway =
            driveways.map(|d| ramp((d[0] - along_m).max(along_m - d[1]), RAMP_M)).fold(1.0, f32::min).max(0.25);
        at_junction.min(at_zebra).min(at_driveway)
    }

    /// Height of the ground above the road's profile.
    pub(super) fn step_m(&self, along_m: f32, left_m: f32) -> f32 {
        let side = usize::from(left_m < 0.0);
        if left_m.abs() < self.sides[side].kerb_m { 0.0 } else { KERB_M * self.raised(side, along_m) }
    }
}

/// Length over which a kerb goes down.
pub(super) const RAMP_M: f32 = 0.8;
/// Width of the kerb that follows a side street's edge.
pub(super) const JUNCTION_RAMP_M: f32 = 0.15;
/// Half a zebra crossing's width.
pub(super) const ZEBRA_HALF_M: f32 = 1.75;

impl Side {
    fn new(sign: f32, half_m: f32, dice: &mut Dice) -> Self {
        let mut bands = vec![Band { to_m: half_m, surface: Surface::Road }];
        let mut edge_m = half_m;
        let mut band = |width_m: f32, surface: Surface| {
            let from_m = edge_m;
            edge_m += width_m;
            bands.push(Band { to_m: edge_m, surface });
            [from_m, edge_m]
        };
        let parking_m = dice.random_bool(0.6).then(|| band(2.1, Surface::Parking));
        let kerb_m = band(0.13, Surface::Kerb)[0];
        let verge_m = dice.random_bool(0.4).then(|| band(dice.random_range(1.0..2.2), Surface::Terrain));
        if dice.random_bool(0.3) {
            band(dice.random_range(0.8..1.8), Surface::OtherGround);
        }
        let pavement_m = band(dice.random_range(1.6..3.6), Surface::Pavement);
        band(LAND_M - pavement_m[1], Surface::Terrain);
        Self { sign, bands, kerb_m, parking_m, verge_m, pavement_m, lots: Vec::new() }
    }
}

fn junctions(config: &StreetConfig, dice: &mut Dice) -> Vec<Junction> {
    let per_m = pick(config.side_streets_per_100_m, dice) / 100.0;
    let mut junctions = Vec::new();
    if per_m <= 0.0 {
        return junctions;
    }
    let mut along_m = -config.reach_m + dice.random_range(0.3..1.2) / per_m;
    while along_m < config.reach_m - 10.0 {
        let goes = [[true, false], [false, true], [true, true]][dice.random_range(0..3)];
        junctions.push(Junction { along_m, half_m: dice.random_range(2.6..4.0), goes });
        along_m += (dice.random_range(0.6..1.4) / per_m).max(30.0);
    }
    junctions
}

fn zebras(reach_m: f32, junctions: &[Junction], dice: &mut Dice) -> Vec<f32> {
    let mut zebras: Vec<f32> =
        junctions.iter().filter(|_| dice.random_bool(0.4)).map(|j| j.along_m + j.half_m + 4.5).collect();
    if dice.random_bool(0.5) {
        let along_m = dice.random_range(-0.5 * reach_m..0.5 * reach_m);
        let near = |at: f32| (along_m - at).abs() < 16.0;
        if !junctions.iter().any(|j| near(j.along_m)) && !zebras.iter().any(|z| near(*z)) {
            zebras.push(along_m);
        }
    }
    zebras.retain(|z| z.abs() < reach_m - 5.0);
    zebras
}

/// Cuts one side into lots between the side streets.
fn lots(reach_m: f32, front_m: f32, junctions: &[Junction], side: usize, built: f32, dice: &mut Dice) -> Vec<Lot> {
    let mut lots = Vec::new();
    let mut from_m = -reach_m;
    let ends =
        junctions.iter().filter(|j| j.goes[side]).map(|j| (j.along_m - j.half_m - 2.6, j.along_m + j.half_m + 2.6));
    for (to_m, next_m) in ends.chain([(reach_m, reach_m)]) {
        let district = match dice.random_range(0..10) {
            0..4 => LotKind::Terrace,
            4..6 => LotKind::Detached,
            6..8 => LotKind::Block,
            _ => LotKind::Open,
        };
        let setback_m = match district {
            LotKind::Terrace => [0.05, 0.05, 2.5, 4.0][dice.random_range(0..4)],
            LotKind::Block => dice.random_range(0.05..5.0),
            LotKind::Detached | LotKind::Open => dice.random_range(3.5..8.0),
        };
        while from_m < to_m - 5.0 {
            let width_m: f32 = match district {
                LotKind::Terrace => dice.random_range(5.0..8.5),
                LotKind::Detached => dice.random_range(13.0..22.0),
                LotKind::Block => dice.random_range(18.0..40.0),
                LotKind::Open => dice.random_range(10.0..30.0),
            };
            let end_m = if to_m - from_m - width_m < 5.0 { to_m } else { from_m + width_m };
            let width_m = end_m - from_m;
            let kind = if dice.random::<f32>() < built { district } else { LotKind::Open };
            let driveway_m = (kind == LotKind::Detached && width_m > 11.0 && dice.random_bool(0.7)).then(|| {
                let at = if dice.random() { from_m + 0.6 } else { end_m - 3.6 };
                [at, at + 3.0]
            });
            let jitter = if district == LotKind::Terrace { 0.0 } else { dice.random_range(0.0..1.5) };
            lots.push(Lot { along_m: [from_m, end_m], front_m: front_m + setback_m + jitter, kind, driveway_m });
            from_m = end_m;
        }
        from_m = next_m;
    }
    lots
}
