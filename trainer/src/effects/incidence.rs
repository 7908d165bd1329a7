//! What can be said of the angle of incidence on each ray, also where the image shows no plane.

use burn::tensor::Tensor;

use super::image::Image;
use super::surface::dot;

/// Classes of the ground, sealed and not: road, parking, sidewalk, other ground; terrain.
const SEALED: (f64, f64) = (9.0, 12.0);
const TERRAIN: f64 = 17.0;

/// Squared cosine of a slope from which and up to which a surface is less and less level: 25° and 35°.
const LEVEL: (f64, f64) = (0.82, 0.67);

/// Share of the planes that end beside their pixel which are nothing like the surface, for reliefs that are finer than the rays; and the
/// same of leaves, trunks and poles. Measured on streets of our own.
const ASTRAY: (f64, f64) = (0.2, 0.65);

/// Classes of what is rounder and rougher than the rays are wide: vegetation, trunk; pole.
const ROUGH: (f64, f64) = (15.0, 16.0);
const POLE: f64 = 18.0;

/// Mean and variance of ln cos α of an angle of which nothing is known. Facets of any orientation are seen in proportion to the area that
/// they show, which makes cos² α uniform.
pub(super) const ANY_ANGLE: (f64, f64) = (-0.5, 0.25);

/// 1 on ground that is sealed, as far as the classes say; 0 elsewhere.
fn sealed(image: &Image) -> Tensor<3> {
    let class = &image.surface.class;
    class.clone().greater_elem(SEALED.0 - 0.5).float() * class.clone().lower_elem(SEALED.1 + 0.5).float()
}

/// Cosine of the angle of incidence and 1 where it is known: from the plane that the image shows, or on ground, taken to be level, from the
/// ray's elevation.
fn cosine(image: &Image) -> (Tensor<3>, Tensor<3>) {
    let surface = &image.surface;
    let terrain = (surface.class.clone() - TERRAIN).abs().lower_elem(0.5).float();
    let ground = (sealed(image) + terrain) * (surface.known.clone() * -1.0 + 1.0);
    let level = image.rays.elevation_rad.clone().sin().abs().clamp_min(0.01) + surface.range_m.zeros_like();
    let cosine = surface.cos_incidence.clone().mask_where(ground.clone().greater_elem(0.5), level);
    (cosine, surface.known.clone() + ground)
}

/// Mean and variance of ln cos α, [`ANY_ANGLE`]'s where it is not known.
pub(super) fn log_cosine(image: &Image) -> (Tensor<3>, Tensor<3>) {
    let (cosine, known) = cosine(image);
    let unknown = known * -1.0 + 1.0;
    // Where nothing is known the cosine is 1.
    (cosine.log() + unknown.clone() * ANY_ANGLE.0, unknown * ANY_ANGLE.1)
}

/// Probability that the cosine of a known angle is nothing like the true one.
pub(super) fn astray(image: &Image) -> Tensor<3> {
    let class = &image.surface.class;
    let rough = class.clone().greater_elem(ROUGH.0 - 0.5).float() * class.clone().lower_elem(ROUGH.1 + 0.5).float()
        + (class.clone() - POLE).abs().lower_elem(0.5).float();
    let share = rough * (ASTRAY.1 - ASTRAY.0) + ASTRAY.0;
    let no_ground = sealed(image) * -1.0 + 1.0;
    (image.surface.interior.clone() * -1.0 + 1.0) * image.surface.known.clone() * no_ground * share
}

/// Cosine of the angle of incidence, and to what part a film of water would stay: on sealed ground, or where classes are missing, on what
/// is level.
pub(super) fn on_wet_ground(image: &Image) -> (Tensor<3>, Tensor<3>) {
    let surface = &image.surface;
    let up = surface.plane[2].clone().square() / dot(&surface.plane, &surface.plane).clamp_min(1e-12);
    let level = ((up - LEVEL.1) / (LEVEL.0 - LEVEL.1)).clamp(0.0, 1.0) * surface.known.clone();
    let (cosine, _) = cosine(image);
    (cosine, sealed(image) + level * surface.class.clone().lower_elem(0.5).float())
}
