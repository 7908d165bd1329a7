//! Lorries, buses and trailers.

use glam::{Vec3, vec3};
use rand::RngExt;

use super::Dice;
use super::car::wheel;
use crate::material::Material;
use crate::mesh::Mesh;
use crate::shape::{Face, Section, cuboid, loft};

/// A lorry with a box body; its middle over the origin, driving along x.
pub(super) fn lorry(label: u32, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let mut paint = |low: f32, high: f32| mesh.add_material(Material::diffuse(label, dice.random_range(low..high)));
    let (cab, cargo, glass, frame) = (paint(0.1, 0.8), paint(0.25, 0.8), paint(0.03, 0.08), paint(0.04, 0.1));
    let length: f32 = dice.random_range(6.2..9.5);
    let (rear, front) = (-0.5 * length, 0.5 * length);
    let half = 1.2;
    let cab_rear = front - 1.9;
    cuboid(&mut mesh, vec3(rear, -0.5, 0.6), vec3(front - 0.3, 0.5, 0.95), frame);
    let high: f32 = dice.random_range(2.9..3.6);
    cuboid(&mut mesh, vec3(rear, -half, 1.0), vec3(cab_rear - 0.15, half, high), cargo);
    let section = |x: f32, low: f32, high: f32| Section::symmetric(x, [low, high], [half - 0.05; 2]);
    let sections = [section(cab_rear, 0.5, 1.45), section(front - 0.05, 0.45, 1.45), section(front, 0.5, 1.4)];
    loft(&mut mesh, &sections, |_, _| Some(cab));
    // Above the belt: a pillar, the side window, the slanted windscreen.
    let sections = [
        section(cab_rear, 1.4, 2.6),
        section(cab_rear + 0.7, 1.4, 2.65),
        section(front - 0.35, 1.4, 2.6),
        section(front - 0.05, 1.4, 1.5),
    ];
    loft(&mut mesh, &sections, |i, face| match (i, face) {
        (1, Face::Side) | (2, Face::Top) => Some(glass),
        _ => Some(cab),
    });
    for x in [front - 1.0, rear + 1.2, rear + 2.3] {
        for side in [-1.0, 1.0] {
            wheel(&mut mesh, vec3(x, side * (half - 0.16), 0.48), 0.48, label, dice);
        }
    }
    plates(&mut mesh, [rear, front], 0.65, label);
    mesh
}

/// A bus: windows all around; its middle over the origin, driving along x.
pub(super) fn bus(label: u32, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let paint = mesh.add_material(Material::diffuse(label, dice.random_range(0.15..0.75)));
    let glass = mesh.add_material(Material::diffuse(label, dice.random_range(0.03..0.08)));
    let (half_length, half) = (dice.random_range(5.2..6.1f32), 1.25);
    // Three bands one above the other: skirt, windows, roof.
    for (low, high, window) in [(0.32, 1.15, false), (1.15, 2.35, true), (2.35, 3.0, false)] {
        let panes = 8;
        let mut xs = vec![-half_length];
        for k in 0..panes {
            let x = |part: f32| -half_length + (k as f32 + part) * 2.0 * half_length / panes as f32;
            xs.extend([x(0.06), x(0.94)]);
        }
        xs.push(half_length);
        let sections: Vec<Section> = xs.iter().map(|x| Section::symmetric(*x, [low, high], [half, half])).collect();
        loft(&mut mesh, &sections, |i, face| match face {
            Face::Bottom if low > 0.5 => None,
            Face::Top if high < 2.9 => None,
            Face::Side if window && i % 2 == 1 => Some(glass),
            Face::End if window => Some(glass),
            _ => Some(paint),
        });
    }
    for x in [-0.55 * half_length, 0.55 * half_length] {
        for side in [-1.0, 1.0] {
            wheel(&mut mesh, vec3(x, side * (half - 0.1), 0.48), 0.48, label, dice);
        }
    }
    plates(&mut mesh, [-half_length, half_length], 0.6, label);
    mesh
}

/// A caravan or a closed trailer, parked.
pub(super) fn trailer(label: u32, dice: &mut Dice) -> Mesh {
    let mut mesh = Mesh::new();
    let paint = mesh.add_material(Material::diffuse(label, dice.random_range(0.4..0.8)));
    let glass = mesh.add_material(Material::diffuse(label, 0.05));
    let (half_length, half, high) = (dice.random_range(1.2..2.6), 1.0, dice.random_range(1.5..2.5f32));
    let section = |x: f32, low: f32, high: f32| Section::symmetric(x, [low, high], [half; 2]);
    let sections = [
        section(-half_length, 0.5, high - 0.15),
        section(-half_length + 0.2, 0.45, high),
        section(-0.4, 0.45, high),
        section(0.6, 0.45, high),
        section(half_length - 0.3, 0.45, high),
        section(half_length, 0.6, high - 0.5),
    ];
    loft(&mut mesh, &sections, |_, _| Some(paint));
    cuboid(&mut mesh, vec3(-0.4, -half - 0.01, 1.1), vec3(0.5, half + 0.01, (high - 0.3).max(1.2)), glass);
    cuboid(&mut mesh, vec3(half_length, -0.05, 0.42), vec3(half_length + 1.0, 0.05, 0.5), glass);
    for side in [-1.0, 1.0] {
        wheel(&mut mesh, vec3(0.0, side * (half - 0.1), 0.32), 0.32, label, dice);
    }
    plates(&mut mesh, [-half_length, half_length], 0.6, label);
    mesh
}

fn plates(mesh: &mut Mesh, ends: [f32; 2], height_m: f32, label: u32) {
    let plate = mesh.add_material(Material::retro(label, 0.95));
    for x in ends {
        let half = vec3(0.03, 0.26, 0.055);
        let at = Vec3::new(x, 0.0, height_m);
        cuboid(mesh, at - half, at + half, plate);
    }
}
