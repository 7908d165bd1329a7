//! What a ray that does not begin where the simulation's do may meet on its way: an image shows the world from one place only.

use burn::tensor::{Tensor, TensorData};

use super::rays::{Bend, Rays};
use super::surface::Surface;

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
        let list = |x: &Tensor<3>| -> Vec<f32> {
            TensorData::iter::<f32>(&x.clone().expand(size).detach().into_data()).collect()
        };
        let seen_m = list(&self.seen_m);
        let directions = rays.directions(&Bend::default()).map(|u| list(&u));
        let plane = surface.plane.each_ref().map(list);
        let [x, y, z] = self.origin_m.each_ref().map(list);
        let away_m: Vec<f32> = (0..x.len()).map(|i| (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt()).collect();
        let farthest_m = away_m.iter().copied().fold(0.0, f32::max);
        let elevation: Vec<f32> = TensorData::iter::<f32>(&rays.elevation_rad.clone().into_data()).collect();
        let column_rad = 2.0 * std::f32::consts::PI / columns as f32;

        let mut clear = vec![1.0; seen_m.len()];
        for frame in 0..batch {
            let from = frame * rings * columns;
            for (ring, column) in (0..rings).flat_map(|k| (0..columns).map(move |c| (k, c))) {
                let i = from + ring * columns + column;
                let displaced = farthest_m / seen_m[i].max(1e-3);
                if seen_m[i] <= 0.0 || displaced < HARDLY_DISPLACED * column_rad {
                    continue;
                }
                // A pixel more: what is seen at its middle reaches to the next.
                let reach = displaced + column_rad;
                let aside = ((reach / column_rad / elevation[ring].cos().max(0.05)) as usize).min(columns / 2);
                let near = |k: &usize| k.abs_diff(ring) <= 1 || (elevation[*k] - elevation[ring]).abs() <= reach;
                let point = directions.each_ref().map(|u| u[i] * seen_m[i]);
                for k in (0..ring).rev().take_while(near).chain((ring..rings).take_while(near)) {
                    for c in (columns + column - aside)..=(columns + column + aside) {
                        let j = from + k * columns + c % columns;
                        let reached = away_m[j] >= HARDLY_DISPLACED * column_rad * seen_m[i];
                        let at_plane: f32 = (0..3).map(|axis| plane[axis][j] * point[axis]).sum();
                        if reached && at_plane < 1.0 - BEFORE {
                            clear[j] = 0.0;
                        }
                    }
                }
            }
        }
        Tensor::from_data(TensorData::new(clear, size), &surface.range_m.device())
    }
}
