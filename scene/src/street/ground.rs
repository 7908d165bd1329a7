//! The ground: one sheet of triangles, cut along the edge of every surface and line.

use super::config::Span;
use super::plan::{JUNCTION_RAMP_M, KERB_M, LAND_M, Plan, RAMP_M, ZEBRA_HALF_M};
use super::surface::{Palette, Surface};
use super::{Dice, Site};

/// Longest cell along the road.
const CELL_M: f32 = 2.0;

/// Cuts nearer to each other than this are one.
const SAME_CUT_M: f32 = 0.004;

/// A line along the road: where it is, and whether it is on the raised side of the kerb.
#[derive(Clone, Copy)]
struct Rail {
    left_m: f32,
    raised: bool,
}

/// Builds the ground. All cells of one row share their corners with the next row's, so no ray falls through.
pub(super) fn build(site: &mut Site, plan: &Plan, dice: &mut Dice) {
    let palette = Palette::new(&mut site.mesh, dice);
    let rails = rails(plan);
    let rows = rows(plan);
    let corners: Vec<Vec<glam::Vec3>> = rows
        .iter()
        .map(|along| {
            let raised = [plan.raised(0, *along), plan.raised(1, *along)];
            rails
                .iter()
                .map(|rail| {
                    let step = if rail.raised { KERB_M * raised[usize::from(rail.left_m < 0.0)] } else { 0.0 };
                    plan.road.at(*along, rail.left_m, step)
                })
                .collect()
        })
        .collect();
    for (i, pair) in rows.windows(2).enumerate() {
        let along = 0.5 * (pair[0] + pair[1]);
        let patches: Vec<_> = plan.patches.iter().filter(|p| inside(p.along_m, along)).collect();
        for (j, rail) in rails.windows(2).enumerate() {
            let left = 0.5 * (rail[0].left_m + rail[1].left_m);
            let kerb_face = rail[0].left_m == rail[1].left_m;
            let over = patches.iter().rev().find(|p| inside(p.left_m, left));
            let surface = if kerb_face { Surface::Kerb } else { over.map_or_else(|| band(plan, left), |p| p.surface) };
            let [a, b, c, d] = [corners[i][j], corners[i + 1][j], corners[i + 1][j + 1], corners[i][j + 1]];
            let material = palette.at(surface, along, left);
            for triangle in [[a, b, c], [a, c, d]] {
                // A lowered kerb's face has no height.
                if (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).length() > 1e-7 {
                    site.mesh.triangle(triangle, material);
                }
            }
        }
    }
}

fn inside(span: Span, value: f32) -> bool {
    value > span[0] && value < span[1]
}

/// The strip's own surface.
fn band(plan: &Plan, left_m: f32) -> Surface {
    let side = &plan.sides[usize::from(left_m < 0.0)];
    side.bands.iter().find(|b| left_m.abs() < b.to_m).map_or(Surface::Terrain, |b| b.surface)
}

fn rails(plan: &Plan) -> Vec<Rail> {
    let mut cuts = vec![0.0];
    for side in &plan.sides {
        cuts.extend(side.bands.iter().map(|b| side.sign * b.to_m));
        let mut at = side.pavement_m[1];
        while at < LAND_M {
            at += (0.12 * at).clamp(1.0, 5.0);
            cuts.push(side.sign * at.min(LAND_M));
        }
        cuts.extend([0.35, 0.7].map(|part| side.sign * part * plan.half_m));
    }
    cuts.extend(plan.patches.iter().flat_map(|p| p.left_m));
    let kerbs = [plan.sides[0].kerb_m, -plan.sides[1].kerb_m];
    let mut rails = Vec::new();
    for left_m in sorted(cuts, LAND_M, &kerbs) {
        let raised = left_m > kerbs[0] || left_m < kerbs[1];
        if left_m == kerbs[1] {
            rails.push(Rail { left_m, raised: true });
        }
        rails.push(Rail { left_m, raised });
        if left_m == kerbs[0] {
            rails.push(Rail { left_m, raised: true });
        }
    }
    rails
}

fn rows(plan: &Plan) -> Vec<f32> {
    let mut cuts = vec![-plan.reach_m, plan.reach_m];
    cuts.extend(plan.patches.iter().flat_map(|p| p.along_m));
    let mut ramp = |span: Span, ramp_m: f32| cuts.extend([span[0] - ramp_m, span[0], span[1], span[1] + ramp_m]);
    for junction in &plan.junctions {
        ramp([junction.along_m - junction.half_m, junction.along_m + junction.half_m], JUNCTION_RAMP_M);
    }
    for along in &plan.zebras_m {
        ramp([along - ZEBRA_HALF_M, along + ZEBRA_HALF_M], RAMP_M);
    }
    for driveway in plan.sides.iter().flat_map(|s| &s.lots).filter_map(|lot| lot.driveway_m) {
        ramp(driveway, RAMP_M);
    }
    let cuts = sorted(cuts, plan.reach_m, &[]);
    let mut rows = Vec::new();
    for pair in cuts.windows(2) {
        let cells = ((pair[1] - pair[0]) / CELL_M).ceil() as usize;
        rows.extend((0..cells).map(|k| pair[0] + (pair[1] - pair[0]) * k as f32 / cells as f32));
    }
    rows.extend(cuts.last());
    rows
}

/// The cuts in order, without those beyond `limit` or next to another; one of `kept` stays where it is.
fn sorted(mut cuts: Vec<f32>, limit: f32, kept: &[f32]) -> Vec<f32> {
    cuts.retain(|c| c.abs() <= limit && !kept.iter().any(|k| k != c && (k - c).abs() < SAME_CUT_M));
    cuts.sort_by(f32::total_cmp);
    cuts.dedup_by(|b, a| *b - *a < SAME_CUT_M);
    cuts
}
