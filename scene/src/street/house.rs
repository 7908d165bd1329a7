//! Houses: walls with recessed windows and doors, and a roof.

use glam::{Vec3, vec3};
use lidar::label::CLASS_IDS;
use rand::RngExt;

use super::Dice;
use crate::material::Material;
use crate::mesh::{MaterialId, Mesh};
use crate::shape::{Bar, bar, cuboid};

/// What a house is to be. Its frame: x along the street, y away from it, z up; the front wall is at y = 0, from x = 0 on.
#[derive(Clone, Copy, Debug)]
pub(super) struct House {
    pub(super) width_m: f32,
    pub(super) depth_m: f32,
    pub(super) storeys: usize,
    pub(super) storey_m: f32,
    pub(super) roof: Roof,
    /// Large panes on the ground floor.
    pub(super) shop: bool,
    pub(super) balconies: bool,
    /// Whether the left and the right wall have windows: not where another house leans on them.
    pub(super) open_sides: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Roof {
    /// The ridge runs along the street.
    Along,
    /// A gable faces the street.
    Across,
    /// Slopes to all four sides.
    Hipped,
    /// Flat, with a parapet.
    Flat,
}

/// The materials of one house.
struct Paints {
    wall: MaterialId,
    trim: MaterialId,
    glass: MaterialId,
    door: MaterialId,
    roof: MaterialId,
}

/// A wall as its windows see it.
#[derive(Clone, Copy)]
struct Wall {
    from: Vec3,
    /// Unit vectors along the wall and into the house.
    along: Vec3,
    inward: Vec3,
    width_m: f32,
    doors: bool,
}

/// How far the walls go on below the ground, which slopes.
const FOUNDATION_M: f32 = 1.2;

/// How deep a window lies in its wall.
const RECESS_M: f32 = 0.12;

impl House {
    /// Builds the house.
    pub(super) fn build(&self, dice: &mut Dice) -> Mesh {
        let mut mesh = Mesh::new();
        let mut paint =
            |low: f32, high: f32| mesh.add_material(Material::diffuse(CLASS_IDS[13], dice.random_range(low..high)));
        let wall = if paint_is_light(self) { paint(0.5, 0.75) } else { paint(0.22, 0.5) };
        let paints = Paints {
            wall,
            trim: paint(0.4, 0.75),
            glass: paint(0.03, 0.1),
            door: paint(0.1, 0.6),
            roof: paint(0.12, 0.4),
        };
        let (w, d) = (self.width_m, self.depth_m);
        let walls = [
            (vec3(0.0, 0.0, 0.0), Vec3::X, Vec3::Y, w, true, true),
            (vec3(0.0, d, 0.0), Vec3::X, Vec3::NEG_Y, w, true, true),
            (vec3(0.0, 0.0, 0.0), Vec3::Y, Vec3::X, d, false, self.open_sides),
            (vec3(w, 0.0, 0.0), Vec3::Y, Vec3::NEG_X, d, false, self.open_sides),
        ];
        for (from, along, inward, width_m, doors, windows) in walls {
            self.wall(&mut mesh, Wall { from, along, inward, width_m, doors }, windows, &paints, dice);
        }
        self.roof(&mut mesh, &paints, dice);
        if self.balconies {
            self.balconies(&mut mesh, &paints, dice);
        }
        // A downpipe at one corner of the front.
        let at = vec3(0.15, -0.06, 0.0);
        bar(&mut mesh, Bar::even(at, at + Vec3::Z * self.eaves_m(), 0.045, 6), paints.trim);
        mesh
    }

    fn eaves_m(&self) -> f32 {
        self.storeys as f32 * self.storey_m
    }

    /// One wall: a grid of cells, of which some are set back as windows or doors.
    fn wall(&self, mesh: &mut Mesh, wall: Wall, windows: bool, paints: &Paints, dice: &mut Dice) {
        let columns = if windows { (wall.width_m / dice.random_range(2.1..3.2f32)) as usize } else { 0 };
        let share = if self.shop { 0.75 } else { dice.random_range(0.38..0.6) };
        let mut x_cuts = vec![0.0];
        for k in 0..columns {
            let pitch = wall.width_m / columns as f32;
            let middle = (k as f32 + 0.5) * pitch;
            x_cuts.extend([middle - 0.5 * share * pitch, middle + 0.5 * share * pitch]);
        }
        x_cuts.push(wall.width_m);
        let mut z_cuts = vec![-FOUNDATION_M];
        for storey in 0..self.storeys {
            let floor = storey as f32 * self.storey_m;
            let sill = if self.shop && storey == 0 { 0.5 } else { 0.9 };
            z_cuts.extend([floor, floor + sill, floor + 0.82 * self.storey_m]);
        }
        z_cuts.push(self.eaves_m());
        let door = (wall.doors && columns > 0).then(|| dice.random_range(0..columns));
        for i in 0..x_cuts.len() - 1 {
            for j in 0..z_cuts.len() - 1 {
                let (cell_x, cell_z) = ([x_cuts[i], x_cuts[i + 1]], [z_cuts[j], z_cuts[j + 1]]);
                // Rows: foundation, then below the sill, window and lintel of each storey. Columns: pier, window, pier, …
                let window_column = i % 2 == 1;
                let is_door = window_column && door == Some(i / 2) && (j == 1 || j == 2);
                if is_door {
                    recess(mesh, wall, cell_x, cell_z, paints.trim, paints.door);
                } else if window_column && j % 3 == 2 {
                    recess(mesh, wall, cell_x, cell_z, paints.trim, paints.glass);
                } else {
                    mesh.quad(cell(wall, cell_x, cell_z, 0.0), paints.wall);
                }
            }
        }
    }

    fn roof(&self, mesh: &mut Mesh, paints: &Paints, dice: &mut Dice) {
        let (w, d, eaves) = (self.width_m, self.depth_m, self.eaves_m());
        let over = 0.35;
        if self.roof == Roof::Flat {
            let (low, high) = (vec3(0.0, 0.0, eaves), vec3(w, d, eaves + 0.5));
            mesh.quad([low, vec3(w, 0.0, eaves), vec3(w, d, eaves), vec3(0.0, d, eaves)], paints.roof);
            for [from, to] in [
                [low, vec3(w, 0.2, high.z)],
                [vec3(0.0, d - 0.2, eaves), high],
                [vec3(0.0, 0.2, eaves), vec3(0.2, d - 0.2, high.z)],
                [vec3(w - 0.2, 0.2, eaves), vec3(w, d - 0.2, high.z)],
            ] {
                cuboid(mesh, from, to, paints.trim);
            }
            return;
        }
        let steep = dice.random_range(0.6..1.1f32);
        let half = if self.roof == Roof::Across { 0.5 * w } else { 0.5 * d };
        let top = eaves + steep * half;
        // The eaves hang lower by as much as they stand out.
        let low = eaves - steep * over;
        let corner =
            |x: f32, y: f32| vec3(if x > 0.0 { w + over } else { -over }, if y > 0.0 { d + over } else { -over }, low);
        let [a, b, c, e] = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
        match self.roof {
            Roof::Along => {
                let (left, right) = (vec3(-over, 0.5 * d, top), vec3(w + over, 0.5 * d, top));
                mesh.quad([a, b, right, left], paints.roof);
                mesh.quad([e, c, right, left], paints.roof);
                for x in [0.0, w] {
                    mesh.triangle([vec3(x, 0.0, eaves), vec3(x, d, eaves), vec3(x, 0.5 * d, top)], paints.wall);
                }
            }
            Roof::Across => {
                let (front, back) = (vec3(0.5 * w, -over, top), vec3(0.5 * w, d + over, top));
                mesh.quad([a, front, back, e], paints.roof);
                mesh.quad([b, front, back, c], paints.roof);
                for y in [0.0, d] {
                    mesh.triangle([vec3(0.0, y, eaves), vec3(w, y, eaves), vec3(0.5 * w, y, top)], paints.wall);
                }
            }
            Roof::Hipped | Roof::Flat => {
                let inset = (0.5 * d).min(0.45 * w);
                let (left, right) = (vec3(inset, 0.5 * d, top), vec3(w - inset, 0.5 * d, top));
                mesh.quad([a, b, right, left], paints.roof);
                mesh.quad([e, c, right, left], paints.roof);
                mesh.triangle([a, e, left], paints.roof);
                mesh.triangle([b, c, right], paints.roof);
            }
        }
        let at = vec3(dice.random_range(0.2..0.8) * w, dice.random_range(0.4..0.6) * d, eaves);
        cuboid(mesh, at, at + vec3(0.6, 0.5, top - eaves + 0.7), paints.wall);
        if self.roof == Roof::Along && dice.random_bool(0.4) {
            let x = dice.random_range(0.2..0.6) * w;
            cuboid(mesh, vec3(x, 0.12 * d, eaves), vec3(x + 1.6, 0.45 * d, eaves + 0.6 * (top - eaves)), paints.trim);
        }
    }

    /// A slab and a railing at some windows of the front.
    fn balconies(&self, mesh: &mut Mesh, paints: &Paints, dice: &mut Dice) {
        let (depth, length) = (dice.random_range(0.9..1.5), 3.0f32);
        let count = (self.width_m / 5.0) as usize;
        for storey in 1..self.storeys {
            for k in 0..count {
                let x = (k as f32 + 0.5) * self.width_m / count as f32 - 0.5 * length;
                let z = storey as f32 * self.storey_m;
                cuboid(mesh, vec3(x, -depth, z - 0.15), vec3(x + length, 0.0, z), paints.trim);
                cuboid(mesh, vec3(x, -depth, z), vec3(x + length, -depth + 0.04, z + 1.0), paints.wall);
                for side in [x, x + length - 0.04] {
                    cuboid(mesh, vec3(side, -depth, z), vec3(side + 0.04, 0.0, z + 1.0), paints.wall);
                }
            }
        }
    }
}

/// Plaster is lighter than brick.
fn paint_is_light(house: &House) -> bool {
    house.balconies || house.storeys.is_multiple_of(2)
}

/// The corners of a cell of a wall, set back by `inward_m`.
fn cell(wall: Wall, x: [f32; 2], z: [f32; 2], inward_m: f32) -> [Vec3; 4] {
    let at = |x: f32, z: f32| wall.from + wall.along * x + wall.inward * inward_m + Vec3::Z * z;
    [at(x[0], z[0]), at(x[1], z[0]), at(x[1], z[1]), at(x[0], z[1])]
}

/// A cell that is set back, with the four faces that lead to it.
fn recess(mesh: &mut Mesh, wall: Wall, x: [f32; 2], z: [f32; 2], frame: MaterialId, pane: MaterialId) {
    let (outer, inner) = (cell(wall, x, z, 0.0), cell(wall, x, z, RECESS_M));
    mesh.quad(inner, pane);
    for k in 0..4 {
        let next = (k + 1) % 4;
        mesh.quad([outer[k], outer[next], inner[next], inner[k]], frame);
    }
}
