//! What rays see that do not look where the description says: a resampling of the range image along local surfaces.
//!
//! A moved ray is given the plane of the nearest ray of the simulation and cut with it, so no surface is invented between two. Where it
//! passes between two rays whose planes meet on the way, at a crease, both planes decide; where one hides the other, an image cannot
//! know where the edge lies: the other surface is kept beside it, with the part of the way there as its probability. Either way what a
//! ray sees changes continuously as it moves.

use burn::tensor::activation::sigmoid;
use burn::tensor::{Bool, Tensor};

use super::aim::{Aim, Pixels};
use super::image::{Image, Other};
use super::passage::Passage;
use super::rays::{Bend, Rays};
use super::surface::{Surface, dot};

/// How far a surface of which no plane is known may be off, per m of the moved ray's displacement. This and the two that follow are half
/// widths at half maximum, chosen on hidden sets: wide tails, for most surfaces are what they seem and a few are nothing like it.
const OFF_UNKNOWN: f64 = 0.1;

/// The same per m by which a likely plane takes its range.
const OFF_LIKELY: f64 = 0.05;

/// The same of a known plane that does not reach beyond its pixel on every side.
const OFF_BORDER: f64 = 0.03;

/// The same per m by which the planes of two neighbouring pixels of one smooth surface give different ranges: that is how much it bends.
const OFF_BEND: f64 = 0.5;

/// Relative error with which two pixels' planes give each other's ranges up to which they are one smooth surface.
const SMOOTH: f64 = 0.02;

/// How often the pixel is looked for that sees what a ray from a moved origin hits. Each time the error falls to about the displacement
/// over the range of what it was.
const PARALLAX_STEPS: usize = 3;

/// Width in m of the farthest range's edge: what lies on a plane beyond it is not hit.
const LIMIT_WIDTH_M: f64 = 0.5;

impl Image {
    /// Spends [`Image::bend`]: looks along the moved rays.
    #[must_use]
    pub fn resample(mut self) -> Self {
        if self.bend.is_none() {
            return self;
        }
        let bend = std::mem::take(&mut self.bend);
        let rays = &self.rays;
        let ray = Ray { directions: rays.directions(&bend), origin: bend.origin_m.clone() };
        let aim = self.aim(&bend, &ray);
        let here = Look::at(&self.surface, &aim.nearest, &ray, rays);
        let there = Look::at(&self.surface, &aim.beside, &ray, rays);
        let (here, other, bend_m) = self.surface.meet(&aim, here, there, rays);

        // How far from the ray of the simulation is the surface seen, and how far has its plane taken it?
        let away_m = here.range_m.clone() * aim.away_rad.clone();
        let taken_m = (here.range_m.clone() - aim.nearest.of(&self.surface.range_m)).abs();
        let [unknown, no_interior] = [&here.known, &here.interior].map(|x| x.clone() * -1.0 + 1.0);
        let of_unknown = (away_m * OFF_UNKNOWN + taken_m.clone() * OFF_LIKELY) * unknown;
        let of_border = taken_m * here.known.clone() * no_interior * OFF_BORDER;
        self.doubt_m = Some(of_unknown + of_border + bend_m * OFF_BEND);
        self.report.range_m = here.range_m.clone();
        self.report.reflectance = here.reflectance.clone();
        let keep = self.report.keep.clone();
        self.report.keep = if keep.dims() == [1, 1, 1] { keep } else { aim.nearest.of(&keep) };
        self.other = Some(other);
        self.passage = bend.origin_m.map(|origin_m| Passage { origin_m, seen_m: self.surface.range_m.clone() });
        self.surface = here;
        self
    }

    /// Where the moved rays look in the image.
    fn aim(&self, bend: &Bend, ray: &Ray) -> Aim {
        let rays = &self.rays;
        let aim = Aim::at(rays.angles(bend), true, rays);
        let Some(origin) = &bend.origin_m else { return aim };
        let fixed = |x: &[Tensor<3>; 3]| x.clone().map(Tensor::detach);
        let still = Ray { directions: fixed(&ray.directions), origin: Some(fixed(origin)) };
        // Gradients are those of the last step, whose range is that of a surface that stays where it is.
        let seen = |directions: &[Tensor<3>; 3], origin: &[Tensor<3>; 3], range_m: &Tensor<3>| {
            let [x, y, z] = directions.clone().map(|u| u * range_m.clone());
            let [dx, dy, dz] = origin.clone();
            Aim::of([x + dx, y + dy, z + dz], rays)
        };
        let mut range_m = still.range_m(&self.surface, &aim.nearest, rays);
        for _ in 1..PARALLAX_STEPS {
            let aim = seen(&still.directions, &fixed(origin), &range_m);
            range_m = still.range_m(&self.surface, &aim.nearest, rays);
        }
        seen(&ray.directions, origin, &range_m)
    }
}

/// Moved rays.
struct Ray {
    directions: [Tensor<3>; 3],
    origin: Option<[Tensor<3>; 3]>,
}

impl Ray {
    /// Range at which they cut planes, and where they do in front of the sensor.
    fn cut(&self, plane: &[Tensor<3>; 3]) -> (Tensor<3>, Tensor<3>) {
        let facing = dot(plane, &self.directions);
        let ahead = match &self.origin {
            None => facing.ones_like(),
            Some(origin) => dot(plane, origin) * -1.0 + 1.0,
        };
        (ahead / facing.clone().clamp_min(1e-4), facing)
    }

    /// Ranges of the surfaces that pixels see, along these rays; the farthest where they see none.
    fn range_m(&self, surface: &Surface, pixels: &Pixels, rays: &Rays) -> Tensor<3> {
        let (cut_m, _) = self.cut(&surface.plane.each_ref().map(|a| pixels.of(a)));
        let seen_m = pixels.of(&surface.range_m);
        let nothing = seen_m.clone().lower_elem(1e-3);
        let range_m = cut_m.clone().mask_where(astray(&cut_m, &seen_m), seen_m);
        range_m.mask_fill(nothing, rays.limits_m.1)
    }
}

/// Where a plane would be followed absurdly far from the pixel that knows it.
fn astray(cut_m: &Tensor<3>, seen_m: &Tensor<3>) -> Tensor<3, Bool> {
    (cut_m.clone() - seen_m.clone()).abs().greater_equal(seen_m.clone() * 0.5 + 0.5)
}

/// What moved rays see of the surfaces of some pixels.
struct Look {
    surface: Surface,
    /// Inverse of the range at which they cut the pixels' planes, in 1/m, however far from the pixels that is.
    inverse: Tensor<3>,
}

impl Look {
    fn at(surface: &Surface, pixels: &Pixels, ray: &Ray, rays: &Rays) -> Self {
        let plane = surface.plane.each_ref().map(|a| pixels.of(a));
        let seen_m = pixels.of(&surface.range_m);
        let known = pixels.of(&surface.known);
        let (cut_m, facing) = ray.cut(&plane);
        // A plane that the ray leaves behind, or meets beyond what the sensor sees, is not hit.
        let within = sigmoid((cut_m.clone() * -1.0 + rays.limits_m.1) * (1.0 / LIMIT_WIDTH_M));
        let hit = pixels.of(&surface.hit) * within * cut_m.clone().greater_elem(0.0).float();
        let astray = astray(&cut_m, &seen_m);
        let size = dot(&plane, &plane).clamp_min(1e-12).sqrt();
        let cosine = (facing / size).clamp(0.01, 1.0);
        let cos_incidence = pixels.of(&surface.cos_incidence).mask_where(known.clone().greater_elem(0.5), cosine);
        let surface = Surface {
            range_m: cut_m.clone().mask_where(astray, seen_m),
            hit,
            reflectance: pixels.of(&surface.reflectance),
            class: pixels.of(&surface.class),
            plane,
            known,
            cos_incidence,
            interior: pixels.of(&surface.interior),
            alike: pixels.of(&surface.alike),
        };
        Self { surface, inverse: cut_m.clamp_min(1e-3).recip() }
    }
}

impl Surface {
    /// What rays see that pass between what they would see `here` and `there`, the surfaces of the two pixels of their places: where
    /// both belong to one smooth surface, what lies between; where they meet in a crease, the nearer of two that are hollow and the
    /// farther of two that bulge. And by how much, in m, smooth surfaces bend on the way.
    fn meet(&self, aim: &Aim, here: Look, there: Look, rays: &Rays) -> (Self, Other, Tensor<3>) {
        let between_m =
            (here.inverse.clone() + (there.inverse.clone() - here.inverse.clone()) * aim.part.clone()).recip();
        // However far from its pixel that is: where a wall rises from the ground, the ground goes on behind it.
        let there_farther = there.inverse.clone().lower(here.inverse.clone()).float() * 2.0 - 1.0;
        let apart_m = (here.inverse.clone().recip() - there.inverse.clone().recip()).abs() * aim.part.clone();
        let there_m = there.inverse.recip();
        let (here, there) = (here.surface, there.surface);
        let point = rays.directions(&Bend::default()).map(|u| u * self.range_m.clone());
        let of = |pixels: &Pixels, plane: &[Tensor<3>; 3]| dot(plane, &point.each_ref().map(|x| pixels.of(x))) - 1.0;
        // By how much, relatively, each plane is nearer than the other at the other's pixel.
        let (there_nearer, here_nearer) = (of(&aim.nearest, &there.plane), of(&aim.beside, &here.plane));
        let apart = there_nearer.clone().abs().max_pair(here_nearer.clone().abs());
        let known = here.known.clone() * there.known.clone();
        let smooth = (apart.lower_elem(SMOOTH).float() * known.clone()).greater_elem(0.5);
        let crease = (there_nearer.clone() * here_nearer).greater_elem(0.0).float() * known;
        let crease = crease.mask_fill(smooth.clone(), 0.0).greater_elem(0.5);
        let bulging = there_nearer.greater_elem(0.0).float() * 2.0 - 1.0;
        let swap = (there_farther * bulging.clone()).greater_elem(0.0).bool_and(crease.clone());
        let absurd = astray(&there_m, &aim.beside.of(&self.range_m)).bool_and(bulging.greater_elem(0.0));
        let swap = swap.bool_and(absurd.bool_not());
        let bend_m = apart_m * smooth.clone().float();

        let beyond = Self { range_m: there_m, ..there.clone() };
        let which = here.clone().or(&swap, beyond);
        let range_m = which.range_m.mask_where(smooth.clone(), between_m);
        let met = Self { range_m, known: here.known, interior: here.interior, alike: here.alike, ..which };
        let there = there.or(&crease, met.clone());
        let range_m = there.range_m.mask_where(smooth, met.range_m.clone());
        let other = Other { surface: Self { range_m, ..there }, weight: aim.part.clone() };
        (met, other, bend_m)
    }
}
