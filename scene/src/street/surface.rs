//! The grounds of a street and how bright each of them is.

use lidar::label::CLASS_IDS;
use rand::RngExt;

use super::Dice;
use super::config::Span;
use super::road::hash;
use crate::material::Material;
use crate::mesh::{MaterialId, Mesh};

/// `SemanticKITTI` id of lane markings; its learning map counts them as road.
const LANE_MARKING: u32 = 60;

/// What the ground is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Surface {
    /// Asphalt.
    Road,
    /// Fresher, darker asphalt where the road was opened.
    Repair,
    /// Thermoplastic with glass beads.
    Paint,
    /// Parking bays and driveways.
    Parking,
    Kerb,
    Pavement,
    /// Gravel, islands, what is neither road nor pavement.
    OtherGround,
    /// Grass and soil.
    Terrain,
    /// Cast-iron lids.
    Lid,
}

const ALL: [Surface; 9] = [
    Surface::Road,
    Surface::Repair,
    Surface::Paint,
    Surface::Parking,
    Surface::Kerb,
    Surface::Pavement,
    Surface::OtherGround,
    Surface::Terrain,
    Surface::Lid,
];

/// Shades of one surface: no two square metres of a street are alike.
const SHADES: usize = 8;

/// The materials of the ground of one street.
pub(super) struct Palette {
    shades: Vec<[MaterialId; SHADES]>,
    seed: u32,
}

impl Surface {
    fn label(self) -> u32 {
        match self {
            Self::Road | Self::Repair | Self::Lid => CLASS_IDS[9],
            Self::Paint => LANE_MARKING,
            Self::Parking => CLASS_IDS[10],
            Self::Kerb | Self::Pavement => CLASS_IDS[11],
            Self::OtherGround => CLASS_IDS[12],
            Self::Terrain => CLASS_IDS[17],
        }
    }

    /// Reflectance in the near infrared (about 0.9 µm) that one street may have, and how much its shades differ. Orders of
    /// magnitude as in the ASTER/ECOSTRESS spectral library: asphalt 0.1–0.25, concrete 0.25–0.45, dry soil 0.3, grass 0.4–0.6.
    fn reflectance(self) -> (Span, f32) {
        match self {
            Self::Road => ([0.12, 0.24], 0.12),
            Self::Repair => ([0.07, 0.13], 0.1),
            Self::Paint => ([0.5, 0.8], 0.15),
            Self::Parking => ([0.15, 0.35], 0.15),
            Self::Kerb => ([0.3, 0.45], 0.1),
            Self::Pavement => ([0.22, 0.42], 0.12),
            Self::OtherGround => ([0.2, 0.4], 0.2),
            Self::Terrain => ([0.35, 0.55], 0.2),
            Self::Lid => ([0.08, 0.15], 0.2),
        }
    }
}

impl Palette {
    pub(super) fn new(mesh: &mut Mesh, dice: &mut Dice) -> Self {
        let shades = ALL
            .iter()
            .map(|surface| {
                let (span, differ) = surface.reflectance();
                let mean = super::config::pick(span, dice);
                std::array::from_fn(|_| {
                    let reflectance = mean * (1.0 + differ * dice.random_range(-1.0..1.0f32));
                    mesh.add_material(Material::diffuse(surface.label(), reflectance))
                })
            })
            .collect();
        Self { shades, seed: dice.random() }
    }

    /// The shade of a surface at a place, the same over about a metre.
    pub(super) fn at(&self, surface: Surface, along_m: f32, left_m: f32) -> MaterialId {
        let share = 0.5 + 0.5 * hash(self.seed, (along_m / 1.3).floor() as i32, (left_m / 1.1).floor() as i32);
        self.shades[surface as usize][((share * SHADES as f32) as usize).min(SHADES - 1)]
    }
}
