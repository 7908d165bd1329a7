//! Bicycles and motorcycles, with and without riders.

use std::f32::consts::TAU;

use glam::{Vec3, vec3};
use rand::RngExt;

use super::Dice;
use super::person;
use crate::material::Material;
use crate::mesh::{MaterialId, Mesh};
use crate::shape::{Bar, bar, cuboid, ellipsoid};

/// A bicycle that points along x, its wheels on z = 0, and its rider if there is one.
pub(super) fn bicycle(label: u32, ridden: bool, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let frame = mesh.add_material(Material::diffuse(label, dice.random_range(0.1..0.6)));
    let tyre = mesh.add_material(Material::diffuse(label, 0.05));
    let reflector = mesh.add_material(Material::retro(label, 0.9));
    let (rear, front) = (vec3(-0.52, 0.0, 0.34), vec3(0.54, 0.0, 0.34));
    let (pedals, seat, head) = (vec3(-0.05, 0.0, 0.3), vec3(-0.25, 0.0, 0.92), vec3(0.36, 0.0, 0.9));
    for hub in [rear, front] {
        ring(&mut mesh, hub, 0.33, 0.022, tyre);
        for k in 0..6 {
            let (sin, cos) = (k as f32 * TAU / 6.0).sin_cos();
            bar(&mut mesh, Bar::even(hub, hub + vec3(cos, 0.0, sin) * 0.32, 0.004, 3), frame);
        }
    }
    let tubes = [
        (pedals, seat),
        (pedals, head - Vec3::Z * 0.2),
        (seat - Vec3::Z * 0.12, head),
        (rear, pedals),
        (rear, seat - Vec3::Z * 0.12),
        (head + Vec3::Z * 0.12, front),
    ];
    for (from, to) in tubes {
        bar(&mut mesh, Bar::even(from, to, 0.019, 5), frame);
    }
    let handle = head + vec3(0.0, 0.0, 0.12);
    bar(&mut mesh, Bar::even(handle - Vec3::Y * 0.28, handle + Vec3::Y * 0.28, 0.014, 5), tyre);
    cuboid(&mut mesh, seat - vec3(0.13, 0.07, 0.0), seat + vec3(0.13, 0.07, 0.06), tyre);
    cuboid(&mut mesh, vec3(-0.88, -0.04, 0.55), vec3(-0.86, 0.04, 0.63), reflector);
    if ridden {
        person::riding(&mut mesh, seat, handle, pedals, label, dice);
    }
    mesh
}

/// A motorcycle that points along x, its wheels on z = 0, and its rider if there is one.
pub(super) fn motorcycle(label: u32, ridden: bool, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let paint = mesh.add_material(Material::diffuse(label, dice.random_range(0.05..0.7)));
    let metal = mesh.add_material(Material::diffuse(label, dice.random_range(0.2..0.5)));
    let tyre = mesh.add_material(Material::diffuse(label, 0.05));
    let plate = mesh.add_material(Material::retro(label, 0.95));
    let (rear, front) = (vec3(-0.68, 0.0, 0.31), vec3(0.72, 0.0, 0.31));
    for hub in [rear, front] {
        let half = Vec3::Y * 0.07;
        bar(&mut mesh, Bar::even(hub - half, hub + half, 0.31, 14), tyre);
        bar(&mut mesh, Bar::even(hub - half * 1.1, hub + half * 1.1, 0.19, 10), metal);
    }
    ellipsoid(&mut mesh, vec3(0.16, 0.0, 0.86), vec3(0.3, 0.16, 0.15), 10, paint);
    ellipsoid(&mut mesh, vec3(0.02, 0.0, 0.5), vec3(0.3, 0.2, 0.24), 10, metal);
    cuboid(&mut mesh, vec3(-0.75, -0.13, 0.74), vec3(-0.05, 0.13, 0.86), tyre);
    cuboid(&mut mesh, vec3(-0.8, -0.1, 0.55), vec3(-0.5, 0.1, 0.76), paint);
    cuboid(&mut mesh, vec3(-0.9, -0.1, 0.52), vec3(-0.88, 0.1, 0.7), plate);
    let handle = vec3(0.42, 0.0, 1.06);
    for y in [-0.09, 0.09] {
        bar(&mut mesh, Bar::even(front + Vec3::Y * y, handle + Vec3::Y * y, 0.028, 6), metal);
    }
    bar(&mut mesh, Bar::even(handle - Vec3::Y * 0.35, handle + Vec3::Y * 0.35, 0.018, 5), tyre);
    ellipsoid(&mut mesh, vec3(0.58, 0.0, 0.9), vec3(0.1, 0.1, 0.11), 8, metal);
    if ridden {
        person::riding(&mut mesh, vec3(-0.22, 0.0, 0.86), handle, vec3(-0.05, 0.0, 0.4), label, dice);
    }
    mesh
}

/// A wheel's ring about y: eight-cornered in section would be too fine for any lidar, so it is square.
fn ring(mesh: &mut Mesh, hub: Vec3, radius_m: f32, half_m: f32, material: MaterialId) {
    let sides = 16;
    let point = |k: usize, out: f32, y: f32| {
        let (sin, cos) = (k as f32 * TAU / sides as f32).sin_cos();
        hub + vec3(cos, 0.0, sin) * (radius_m + out) + Vec3::Y * y
    };
    let section = [(-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m)];
    for k in 0..sides {
        for i in 0..4 {
            let ((a, b), (c, d)) = (section[i], section[(i + 1) % 4]);
            mesh.quad([point(k, a, b), point(k + 1, a, b), point(k + 1, c, d), point(k, c, d)], material);
        }
    }
}
