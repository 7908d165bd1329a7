//! Triangles in the world's frame, each of one material.

use glam::{Affine3A, Vec3};
use thiserror::Error;

use crate::material::Material;

/// Most triangles that a mesh may have: bounds what a file can make us allocate.
pub const MAX_TRIANGLES: usize = 50_000_000;

/// Coordinates farther than this from the origin are too coarse in `f32` to cast rays at (here 8 mm).
pub const MAX_COORDINATE_M: f32 = 100_000.0;

/// Triangles with materials: x ahead, y left, z up, in metres.
///
/// A mesh that exists has finite vertices, and only indices that point at something.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    material_of: Vec<u32>,
    materials: Vec<Material>,
}

/// A material of one mesh: what [`Mesh::add_material`] gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaterialId(u32);

/// Triangles that are none.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TriangleError {
    /// A triangle points past the last vertex.
    #[error("triangle {triangle} has vertex {found}, of {vertices}")]
    NoSuchVertex {
        /// Triangle, from 0.
        triangle: usize,
        /// Its vertex.
        found: u32,
        /// Vertices that there are.
        vertices: usize,
    },
    /// A vertex is nowhere, or too far away.
    #[error("vertex {vertex} is at ({x}, {y}, {z}) m, expected finite numbers up to {MAX_COORDINATE_M} m from the origin", x = .at[0], y = .at[1], z = .at[2])]
    Nowhere {
        /// Vertex, from 0.
        vertex: usize,
        /// Where it is said to be.
        at: [f32; 3],
    },
    /// More than a mesh can hold.
    #[error("{0} triangles, expected at most {MAX_TRIANGLES}")]
    TooMany(usize),
}

impl Mesh {
    /// A mesh without a triangle.
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// True without triangles.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The corners of triangle `i`, in metres.
    pub fn corners(&self, i: usize) -> [[f32; 3]; 3] {
        self.triangles[i].map(|v| self.vertices[v as usize].to_array())
    }

    /// The material of triangle `i`.
    pub fn material(&self, i: usize) -> Material {
        self.materials[self.material_of[i] as usize]
    }

    /// Lowest and highest coordinates; both zero without triangles.
    pub fn bounds_m(&self) -> [[f32; 3]; 2] {
        let corners = || self.triangles.iter().flatten().map(|v| self.vertices[*v as usize]);
        let Some(first) = corners().next() else { return [[0.0; 3]; 2] };
        let (low, high) = corners().fold((first, first), |(low, high), v| (low.min(v), high.max(v)));
        [low.to_array(), high.to_array()]
    }

    /// Makes a material known; triangles refer to it by what comes back.
    pub fn add_material(&mut self, material: Material) -> MaterialId {
        self.materials.push(material);
        MaterialId(self.materials.len() as u32 - 1)
    }

    /// Adds triangles of one material that share vertices, three indices each.
    ///
    /// # Panics
    /// If the material is of another mesh.
    pub fn add_triangles(
        &mut self,
        vertices_m: &[[f32; 3]],
        triangles: &[[u32; 3]],
        material: MaterialId,
    ) -> Result<(), TriangleError> {
        assert!((material.0 as usize) < self.materials.len(), "a material of this mesh");
        for (vertex, at) in vertices_m.iter().enumerate() {
            if !at.iter().all(|c| c.abs() <= MAX_COORDINATE_M) {
                return Err(TriangleError::Nowhere { vertex, at: *at });
            }
        }
        for (triangle, indices) in triangles.iter().enumerate() {
            if let Some(found) = indices.iter().find(|v| **v as usize >= vertices_m.len()) {
                return Err(TriangleError::NoSuchVertex { triangle, found: *found, vertices: vertices_m.len() });
            }
        }
        let total = self.len() + triangles.len();
        if total > MAX_TRIANGLES || self.vertices.len() + vertices_m.len() > 3 * MAX_TRIANGLES {
            return Err(TriangleError::TooMany(total));
        }
        let base = self.vertices.len() as u32;
        self.vertices.extend(vertices_m.iter().map(|v| Vec3::from_array(*v)));
        self.triangles.extend(triangles.iter().map(|t| t.map(|v| v + base)));
        self.material_of.resize(total, material.0);
        Ok(())
    }

    /// Adds another mesh's triangles, turned, scaled and moved.
    pub(crate) fn append(&mut self, other: &Self, world_from_other: &Affine3A) {
        let (base, base_material) = (self.vertices.len() as u32, self.materials.len() as u32);
        self.vertices.extend(other.vertices.iter().map(|v| world_from_other.transform_point3(*v)));
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + base)));
        self.material_of.extend(other.material_of.iter().map(|m| m + base_material));
        self.materials.extend(&other.materials);
    }

    /// Adds one triangle. The builders of this crate take care of the numbers.
    pub(crate) fn triangle(&mut self, corners: [Vec3; 3], material: MaterialId) {
        debug_assert!(corners.iter().all(|c| c.abs().max_element() <= MAX_COORDINATE_M), "{corners:?}");
        let base = self.vertices.len() as u32;
        self.vertices.extend(corners);
        self.triangles.push([base, base + 1, base + 2]);
        self.material_of.push(material.0);
    }

    /// Adds a four-cornered face, its corners in order around it.
    pub(crate) fn quad(&mut self, corners: [Vec3; 4], material: MaterialId) {
        debug_assert!(corners.iter().all(|c| c.abs().max_element() <= MAX_COORDINATE_M), "{corners:?}");
        let base = self.vertices.len() as u32;
        self.vertices.extend(corners);
        self.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
        self.material_of.extend([material.0; 2]);
    }

    pub(crate) fn corners_vec(&self, i: usize) -> [Vec3; 3] {
        self.triangles[i].map(|v| self.vertices[v as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_takes_no_triangle_that_points_nowhere() {
        let mut mesh = Mesh::new();
        let material = mesh.add_material(Material::diffuse(40, 0.2));
        let mut add = |vertices: &[[f32; 3]], triangles: &[[u32; 3]]| {
            mesh.add_triangles(vertices, triangles, material).map_err(|e| e.to_string())
        };
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(add(&corners, &[[0, 1, 2]]), Ok(()));
        assert!(add(&corners, &[[0, 1, 3]]).is_err_and(|e| e.contains("vertex 3, of 3")));
        assert!(add(&[[f32::NAN, 0.0, 0.0]], &[]).is_err_and(|e| e.contains("vertex 0 is at (NaN, 0, 0)")));
        assert!(add(&[[1e9, 0.0, 0.0]], &[]).is_err());
        assert_eq!(mesh.len(), 1);
        assert_eq!(mesh.bounds_m(), [[0.0; 3], [1.0, 1.0, 0.0]]);
    }
}
