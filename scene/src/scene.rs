//! A mesh that rays can be cast at.

use glam::{DVec3, Vec3, Vec3A};
use obvhs::Boundable;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};

use crate::material::Material;
use crate::mesh::Mesh;

/// A mesh and the tree that finds which of its triangles a ray meets first.
#[derive(Clone)]
pub struct Scene {
    mesh: Mesh,
    tree: Bvh2,
    /// Corners of the triangles, in the order of the tree's leaves.
    leaves: Vec<Leaf>,
}

/// Where a ray met a surface first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, in metres.
    pub distance_m: f64,
    /// The surface's unit normal in the world's frame, on the side that the ray met.
    pub normal: [f64; 3],
    /// Angle between the ray, looked along backwards, and the normal: 0 is head-on.
    pub incidence_rad: f64,
    /// The triangle, by its number in the mesh.
    pub triangle: u32,
    /// What it is made of.
    pub material: Material,
}

#[derive(Clone, Copy, Debug)]
struct Leaf {
    corners: [Vec3A; 3],
}

/// Bounds of a triangle, for the tree's builder.
struct Bounds(Aabb);

impl Boundable for Bounds {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Scene {
    /// Builds the tree over a mesh.
    pub fn new(mesh: Mesh) -> Self {
        let bounds: Vec<Bounds> = (0..mesh.len()).map(|i| Bounds(padded_bounds(mesh.corners_vec(i)))).collect();
        let tree = if mesh.is_empty() {
            Bvh2::default()
        } else {
            build_bvh2(&bounds, BvhBuildParams::medium_build(), &mut std::time::Duration::default())
        };
        let leaves = tree
            .primitive_indices
            .iter()
            .map(|i| Leaf { corners: mesh.corners_vec(*i as usize).map(Vec3A::from) })
            .collect();
        Self { mesh, tree, leaves }
    }

    /// The triangles.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Height of the lowest surface at (x, y), in metres; `None` if there is none.
    pub fn ground_m(&self, x_m: f32, y_m: f32) -> Option<f32> {
        let [low, high] = self.mesh.bounds_m().map(|corner| f64::from(corner[2]));
        let below = low - 1.0;
        let hit = self.hit([f64::from(x_m), f64::from(y_m), below], [0.0, 0.0, 1.0], high - below + 1.0)?;
        Some((below + hit.distance_m) as f32)
    }

    /// The first surface that a ray meets within `farthest_m`; both sides of a triangle are met. `direction` is a unit vector.
    pub fn hit(&self, origin_m: [f64; 3], direction: [f64; 3], farthest_m: f64) -> Option<Hit> {
        let (origin, direction) = (DVec3::from_array(origin_m), DVec3::from_array(direction));
        // One metre more for the rounding of f32: the exact distance decides below.
        let ray = Ray::new(origin.as_vec3a(), direction.as_vec3a(), 0.0, farthest_m as f32 + 1.0);
        let mut nearest = RayHit::none();
        self.tree.ray_traverse(ray, &mut nearest, |ray, leaf| self.leaves[leaf].distance(ray));
        let leaf = self.leaves.get(nearest.primitive_id as usize)?;
        let triangle = self.tree.primitive_indices[nearest.primitive_id as usize];
        let (distance_m, normal) = leaf.exact(origin, direction).unwrap_or((f64::from(nearest.t), -direction));
        (distance_m <= farthest_m).then(|| Hit {
            distance_m,
            normal: normal.to_array(),
            incidence_rad: (-normal.dot(direction)).clamp(0.0, 1.0).acos(),
            triangle,
            material: self.mesh.material(triangle as usize),
        })
    }
}

impl std::fmt::Debug for Scene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scene").field("triangles", &self.mesh.len()).finish_non_exhaustive()
    }
}

impl Leaf {
    /// Distance at which a ray meets the triangle, infinite where it does not.
    ///
    /// The sides on which the ray passes the three edges are told from the edges' ends relative to the ray's origin (Plücker
    /// coordinates). Two triangles compute the same number, but for its sign, for the edge that they share, so no ray slips
    /// between them; obvhs's own test (Möller and Trumbore) does not promise that.
    #[inline]
    fn distance(&self, ray: &Ray) -> f32 {
        let [a, b, c] = self.corners.map(|corner| corner - ray.origin);
        let u = c.cross(b).dot(ray.direction);
        let v = a.cross(c).dot(ray.direction);
        let w = b.cross(a).dot(ray.direction);
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return f32::INFINITY;
        }
        let total = u + v + w;
        let distance = (u * a.dot(ray.direction) + v * b.dot(ray.direction) + w * c.dot(ray.direction)) / total;
        // A triangle seen exactly edge-on has a total of 0 and comes out as NaN, which fails too.
        if distance >= ray.tmin && distance <= ray.tmax { distance } else { f32::INFINITY }
    }

    /// Distance along the ray to the triangle's plane in double precision, and the normal that faces the ray.
    fn exact(&self, origin: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
        let [a, b, c] = self.corners.map(Vec3A::as_dvec3);
        let normal = (b - a).cross(c - a).try_normalize()?;
        let along = normal.dot(direction);
        let distance = normal.dot(a - origin) / along;
        let facing = if along > 0.0 { -normal } else { normal };
        (distance.is_finite() && distance > 0.0).then_some((distance, facing))
    }
}

/// Bounds of a triangle, wider by more than the tree's own arithmetic errs: flat boxes would let grazing rays through.
fn padded_bounds(corners: [Vec3; 3]) -> Aabb {
    let mut bounds = Aabb::from_points(&corners.map(Vec3A::from));
    let reach = bounds.min.abs().max(bounds.max.abs()).max_element();
    let padding = Vec3A::splat(1e-4 + 1e-6 * reach);
    bounds.min -= padding;
    bounds.max += padding;
    bounds
}
