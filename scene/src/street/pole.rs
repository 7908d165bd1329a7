//! Poles and what hangs on them: lamps, traffic signs, traffic lights.

use glam::{Vec3, vec3};
use lidar::label::CLASS_IDS;
use rand::RngExt;

use super::Dice;
use crate::material::Material;
use crate::mesh::{MaterialId, Mesh};
use crate::shape::{Bar, bar, cuboid, panel};

/// A lamp post at the origin, its arm towards −y, over the road.
pub(super) fn lamp_post(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let metal = pole_material(&mut mesh, dice);
    let (height, arm) = (dice.random_range(4.5..9.0f32), dice.random_range(0.0..2.0f32));
    let top = vec3(0.0, 0.0, height);
    bar(&mut mesh, Bar { from: vec3(0.0, 0.0, -0.3), to: vec3(0.0, 0.0, 0.9), radius_m: [0.1, 0.1], sides: 10 }, metal);
    bar(&mut mesh, Bar { from: vec3(0.0, 0.0, 0.9), to: top, radius_m: [0.075, 0.045], sides: 10 }, metal);
    if arm > 0.5 {
        let end = top + vec3(0.0, -arm, 0.25);
        bar(&mut mesh, Bar::even(top, end, 0.035, 6), metal);
        cuboid(&mut mesh, end - vec3(0.12, 0.35, 0.06), end + vec3(0.12, 0.2, 0.06), metal);
    } else {
        bar(&mut mesh, Bar { from: top, to: top + Vec3::Z * 0.4, radius_m: [0.12, 0.25], sides: 10 }, metal);
    }
    mesh
}

/// A bare pole: a bollard, a flag pole or a mast with wires.
pub(super) fn plain(height_m: f32, radius_m: f32, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let material = pole_material(&mut mesh, dice);
    bar(&mut mesh, Bar::even(vec3(0.0, 0.0, -0.3), vec3(0.0, 0.0, height_m), radius_m, 10), material);
    mesh
}

/// One or two traffic signs on a pole; they face −x, towards who comes along x.
pub(super) fn traffic_sign(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let pole = pole_material(&mut mesh, dice);
    let high: f32 = dice.random_range(2.5..3.4);
    bar(&mut mesh, Bar::even(vec3(0.0, 0.0, -0.3), vec3(0.0, 0.0, high), 0.038, 8), pole);
    let count = if dice.random_bool(0.3) { 2 } else { 1 };
    for k in 0..count {
        let sides = [3, 4, 8, 24, 24][dice.random_range(0..5)];
        sign(&mut mesh, vec3(-0.045, 0.0, high - 0.35 - 0.75 * k as f32), sides, dice.random_range(0.3..0.42), dice);
    }
    mesh
}

/// A sign's plate: sheeting that sends light straight back on the front, bare metal behind.
fn sign(mesh: &mut Mesh, centre: Vec3, sides: usize, radius_m: f32, dice: &mut Dice) {
    let label = CLASS_IDS[19];
    let front = mesh.add_material(Material::retro(label, dice.random_range(0.9..1.0)));
    let back = mesh.add_material(Material::diffuse(label, dice.random_range(0.3..0.6)));
    panel(mesh, centre - vec3(0.006, 0.0, 0.0), Vec3::NEG_X, radius_m, sides, front);
    panel(mesh, centre, Vec3::NEG_X, radius_m, sides, back);
}

/// A large direction board on two posts, facing −x.
pub(super) fn board(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let pole = pole_material(&mut mesh, dice);
    let label = CLASS_IDS[19];
    let front = mesh.add_material(Material::retro(label, dice.random_range(0.9..1.0)));
    let back = mesh.add_material(Material::diffuse(label, dice.random_range(0.3..0.6)));
    let (half, high) = (dice.random_range(0.5..0.9f32), dice.random_range(2.9..3.4f32));
    for y in [-0.7 * half, 0.7 * half] {
        bar(&mut mesh, Bar::even(vec3(0.0, y, -0.3), vec3(0.0, y, high), 0.05, 8), pole);
    }
    let rectangle = |x: f32| [vec3(x, -half, 2.2), vec3(x, half, 2.2), vec3(x, half, high), vec3(x, -half, high)];
    mesh.quad(rectangle(-0.07), front);
    mesh.quad(rectangle(-0.055), back);
    mesh
}

/// Traffic lights on a pole, facing −x.
pub(super) fn traffic_light(dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let pole = pole_material(&mut mesh, dice);
    let housing = mesh.add_material(Material::diffuse(CLASS_IDS[18], 0.08));
    let lens = mesh.add_material(Material::diffuse(CLASS_IDS[18], 0.25));
    bar(&mut mesh, Bar::even(vec3(0.0, 0.0, -0.3), vec3(0.0, 0.0, 3.3), 0.06, 10), pole);
    cuboid(&mut mesh, vec3(-0.28, -0.15, 2.35), vec3(-0.06, 0.15, 3.25), housing);
    for z in [2.52, 2.8, 3.08] {
        panel(&mut mesh, vec3(-0.285, 0.0, z), Vec3::NEG_X, 0.1, 12, lens);
    }
    mesh
}

fn pole_material(mesh: &mut Mesh, dice: &mut Dice) -> MaterialId {
    mesh.add_material(Material::diffuse(CLASS_IDS[18], dice.random_range(0.2..0.6)))
}
