//! What can be said of the angle of incidence on each ray, also where the image shows no plane.

use burn::tensor::Tensor;

use super::Parameter;
use super::image::Image;
use super::rays::Rays;
use super::surface::{Surface, dot, rough};

/// Classes of the ground, sealed and not: road, parking, sidewalk, other ground; terrain.
const SEALED: (f64, f64) = (9.0, 12.0);
const TERRAIN: f64 = 17.0;

/// Squared cosine of a slope from which and up to which a surface is less and less level: 25° and 35°.
const LEVEL: (f64, f64) = (0.82, 0.67);

/// Shares of the angles that are nothing like the true one, as weak returns from streets of our own tell: of planes that end beside their
/// pixel, on the ground; and of ground that is only taken to be level, where kerbs stand. Of planes on anything else, which depends on how
/// much relief there is, a fit tells: [`strays`].
const ASTRAY: Astray = Astray { ground: 0.02, level: 0.12 };

struct Astray {
    ground: f64,
    level: f64,
}

/// Where nothing is known of an angle, cosᵃ α is taken to be uniform: a = 2 for facets of any orientation, which are seen in proportion to
/// the area that they show; less for what is smooth, whose plane an image shows the less the more it is seen from the side, as weak returns
/// from streets of our own tell.
const UNIFORM: Uniform = Uniform { any: 2.0, smooth: 1.4 };

struct Uniform {
    any: f64,
    smooth: f64,
}

/// 1 on ground that is sealed, as far as the classes say; 0 elsewhere.
fn sealed(surface: &Surface) -> Tensor<3> {
    let class = &surface.class;
    class.clone().greater_elem(SEALED.0 - 0.5).float() * class.clone().lower_elem(SEALED.1 + 0.5).float()
}

/// 1 on ground, sealed or not, as far as the classes say; 0 elsewhere.
fn ground(surface: &Surface) -> Tensor<3> {
    sealed(surface) + (surface.class.clone() - TERRAIN).abs().lower_elem(0.5).float()
}

/// Cosine of the angle of incidence and 1 where it is known: from the plane that the image shows, or on ground, taken to be level, from the
/// ray's elevation.
fn cosine(surface: &Surface, rays: &Rays) -> (Tensor<3>, Tensor<3>) {
    let taken = ground(surface) * (surface.known.clone() * -1.0 + 1.0);
    let level = rays.elevation_rad.clone().sin().abs().clamp_min(0.01) + surface.range_m.zeros_like();
    let cosine = surface.cos_incidence.clone().mask_where(taken.clone().greater_elem(0.5), level);
    (cosine, surface.known.clone() + taken)
}

/// The a of which cosᵃ α is uniform where the image does not show the angle, or shows it wrongly: ln cos α has a mean of −1/a and a variance
/// of 1/a² then.
pub(super) fn uniform(surface: &Surface) -> Tensor<3> {
    let smooth = (surface.known.clone() * -1.0 + 1.0) * (rough(&surface.class) * -1.0 + 1.0);
    smooth * (UNIFORM.smooth - UNIFORM.any) + UNIFORM.any
}

/// Mean and variance of ln cos α.
pub(super) fn log_cosine(surface: &Surface, rays: &Rays) -> (Tensor<3>, Tensor<3>) {
    let (cosine, known) = cosine(surface, rays);
    let spread = (known * -1.0 + 1.0) / uniform(surface);
    // Where nothing is known the cosine is 1.
    (cosine.log() - spread.clone(), spread.square())
}

/// The share of the planes of facades, vehicles and the like, where they end beside their pixel, that are nothing like the surface: reliefs
/// are finer than the rays.
pub(super) const fn strays() -> Parameter {
    Parameter::probability("strays", 0.3, (0.0, 1.0))
}

/// Probability that the cosine of a known angle is nothing like the true one; `strays` is [`strays`]' number.
pub(super) fn astray(surface: &Surface, strays: Tensor<3>) -> Tensor<3> {
    let ground = ground(surface);
    let of_plane = ground.clone() * ASTRAY.ground + (ground.clone() * -1.0 + 1.0) * strays;
    let border = (surface.interior.clone() * -1.0 + 1.0) * surface.known.clone();
    let taken = ground * (surface.known.clone() * -1.0 + 1.0);
    border * of_plane + taken * ASTRAY.level
}

/// Cosine of the angle of incidence, and to what part a film of water would stay: on sealed ground, or where classes are missing, on what
/// is level.
pub(super) fn on_wet_ground(image: &Image) -> (Tensor<3>, Tensor<3>) {
    let surface = &image.surface;
    let up = surface.plane[2].clone().square() / dot(&surface.plane, &surface.plane).clamp_min(1e-12);
    let level = ((up - LEVEL.1) / (LEVEL.0 - LEVEL.1)).clamp(0.0, 1.0) * surface.known.clone();
    let (cosine, _) = cosine(surface, &image.rays);
    (cosine, sealed(surface) + level * surface.class.clone().lower_elem(0.5).float())
}
