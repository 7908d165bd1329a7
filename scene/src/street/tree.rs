//! Trees, bushes and hedges: leaves are single triangles, so that a part of the rays passes between them.

use std::f32::consts::TAU;

use glam::{Quat, Vec3, vec3};
use lidar::label::CLASS_IDS;
use rand::RngExt;

use super::Dice;
use crate::material::Material;
use crate::mesh::{MaterialId, Mesh};
use crate::shape::{Bar, bar, cuboid};

/// A tree at the origin. `detail` is the share of its leaves that are built; the fewer, the larger each.
pub(super) fn tree(detail: f32, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let bark = mesh.add_material(Material::diffuse(CLASS_IDS[16], dice.random_range(0.2..0.45)));
    let leaves = Leaves::new(&mut mesh, detail, dice);
    let height = dice.random_range(5.0..13.0f32);
    let radius = 0.012 * height + dice.random_range(0.04..0.12);
    if dice.random_bool(0.18) {
        conifer(&mut mesh, &leaves, bark, height, dice);
        return mesh;
    }
    let fork = vec3(dice.random_range(-0.2..0.2), dice.random_range(-0.2..0.2), dice.random_range(0.28..0.4) * height);
    bar(
        &mut mesh,
        Bar { from: vec3(0.0, 0.0, -0.4), to: fork, radius_m: [1.2 * radius, 0.8 * radius], sides: 9 },
        bark,
    );
    let crown = dice.random_range(0.22..0.34f32) * height;
    let branches = dice.random_range(4..8usize);
    for k in 0..branches {
        let azimuth = (k as f32 + dice.random_range(0.0..0.7)) * TAU / branches as f32;
        let out = dice.random_range(0.25..0.75) * crown;
        let rise = dice.random_range(0.22..0.52) * height;
        let tip = fork + vec3(out * azimuth.cos(), out * azimuth.sin(), rise);
        bar(&mut mesh, Bar { from: fork, to: tip, radius_m: [0.5 * radius, 0.12 * radius], sides: 5 }, bark);
        let blob = vec3(1.0, 1.0, 0.8) * crown * dice.random_range(0.5..0.75);
        leaves.fill(&mut mesh, tip, blob, 340, dice);
    }
    mesh
}

fn conifer(mesh: &mut Mesh, leaves: &Leaves, bark: MaterialId, height: f32, dice: &mut Dice) {
    bar(mesh, Bar { from: vec3(0.0, 0.0, -0.4), to: Vec3::Z * height, radius_m: [0.16, 0.03], sides: 8 }, bark);
    let widest = dice.random_range(0.14..0.24) * height;
    let tiers = 9;
    for k in 0..tiers {
        let share = (k as f32 + 0.5) / tiers as f32;
        let at = Vec3::Z * height * (0.14 + 0.84 * share);
        let out = widest * (1.05 - share);
        leaves.fill(mesh, at, vec3(out, out, 0.07 * height), (260.0 * (1.05 - share)) as usize, dice);
    }
}

/// A bush at the origin.
pub(super) fn bush(detail: f32, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let leaves = Leaves::new(&mut mesh, detail, dice);
    for _ in 0..dice.random_range(1..4) {
        let size = dice.random_range(0.35..0.95f32);
        let at = vec3(dice.random_range(-0.6..0.6), dice.random_range(-0.6..0.6), 0.7 * size);
        leaves.fill(&mut mesh, at, Vec3::splat(size), 260, dice);
    }
    mesh
}

/// A clipped hedge from x = 0 to `length_m`: a dense core inside a skin of leaves.
pub(super) fn hedge(length_m: f32, height_m: f32, detail: f32, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let leaves = Leaves::new(&mut mesh, detail, dice);
    let half = 0.3;
    let core = leaves.shades[0];
    cuboid(&mut mesh, vec3(0.1, -half + 0.12, -0.3), vec3(length_m - 0.1, half - 0.12, height_m - 0.12), core);
    let count = (detail * length_m * (height_m + half) * 55.0) as usize;
    for _ in 0..count {
        let x = dice.random_range(0.0..length_m);
        // On one of the two sides or on top.
        let at = match dice.random_range(0.0..2.0 * height_m + 2.0 * half) {
            z if z < height_m => vec3(x, -half, z),
            z if z < 2.0 * height_m => vec3(x, half, z - height_m),
            y => vec3(x, y - 2.0 * height_m - half, height_m),
        };
        leaves.leaf(&mut mesh, at, dice);
    }
    mesh
}

/// How one plant's leaves look.
struct Leaves {
    shades: [MaterialId; 4],
    size_m: f32,
    detail: f32,
}

impl Leaves {
    fn new(mesh: &mut Mesh, detail: f32, dice: &mut Dice) -> Self {
        // Leaves are bright in the near infrared: 0.4 to 0.6.
        let mean: f32 = dice.random_range(0.35..0.58);
        let shades = std::array::from_fn(|_| {
            mesh.add_material(Material::diffuse(CLASS_IDS[15], mean * dice.random_range(0.8..1.2)))
        });
        // The leaves' area, not their number, decides how many rays pass.
        Self { shades, size_m: dice.random_range(0.16..0.26) / detail.sqrt(), detail }
    }

    /// Fills an ellipsoid, more densely towards its skin, where the light is.
    fn fill(&self, mesh: &mut Mesh, centre: Vec3, radii: Vec3, count: usize, dice: &mut Dice) {
        for _ in 0..(count as f32 * self.detail) as usize {
            let out = dice.random::<f32>().powf(0.22);
            self.leaf(mesh, centre + radii * direction(dice) * out, dice);
        }
    }

    fn leaf(&self, mesh: &mut Mesh, at: Vec3, dice: &mut Dice) {
        let turn = Quat::from_rotation_arc(Vec3::Z, direction(dice));
        let size = self.size_m * dice.random_range(0.6..1.4);
        let spin: f32 = dice.random_range(0.0..TAU);
        let corner = |k: f32| {
            let (sin, cos) = (spin + k * TAU / 3.0).sin_cos();
            at + turn * (vec3(cos, sin, 0.0) * size)
        };
        let shade = self.shades[dice.random_range(0..self.shades.len())];
        mesh.triangle([corner(0.0), corner(1.0), corner(2.0)], shade);
    }
}

/// A direction, all alike likely.
fn direction(dice: &mut Dice) -> Vec3 {
    let z: f32 = dice.random_range(-1.0..1.0);
    let azimuth: f32 = dice.random_range(0.0..TAU);
    let flat = (1.0 - z * z).sqrt();
    vec3(flat * azimuth.cos(), flat * azimuth.sin(), z)
}
