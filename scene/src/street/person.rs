//! People: standing, walking, and as riders.

use glam::{Vec3, vec3};
use rand::RngExt;

use super::Dice;
use crate::material::Material;
use crate::mesh::{MaterialId, Mesh};
use crate::shape::{Bar, bar, ellipsoid};

/// What somebody wears, and their skin.
struct Clothes {
    top: MaterialId,
    bottom: MaterialId,
    shoes: MaterialId,
    skin: MaterialId,
}

/// Where the joints of a body are that is 1.75 m tall, on one side and the other.
#[derive(Clone, Copy)]
struct Posture {
    hip: Vec3,
    neck: Vec3,
    knees: [Vec3; 2],
    feet: [Vec3; 2],
    elbows: [Vec3; 2],
    hands: [Vec3; 2],
}

/// Somebody who walks along x, feet at z = 0.
pub(super) fn walking(label: u32, dice: &mut Dice) -> Mesh {
    let stride = dice.random_range(0.0..0.32f32);
    let posture = Posture {
        hip: vec3(0.0, 0.0, 0.92),
        neck: vec3(0.03, 0.0, 1.46),
        knees: [vec3(0.5 * stride + 0.05, 0.1, 0.5), vec3(-0.3 * stride, -0.1, 0.5)],
        feet: [vec3(stride, 0.1, 0.06), vec3(-stride, -0.1, 0.06)],
        elbows: [vec3(-0.5 * stride, 0.25, 1.14), vec3(0.5 * stride, -0.25, 1.14)],
        hands: [vec3(-0.4 * stride + 0.1, 0.24, 0.88), vec3(stride + 0.1, -0.24, 0.9)],
    };
    let mut mesh = Mesh::new();
    // Children and tall people.
    let scale = dice.random_range(0.68..1.1f32).max(dice.random_range(0.68..1.05));
    body(&mut mesh, posture, scale, Vec3::ZERO, label, dice);
    mesh
}

/// Adds somebody who sits at `seat` with their hands at `handle` and their feet at `pedal`.
pub(super) fn riding(mesh: &mut Mesh, seat: Vec3, handle: Vec3, pedal: Vec3, label: u32, dice: &mut Dice) {
    let side = |at: Vec3, y: f32| vec3(at.x, y, at.z);
    let neck = seat + vec3(0.22, 0.0, 0.54);
    let posture = Posture {
        hip: seat + Vec3::Z * 0.05,
        neck,
        knees: [side(seat + vec3(0.38, 0.0, -0.12), 0.11), side(seat + vec3(0.3, 0.0, -0.3), -0.11)],
        feet: [side(pedal + vec3(0.08, 0.0, 0.12), 0.12), side(pedal - vec3(0.08, 0.0, 0.12), -0.12)],
        elbows: [side(0.5 * (neck + handle) - Vec3::Z * 0.1, 0.27), side(0.5 * (neck + handle) - Vec3::Z * 0.1, -0.27)],
        hands: [side(handle, 0.24), side(handle, -0.24)],
    };
    body(mesh, posture, 1.0, Vec3::ZERO, label, dice);
}

fn body(mesh: &mut Mesh, p: Posture, scale: f32, at: Vec3, label: u32, dice: &mut Dice) {
    let mut cloth = |low: f32, high: f32| mesh.add_material(Material::diffuse(label, dice.random_range(low..high)));
    // Near infrared: most dyes turn cloth bright, skin is about 0.55.
    let c =
        Clothes { top: cloth(0.08, 0.8), bottom: cloth(0.08, 0.7), shoes: cloth(0.05, 0.5), skin: cloth(0.45, 0.62) };
    let place = |joint: Vec3| at + joint * scale;
    let mut limb = |from: Vec3, to: Vec3, radii: [f32; 2], material: MaterialId| {
        let radius_m = radii.map(|r| r * scale);
        bar(mesh, Bar { from: place(from), to: place(to), radius_m, sides: 7 }, material);
    };
    for k in 0..2 {
        let y = if k == 0 { 0.1 } else { -0.1 };
        limb(p.hip + Vec3::Y * y, p.knees[k], [0.1, 0.07], c.bottom);
        limb(p.knees[k], p.feet[k], [0.07, 0.05], c.bottom);
        limb(p.feet[k] - vec3(0.07, 0.0, 0.0), p.feet[k] + vec3(0.18, 0.0, -0.02), [0.055, 0.045], c.shoes);
        limb(p.neck + vec3(0.0, 2.0 * y, -0.06), p.elbows[k], [0.06, 0.05], c.top);
        limb(p.elbows[k], p.hands[k], [0.05, 0.035], c.skin);
    }
    limb(p.neck - Vec3::Z * 0.03, p.neck + Vec3::Z * 0.1, [0.06, 0.06], c.skin);
    let (hip, neck) = (place(p.hip), place(p.neck));
    let mut round =
        |centre: Vec3, radii: Vec3, material: MaterialId| ellipsoid(mesh, centre, radii * scale, 10, material);
    round(hip + vec3(0.0, 0.0, 0.02), vec3(0.14, 0.18, 0.16), c.bottom);
    round(0.5 * (hip + neck) + Vec3::Z * 0.06 * scale, vec3(0.15, 0.21, 0.3), c.top);
    round(neck + Vec3::Z * 0.2 * scale, vec3(0.1, 0.085, 0.13), c.skin);
}
