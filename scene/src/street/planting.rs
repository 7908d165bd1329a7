//! Trees along the street, in gardens and behind the houses.

use std::f32::consts::TAU;

use glam::Affine3A;
use rand::RngExt;

use super::plan::{LotKind, Plan};
use super::populate::detail_at;
use super::tree::{bush, tree};
use super::{Dice, Site};

/// Trees do not stand nearer to the sensor's crossing of the street than this: crowns hang over the road.
const CLEAR_M: f32 = 9.0;

/// Plants every tree.
pub(super) fn trees(site: &mut Site, plan: &Plan, dice: &mut Dice) {
    for (i, side) in plan.sides.iter().enumerate() {
        let plant = |site: &mut Site, along: f32, away: f32, detail: f32, dice: &mut Dice| {
            if along.abs() > CLEAR_M && along.abs() < plan.reach_m - 1.0 && plan.to_junction_m(i, along) > 3.0 {
                let turn = Affine3A::from_rotation_z(dice.random_range(0.0..TAU));
                site.put(&tree(detail, dice), &(plan.side_frame(side, along, away) * turn));
            }
        };
        let row_m = side.verge_m.map_or(side.kerb_m + 0.9, |verge| 0.5 * (verge[0] + verge[1]));
        // A row in the verge, or in the pavement where that is wide.
        let wide = side.pavement_m[1] - side.pavement_m[0] > 2.6;
        if plan.config.trees_per_m > 0.0 && (side.verge_m.is_some() || wide) {
            let pitch = 1.0 / plan.config.trees_per_m;
            let mut along = -plan.reach_m + dice.random_range(0.0..pitch);
            while along < plan.reach_m {
                let at = along + dice.random_range(-0.1..0.1) * pitch;
                if plan.to_zebra_m(at) > 4.0 {
                    plant(site, at, row_m, detail_at(at), dice);
                }
                along += pitch;
            }
        }
        for lot in &side.lots {
            let width = lot.along_m[1] - lot.along_m[0];
            let behind = lot.front_m + 14.0;
            // Gardens and open land have more of them, built with fewer and larger leaves: they are far away.
            let share = if lot.kind == LotKind::Open { 3.0 } else { 1.2 };
            let expected = share * width * plan.config.trees_per_m;
            let count = expected as usize + usize::from(dice.random::<f32>() < expected.fract());
            for _ in 0..count {
                let along = lot.along_m[0] + width * dice.random::<f32>();
                let front = if lot.kind == LotKind::Open { lot.front_m + 1.0 } else { behind };
                let away = dice.random_range(front..front + 28.0f32);
                plant(site, along, away, 0.5 * detail_at(along), dice);
                if lot.kind == LotKind::Open {
                    let frame = plan.side_frame(side, along, dice.random_range(lot.front_m + 0.5..lot.front_m + 12.0));
                    site.put(&bush(0.5 * detail_at(along), dice), &frame);
                }
            }
        }
    }
}
