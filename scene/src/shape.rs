//! Simple solids that the street's things are built of.

use std::f32::consts::TAU;

use glam::{Quat, Vec3, vec3};

use crate::mesh::{MaterialId, Mesh};

/// A box between two corners.
pub(crate) fn cuboid(mesh: &mut Mesh, low: Vec3, high: Vec3, material: MaterialId) {
    let section = |x: f32| Section { x, low: low.z, high: high.z, y_low: [low.y, high.y], y_high: [low.y, high.y] };
    loft(mesh, &[section(low.x), section(high.x)], |_, _| Some(material));
}

/// A cross-section of a [`loft`]: a trapezium in the plane of this x.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Section {
    pub(crate) x: f32,
    /// Height of the lower and of the upper side.
    pub(crate) low: f32,
    pub(crate) high: f32,
    /// Ends of the lower side, right and left.
    pub(crate) y_low: [f32; 2],
    /// Ends of the upper side, right and left.
    pub(crate) y_high: [f32; 2],
}

impl Section {
    /// A section that is as far to the right as to the left.
    pub(crate) fn symmetric(x: f32, heights: [f32; 2], half_widths: [f32; 2]) -> Self {
        let [low, high] = half_widths;
        Self { x, low: heights[0], high: heights[1], y_low: [-low, low], y_high: [-high, high] }
    }

    /// Corners: right below, left below, left above, right above.
    fn corners(&self) -> [Vec3; 4] {
        [
            vec3(self.x, self.y_low[0], self.low),
            vec3(self.x, self.y_low[1], self.low),
            vec3(self.x, self.y_high[1], self.high),
            vec3(self.x, self.y_high[0], self.high),
        ]
    }
}

/// A face of a [`loft`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Face {
    Bottom,
    Side,
    Top,
    End,
}

/// A solid through cross-sections one behind the other, like a ship's hull through its frames.
///
/// `material` is asked for each face of the piece behind section `i`, and for the two ends (0 and the last section); `None` leaves
/// the face open.
pub(crate) fn loft(mesh: &mut Mesh, sections: &[Section], material: impl Fn(usize, Face) -> Option<MaterialId>) {
    let faces = [Face::Bottom, Face::Side, Face::Top, Face::Side];
    for (i, pair) in sections.windows(2).enumerate() {
        let (near, far) = (pair[0].corners(), pair[1].corners());
        for (k, face) in faces.into_iter().enumerate() {
            if let Some(material) = material(i, face) {
                let next = (k + 1) % 4;
                mesh.quad([near[k], near[next], far[next], far[k]], material);
            }
        }
    }
    for i in [0, sections.len() - 1] {
        if let Some(material) = material(i, Face::End) {
            mesh.quad(sections[i].corners(), material);
        }
    }
}

/// A round bar between two points, its radius changing evenly from one end to the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bar {
    pub(crate) from: Vec3,
    pub(crate) to: Vec3,
    pub(crate) radius_m: [f32; 2],
    pub(crate) sides: usize,
}

impl Bar {
    /// A bar of one radius.
    pub(crate) fn even(from: Vec3, to: Vec3, radius_m: f32, sides: usize) -> Self {
        Self { from, to, radius_m: [radius_m; 2], sides }
    }
}

/// Builds a bar with both its ends closed.
pub(crate) fn bar(mesh: &mut Mesh, bar: Bar, material: MaterialId) {
    let Some(along) = (bar.to - bar.from).try_normalize() else { return };
    let (across, up) = along.any_orthonormal_pair();
    let spoke = |k: usize| {
        let (sin, cos) = (k as f32 * TAU / bar.sides as f32).sin_cos();
        across * cos + up * sin
    };
    for k in 0..bar.sides {
        let (this, next) = (spoke(k), spoke((k + 1) % bar.sides));
        let [near, far] = bar.radius_m;
        let ring = [bar.from + this * near, bar.from + next * near, bar.to + next * far, bar.to + this * far];
        mesh.quad(ring, material);
        if near > 0.0 {
            mesh.triangle([bar.from, ring[0], ring[1]], material);
        }
        if far > 0.0 {
            mesh.triangle([bar.to, ring[2], ring[3]], material);
        }
    }
}

/// An ellipsoid with its axes along the frame's.
pub(crate) fn ellipsoid(mesh: &mut Mesh, centre: Vec3, radii: Vec3, sides: usize, material: MaterialId) {
    let bands = sides.div_ceil(2);
    let point = |band: usize, side: usize| {
        let (sin_e, cos_e) = (std::f32::consts::PI * (band as f32 / bands as f32 - 0.5)).sin_cos();
        let (sin_a, cos_a) = ((side % sides) as f32 * TAU / sides as f32).sin_cos();
        centre + radii * vec3(cos_e * cos_a, cos_e * sin_a, sin_e)
    };
    for band in 0..bands {
        for side in 0..sides {
            let corners = [point(band, side), point(band, side + 1), point(band + 1, side + 1), point(band + 1, side)];
            mesh.quad(corners, material);
        }
    }
}

/// A flat panel with `sides` corners, or a disc where there are many; `normal` is the way that it faces.
pub(crate) fn panel(mesh: &mut Mesh, centre: Vec3, normal: Vec3, radius_m: f32, sides: usize, material: MaterialId) {
    let turn = Quat::from_rotation_arc(Vec3::X, normal);
    let corner = |k: usize| {
        // Half a side's turn more for an even number: a square and an octagon stand on a side, a triangle points up.
        let shift = if sides.is_multiple_of(2) { 0.5 } else { 0.0 };
        let (sin, cos) = ((k as f32 + shift) * TAU / sides as f32).sin_cos();
        centre + turn * (vec3(0.0, sin, cos) * radius_m)
    };
    for k in 0..sides {
        mesh.triangle([centre, corner(k), corner(k + 1)], material);
    }
}
