//! Cars: body, cabin with glass, wheels, plates and lamps.

use glam::{Vec3, vec3};
use rand::RngExt;

use super::Dice;
use crate::material::Material;
use crate::mesh::{MaterialId, Mesh};
use crate::shape::{Bar, Face, Section, bar, cuboid, loft};

/// The outline of a kind of car, in shares of its length (from the rear bumper) and in metres.
#[derive(Clone, Copy, Debug)]
struct Outline {
    length_m: f32,
    width_m: f32,
    height_m: f32,
    /// Height of the bonnet and of the boot at their ends.
    bonnet_m: f32,
    boot_m: f32,
    /// Lower edge of the side windows.
    belt_m: f32,
    /// Where the rear window's foot and head, and the windscreen's head and foot are.
    cabin: [f32; 4],
}

const SALOON: Outline = Outline {
    length_m: 4.6,
    width_m: 1.8,
    height_m: 1.44,
    bonnet_m: 0.72,
    boot_m: 0.9,
    belt_m: 0.95,
    cabin: [0.14, 0.3, 0.56, 0.74],
};
const HATCHBACK: Outline =
    Outline { length_m: 4.0, height_m: 1.48, boot_m: 0.92, cabin: [0.02, 0.12, 0.58, 0.76], ..SALOON };
const ESTATE: Outline = Outline { length_m: 4.7, height_m: 1.5, cabin: [0.02, 0.1, 0.57, 0.74], ..SALOON };
const OFF_ROADER: Outline = Outline {
    length_m: 4.5,
    width_m: 1.88,
    height_m: 1.7,
    bonnet_m: 0.95,
    boot_m: 1.05,
    belt_m: 1.12,
    cabin: [0.02, 0.08, 0.58, 0.74],
};
const VAN: Outline = Outline {
    length_m: 5.0,
    width_m: 1.92,
    height_m: 1.98,
    bonnet_m: 0.95,
    boot_m: 1.1,
    belt_m: 1.15,
    cabin: [0.005, 0.02, 0.68, 0.84],
};

/// A car with its middle over the origin, driving along x, its wheels at z = 0.
pub(super) fn build(label: u32, dice: &mut Dice) -> Mesh {
    let kinds = [SALOON, HATCHBACK, HATCHBACK, ESTATE, OFF_ROADER, VAN];
    let mut outline = kinds[dice.random_range(0..kinds.len())];
    outline.length_m *= dice.random_range(0.92..1.06);
    outline.width_m *= dice.random_range(0.96..1.03);
    outline.height_m *= dice.random_range(0.97..1.04);
    let mut mesh = Mesh::new();
    // Near-infrared reflectance of car paint spans more than what the eye sees: black paint 0.05, white 0.8.
    let paint = mesh.add_material(Material::diffuse(label, dice.random_range(0.05..0.8)));
    let panel_van = outline.height_m > 1.9 && dice.random();
    let glass = mesh.add_material(Material::diffuse(label, dice.random_range(0.03..0.08)));
    let dark = mesh.add_material(Material::diffuse(label, dice.random_range(0.03..0.08)));
    body(&mut mesh, &outline, paint, dark);
    cabin(&mut mesh, &outline, paint, if panel_van { paint } else { glass }, glass);
    let x = 0.5 * outline.length_m;
    for (axle, side) in [(0.62, 1.0), (0.62, -1.0), (-0.58, 1.0), (-0.58, -1.0)] {
        wheel(&mut mesh, vec3(axle * x, side * (0.5 * outline.width_m - 0.1), 0.32), 0.32, label, dice);
    }
    for side in [-1.0, 1.0] {
        let at = vec3((outline.cabin[3] * 2.0 - 1.0) * x - 0.35, side * (0.5 * outline.width_m + 0.08), outline.belt_m);
        cuboid(&mut mesh, at - vec3(0.06, 0.1, 0.02), at + vec3(0.06, 0.1, 0.14), paint);
    }
    lights_and_plates(&mut mesh, &outline, label);
    mesh
}

fn body(mesh: &mut Mesh, o: &Outline, paint: MaterialId, dark: MaterialId) {
    let (x, half) = (0.5 * o.length_m, 0.5 * o.width_m);
    let section = |share: f32, low: f32, high: f32, narrow: f32| {
        Section::symmetric((share * 2.0 - 1.0) * x, [low, high], [half - narrow - 0.04, half - narrow])
    };
    let sections = [
        section(0.0, 0.42, o.boot_m - 0.1, 0.1),
        section(0.03, 0.24, o.boot_m, 0.04),
        section(o.cabin[0] + 0.04, 0.22, o.belt_m, 0.0),
        section(o.cabin[3], 0.22, o.belt_m, 0.0),
        section(0.97, 0.22, o.bonnet_m, 0.06),
        section(1.0, 0.3, o.bonnet_m - 0.14, 0.16),
    ];
    loft(mesh, &sections, |_, face| Some(if face == Face::Bottom { dark } else { paint }));
}

/// The cabin: slanted windows in front and behind, windows and pillars in turn along the sides.
fn cabin(mesh: &mut Mesh, o: &Outline, paint: MaterialId, rear_glass: MaterialId, glass: MaterialId) {
    let (x, half) = (0.5 * o.length_m, 0.5 * o.width_m);
    let [rear_foot, rear_head, front_head, front_foot] = o.cabin;
    let section = |share: f32, high: f32| {
        // The sides lean in towards the roof.
        let lean = 0.14 * (high - o.belt_m) / (o.height_m - o.belt_m);
        Section::symmetric((share * 2.0 - 1.0) * x, [o.belt_m - 0.02, high], [half - 0.03, half - 0.03 - lean])
    };
    let middle = 0.5 * (rear_head + front_head);
    let pillar = 0.012;
    let roof = o.height_m;
    let sections = [
        section(rear_foot, o.belt_m + 0.02),
        section(rear_head, roof - 0.04),
        section(rear_head + 3.0 * pillar, roof - 0.02),
        section(middle - pillar, roof),
        section(middle + pillar, roof),
        section(front_head - pillar, roof - 0.02),
        section(front_head, roof - 0.04),
        section(front_foot, o.belt_m + 0.02),
    ];
    loft(mesh, &sections, |i, face| match (i, face) {
        (_, Face::Bottom) => None,
        (0, Face::Top) | (2, Face::Side) => Some(rear_glass),
        (6, Face::Top) | (4, Face::Side) => Some(glass),
        _ => Some(paint),
    });
}

/// A wheel that turns about y: tyre and rim.
pub(super) fn wheel(mesh: &mut Mesh, centre: Vec3, radius_m: f32, label: u32, dice: &mut Dice) {
    let tyre = mesh.add_material(Material::diffuse(label, dice.random_range(0.03..0.07)));
    let rim = mesh.add_material(Material::diffuse(label, dice.random_range(0.3..0.65)));
    let half = vec3(0.0, 0.11, 0.0);
    bar(mesh, Bar::even(centre - half, centre + half, radius_m, 16), tyre);
    bar(mesh, Bar::even(centre - half * 1.08, centre + half * 1.08, 0.6 * radius_m, 12), rim);
}

/// Plates and reflectors send the light straight back.
fn lights_and_plates(mesh: &mut Mesh, o: &Outline, label: u32) {
    let plate = mesh.add_material(Material::retro(label, 0.95));
    let reflector = mesh.add_material(Material::retro(label, 0.9));
    let lamp = mesh.add_material(Material::diffuse(label, 0.35));
    let x = 0.5 * o.length_m;
    for (end, height) in [(x, 0.42), (-x, 0.55)] {
        cuboid(mesh, vec3(end - 0.03, -0.26, height), vec3(end + 0.03, 0.26, height + 0.11), plate);
    }
    for side in [-1.0, 1.0] {
        let y = side * (0.5 * o.width_m - 0.25);
        let (boot, bonnet) = (o.boot_m - 0.28, o.bonnet_m - 0.22);
        cuboid(mesh, vec3(-x - 0.02, y - 0.08, boot), vec3(-x + 0.1, y + 0.08, boot + 0.14), reflector);
        cuboid(mesh, vec3(x - 0.12, y - 0.14, bonnet), vec3(x + 0.01, y + 0.14, bonnet + 0.12), lamp);
    }
}
