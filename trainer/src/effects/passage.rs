//! What a ray that does not begin where the simulation's do may meet on its way: an image shows the world from one place only.

use burn::tensor::{Tensor, TensorData};

use super::rays::{Bend, Rays};
use super::surface::{Surface, dot};

/// Part of the way to the next column by which the nearest things have to seem displaced to be worth a look.
const HARDLY_DISPLACED: f32 = 0.05;

/// How much nearer than a surface's plane something has to be to stand before it, relatively.
const BEFORE: f32 = 0.05;

/// The way of moved rays through what the simulation's rays have seen.
#[derive(Clone, Debug)]
pub struct Passage {
    /// Where the rays begin: ahead, left, up, in m.
    pub origin_m: [Tensor<3>; 3],
    /// What the simulation's rays have seen, in m.
    pub seen_m: Tensor<3>,
}

impl Passage {
    /// 1 where nothing that the simulation shows before a ray's surface is near enough for the ray to meet it, or for the surface's view
    /// to have been blocked by it; else 0.
    ///
    /// Something at range ρ seems displaced by up to |o|/ρ to a ray whose origin is moved by o.
    pub fn clear(&self, surface: &Surface, rays: &Rays) -> Tensor<3> {
        let size = surface.range_m.dims();
        let [batch, rings, columns] = size;
        let view = View::new(self, surface, rays);
        let mut clear = vec![1.0; batch * rings * columns];
        for i in 0..clear.len() {
            let (frame, ring, column) = (i / (rings * columns), i / columns % rings, i % columns);
            let Some(reach_rad) = view.reach_rad(i) else { continue };
            let aside = view.columns_within(reach_rad, ring);
            for k in view.rings_within(reach_rad, ring) {
                for c in columns + column - aside..=columns + column + aside {
                    let j = (frame * rings + k) * columns + c % columns;
                    if view.stands_before(i, j) {
                        clear[j] = 0.0;
                    }
                }
            }
        }
        Tensor::from_data(TensorData::new(clear, size), &surface.range_m.device())
    }
}

/// Everything about every ray as plain numbers: what the simulation's rays have seen, and what the moved ones are taken to hit.
struct View {
    seen_m: Vec<f32>,
    point_m: [Vec<f32>; 3],
    plane: [Vec<f32>; 3],
    away_m: Vec<f32>,
    farthest_m: f32,
    elevation_rad: Vec<f32>,
    column_rad: f32,
}

impl View {
    fn new(passage: &Passage, surface: &Surface, rays: &Rays) -> Self {
        let size = surface.range_m.dims();
        let of = |x: Tensor<3>| -> Vec<f32> { TensorData::iter::<f32>(&x.into_data()).collect() };
        let list = |x: &Tensor<3>| of(x.clone().expand(size).detach());
        let away_m = list(&dot(&passage.origin_m, &passage.origin_m).sqrt());
        Self {
            point_m: rays.directions(&Bend::default()).map(|u| list(&(u * passage.seen_m.clone()))),
            seen_m: list(&passage.seen_m),
            plane: surface.plane.each_ref().map(list),
            farthest_m: away_m.iter().copied().fold(0.0, f32::max),
            away_m,
            elevation_rad: of(rays.elevation_rad.clone()),
            column_rad: 2.0 * std::f32::consts::PI / size[2] as f32,
        }
    }

    /// How far from its own direction moved rays may meet what a ray has seen; `None` if that is nothing, or hardly displaced.
    fn reach_rad(&self, i: usize) -> Option<f32> {
        let displaced = self.farthest_m / self.seen_m[i];
        // A pixel more: what is seen at its middle reaches to the next.
        (self.seen_m[i] > 0.0 && displaced > HARDLY_DISPLACED * self.column_rad).then_some(displaced + self.column_rad)
    }

    fn columns_within(&self, reach_rad: f32, ring: usize) -> usize {
        let columns = reach_rad / self.column_rad / self.elevation_rad[ring].cos().max(0.05);
        (columns as usize).min((std::f32::consts::PI / self.column_rad) as usize)
    }

    fn rings_within(&self, reach_rad: f32, ring: usize) -> impl Iterator<Item = usize> {
        let is_near = move |k: &usize| {
            k.abs_diff(ring) <= 1 || (self.elevation_rad[*k] - self.elevation_rad[ring]).abs() <= reach_rad
        };
        let below = (ring..self.elevation_rad.len()).take_while(is_near);
        (0..ring).rev().take_while(is_near).chain(below)
    }

    /// Whether what one ray has seen stands before the surface of another, whose origin is far enough away to see it elsewhere.
    fn stands_before(&self, i: usize, j: usize) -> bool {
        let displaced = self.away_m[j] > HARDLY_DISPLACED * self.column_rad * self.seen_m[i];
        displaced && (0..3).map(|axis| self.plane[axis][j] * self.point_m[axis][i]).sum::<f32>() < 1.0 - BEFORE
    }
}
