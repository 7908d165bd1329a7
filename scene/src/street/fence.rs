//! Fences and garden walls.

use glam::vec3;
use lidar::label::CLASS_IDS;
use rand::RngExt;

use super::Dice;
use crate::material::Material;
use crate::mesh::Mesh;
use crate::shape::{Bar, bar, cuboid};

/// A fence from x = 0 to `length_m`: of pickets, of metal bars, or a wall.
pub(super) fn fence(length_m: f32, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let label = CLASS_IDS[14];
    let material = mesh.add_material(Material::diffuse(label, dice.random_range(0.2..0.65)));
    let height: f32 = dice.random_range(0.8..1.7);
    match dice.random_range(0..3) {
        0 => cuboid(&mut mesh, vec3(0.0, -0.12, -0.6), vec3(length_m, 0.12, height), material),
        1 => {
            for z in [0.25 * height, 0.8 * height] {
                cuboid(&mut mesh, vec3(0.0, -0.03, z), vec3(length_m, 0.0, z + 0.08), material);
            }
            let pitch = dice.random_range(0.12..0.2f32);
            for k in 0..(length_m / pitch) as usize {
                let x = k as f32 * pitch;
                cuboid(&mut mesh, vec3(x, 0.0, -0.1), vec3(x + 0.09, 0.02, height), material);
            }
        }
        _ => {
            for z in [0.12, height - 0.05] {
                cuboid(&mut mesh, vec3(0.0, -0.02, z), vec3(length_m, 0.02, z + 0.04), material);
            }
            for k in 0..=(length_m / 0.14) as usize {
                let x = (k as f32 * 0.14).min(length_m);
                bar(&mut mesh, Bar::even(vec3(x, 0.0, -0.1), vec3(x, 0.0, height), 0.012, 4), material);
            }
            for k in 0..=(length_m / 2.4) as usize {
                let x = k as f32 * 2.4;
                cuboid(&mut mesh, vec3(x - 0.04, -0.04, -0.2), vec3(x + 0.04, 0.04, height + 0.08), material);
            }
        }
    }
    mesh
}
