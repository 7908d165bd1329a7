//! The surface that each ray hits, as a plane found from neighbouring rays.
//!
//! On a plane a·x = 1 a ray o + r·u has r = (1 − a·o)/(a·u): inverse range is linear in the ray's direction. Each pixel proposes the
//! planes through itself, one vertical and one horizontal neighbour; the pixels around vote for the planes that they lie on, and the
//! plane with the most votes is taken: the consensus of Fischler and Bolles, "Random sample consensus" (1981), with every sample tried.
//! So a plane reaches up to its edges, and none is laid across them.

use burn::tensor::{Bool, Tensor};

use super::neighbours::at;
use super::rays::{Bend, Rays};

/// Relative error of a neighbour's range at which its vote counts half.
const HALF_A_VOTE: f64 = 0.01;

/// Votes from which on a plane is believed.
const ENOUGH_VOTES: f64 = 0.8;

/// Votes along a row times votes along a column, either at most 1, from which on a plane is believed to span both. Two parallel edges
/// at different depths lie on a plane too, but nothing beyond them does.
const ENOUGH_SPAN: f64 = 0.4;

/// Votes that a plane loses for each pixel of another class that it is laid through.
const OTHER_CLASS: f64 = 1.5;

/// Cosine of the incidence angle from which on a plane that only votes along one line span is believed, if it stays within a class: of
/// level planes below the sensor, and of others, of which many join two edges.
const STEEP: (f64, f64) = (0.02, 0.15);

/// Squared cosine of a level plane's slope.
const LEVEL: f64 = 0.9;

/// Relative error of a neighbour's range up to which it is on a pixel's plane.
const ON_PLANE: f64 = 0.005;

/// Classes of what is rounder and finer than the rays are wide, so that no plane of it is known: vegetation, trunk; pole.
const ROUGH: (f64, f64) = (15.0, 16.0);
const POLE: f64 = 18.0;

/// Cosine of the incidence angle below which a plane is an artefact: it runs along the ray.
const GRAZING: f64 = 0.004;

/// Distance from a neighbour's plane, as a share of the sensor's distance from it, up to which a surface may be parallel to it: a kerb's.
const PARALLEL: f64 = 0.15;

/// What each ray hits; tensors are `[batch, ring, column]`.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Range in m, 0 where nothing is hit.
    pub range_m: Tensor<3>,
    /// 1 where something is hit, else 0.
    pub hit: Tensor<3>,
    /// Reflectance, 0–1.
    pub reflectance: Tensor<3>,
    /// Class index, 0 = unlabelled.
    pub class: Tensor<3>,
    /// The plane a·x = 1 through the hit, in 1/m: ahead, left, up. Where none is known, the one that is parallel to a known one close by,
    /// as a kerb's is to the road; else the one that faces the ray.
    pub plane: [Tensor<3>; 3],
    /// 1 where the plane is known from the neighbours, else 0.
    pub known: Tensor<3>,
    /// Cosine of the angle between the ray and the plane's normal, 0.01 to 1.
    pub cos_incidence: Tensor<3>,
    /// 1 where the pixels all around lie on the same plane, or where neither they nor this one hit anything; else 0.
    pub interior: Tensor<3>,
    /// 1 where the pixels all around hit something and so does this one, or where none does; else 0.
    pub alike: Tensor<3>,
}

/// A plane that a pixel might lie on.
struct Candidate {
    plane: [Tensor<3>; 3],
    votes: Tensor<3>,
    believed: Tensor<3>,
}

impl Surface {
    /// Finds the surfaces of a scan.
    pub fn find(range_m: Tensor<3>, reflectance: Tensor<3>, class: Tensor<3>, rays: &Rays) -> Self {
        let hit = range_m.clone().greater_elem(0.0).float();
        let directions = rays.directions(&Bend::default());
        let point = directions.clone().map(|u| u * range_m.clone());
        let seen = Seen::new(point.clone(), &range_m, &class);
        let up_left = seen.candidate(-1, -1);
        let best = up_left.or(seen.candidate(-1, 1)).or(seen.candidate(1, -1)).or(seen.candidate(1, 1));

        let known = best.believed * hit.clone() * (rough(&class) * -1.0 + 1.0);
        let unknown = known.clone().equal_elem(0.0);
        let inverse = hit.clone() / range_m.clone().clamp_min(1e-3);
        let facing = directions.map(|u| u * inverse.clone());
        let likely = parallel(&best.plane, &known, &point, facing);
        let plane = choose(&unknown, best.plane, likely);
        let size = dot(&plane, &plane).clamp_min(1e-12).sqrt();
        let cos_incidence = (inverse / size).mask_fill(unknown, 1.0).clamp(0.01, 1.0);
        let alike = all_around(|place| alike(&hit, place));
        let interior = all_around(|place| on_plane(&plane, &point, &hit, place)) * alike.clone();
        let interior = interior * (known.clone() - hit.clone() + 1.0);
        Self { range_m, hit, reflectance, class, plane, known, cos_incidence, interior, alike }
    }

    /// The second where a mask holds, else the first.
    #[must_use]
    pub(super) fn or(self, mask: &Tensor<3, Bool>, second: Self) -> Self {
        let which = |first: Tensor<3>, second: Tensor<3>| first.mask_where(mask.clone(), second);
        Self {
            range_m: which(self.range_m, second.range_m),
            hit: which(self.hit, second.hit),
            reflectance: which(self.reflectance, second.reflectance),
            class: which(self.class, second.class),
            plane: choose(mask, self.plane, second.plane),
            known: which(self.known, second.known),
            cos_incidence: which(self.cos_incidence, second.cos_incidence),
            interior: which(self.interior, second.interior),
            alike: which(self.alike, second.alike),
        }
    }

    /// Height of the hit above the sensor, in m.
    pub fn height_m(&self, rays: &Rays) -> Tensor<3> {
        self.range_m.clone() * rays.elevation_rad.clone().sin()
    }
}

/// 1 on leaves, trunks and poles, as far as the classes say; 0 elsewhere.
pub(super) fn rough(class: &Tensor<3>) -> Tensor<3> {
    class.clone().greater_elem(ROUGH.0 - 0.5).float() * class.clone().lower_elem(ROUGH.1 + 0.5).float()
        + (class.clone() - POLE).abs().lower_elem(0.5).float()
}

/// For each pixel the plane through it that is parallel to the known plane, among its neighbours', that it is nearest to; `facing` where
/// it is near none.
fn parallel(
    planes: &[Tensor<3>; 3],
    known: &Tensor<3>,
    point: &[Tensor<3>; 3],
    facing: [Tensor<3>; 3],
) -> [Tensor<3>; 3] {
    let mut nearest = (known.zeros_like() + PARALLEL, facing);
    for (down, right) in [(1, 0), (-1, 0), (0, 1), (0, -1), (2, 0), (-2, 0), (0, 2), (0, -2)] {
        let plane = beside(planes, down, right);
        let at_pixel = dot(&plane, point);
        let unknown = at(known, down, right, 0.0).lower_elem(0.5);
        let distance = (at_pixel.clone() - 1.0).abs().mask_fill(unknown, f64::INFINITY);
        let nearer = distance.clone().lower(nearest.0.clone());
        let through = plane.map(|a| a / at_pixel.clone().clamp_min(0.5));
        nearest = (nearest.0.mask_where(nearer.clone(), distance), choose(&nearer, nearest.1, through));
    }
    nearest.1
}

/// The product over the eight pixels around, each by its place: down, right.
fn all_around(of: impl Fn([i64; 2]) -> Tensor<3>) -> Tensor<3> {
    let around = [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1], [1, -1], [1, 0], [1, 1]];
    around.into_iter().map(of).reduce(|a, b| a * b).unwrap_or_else(|| unreachable!("eight neighbours"))
}

/// 1 where the pixel beside hits something and so does this one, or neither; and beyond the first and the last ring.
fn alike(hit: &Tensor<3>, [down, right]: [i64; 2]) -> Tensor<3> {
    const OUTSIDE: f64 = -1.0;
    let there = at(hit, down, right, OUTSIDE);
    let outside = there.clone().lower_elem(0.0).float();
    (there - hit.clone()).abs().lower_elem(0.5).float().max_pair(outside)
}

/// 1 where the pixel beside is on the plane, or nothing is hit; and beyond the first and the last ring.
fn on_plane(plane: &[Tensor<3>; 3], point: &[Tensor<3>; 3], hit: &Tensor<3>, [down, right]: [i64; 2]) -> Tensor<3> {
    let error = (dot(plane, &beside(point, down, right)) - 1.0).abs();
    let outside = at(hit, down, right, -1.0).lower_elem(0.0).float();
    error.lower_elem(ON_PLANE).float().max_pair(hit.clone() * -1.0 + 1.0).max_pair(outside)
}

/// What a pixel's neighbours are judged by.
struct Seen<'a> {
    point: [Tensor<3>; 3],
    range_m: &'a Tensor<3>,
    class: &'a Tensor<3>,
    diagonal: [[Tensor<3>; 3]; 4],
}

impl<'a> Seen<'a> {
    fn new(point: [Tensor<3>; 3], range_m: &'a Tensor<3>, class: &'a Tensor<3>) -> Self {
        let diagonal = [(-1, -1), (-1, 1), (1, -1), (1, 1)].map(|(down, right)| beside(&point, down, right));
        Self { point, range_m, class, diagonal }
    }

    /// The plane through a pixel, the one above or below and the one on the left or right, and who votes for it.
    fn candidate(&self, down: i64, right: i64) -> Candidate {
        let to = |down, right| {
            let [x, y, z] = beside(&self.point, down, right);
            let [px, py, pz] = self.point.clone();
            [x - px, y - py, z - pz]
        };
        let normal = cross(&to(down, 0), &to(0, right));
        let offset = dot(&normal, &self.point);
        let size = dot(&normal, &normal).clamp_min(1e-30).sqrt();
        let cosine = offset.clone().abs() / (size.clone() * self.range_m.clone().clamp_min(1e-3));
        let grazing = cosine.clone().lower_elem(GRAZING);
        let offset = offset.mask_fill(grazing.clone(), 1.0);
        let plane = normal.clone().map(|n| n / offset.clone());

        // A pixel without a return is at the origin, which lies on no plane a·x = 1: it has no vote, and no plane goes through it.
        let vote = |at: &[Tensor<3>; 3]| {
            let error = (dot(&plane, at) - 1.0) * (1.0 / HALF_A_VOTE);
            (error.square() + 1.0).recip()
        };
        let vote_at = |down, right| vote(&beside(&self.point, down, right));
        let column = vote_at(-down, 0) + vote_at(2 * down, 0);
        let row = vote_at(0, -right) + vote_at(0, 2 * right);
        let span = column.clone().clamp_max(1.0) * row.clone().clamp_max(1.0);
        let [a, b, c, d] = self.diagonal.each_ref().map(vote);
        let elsewhere = self.elsewhere(down, 0) + self.elsewhere(0, right);
        let votes = column + row + a + b + c + d + span.clone() - elsewhere.clone() * OTHER_CLASS;
        let level = (normal[2].clone().square() / (size.clone() * size.clone())).greater_elem(LEVEL).float();
        let level = level * self.point[2].clone().lower_elem(0.0).float();
        let steep =
            cosine.clone().greater(level * (STEEP.0 - STEEP.1) + STEEP.1).float() * elsewhere.lower_elem(0.5).float();
        let spans = (span.greater_elem(ENOUGH_SPAN).float() + steep).clamp_max(1.0);
        let believed = spans * votes.clone().greater_elem(ENOUGH_VOTES).float();
        Candidate { plane, votes: votes.mask_fill(grazing, -9.0), believed }
    }

    /// 1 where the pixel beside is of another class.
    fn elsewhere(&self, down: i64, right: i64) -> Tensor<3> {
        (at(self.class, down, right, -1.0) - self.class.clone()).abs().greater_elem(0.5).float()
    }
}

impl Candidate {
    /// The better of two, pixel by pixel.
    fn or(self, other: Self) -> Self {
        let worse = self.votes.clone().lower(other.votes.clone());
        Self {
            plane: choose(&worse, self.plane, other.plane),
            votes: self.votes.mask_where(worse.clone(), other.votes),
            believed: self.believed.mask_where(worse, other.believed),
        }
    }
}

/// The points of the pixels beside.
fn beside(point: &[Tensor<3>; 3], down: i64, right: i64) -> [Tensor<3>; 3] {
    point.each_ref().map(|x| at(x, down, right, 0.0))
}

/// The second vector where a mask holds, else the first.
pub(crate) fn choose(mask: &Tensor<3, Bool>, first: [Tensor<3>; 3], second: [Tensor<3>; 3]) -> [Tensor<3>; 3] {
    let [x, y, z] = first;
    let [ox, oy, oz] = second;
    [x.mask_where(mask.clone(), ox), y.mask_where(mask.clone(), oy), z.mask_where(mask.clone(), oz)]
}

/// Scalar product.
pub(crate) fn dot(a: &[Tensor<3>; 3], b: &[Tensor<3>; 3]) -> Tensor<3> {
    let [x, y, z] = [0, 1, 2].map(|i| a[i].clone() * b[i].clone());
    x + y + z
}

fn cross(a: &[Tensor<3>; 3], b: &[Tensor<3>; 3]) -> [Tensor<3>; 3] {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| a[i].clone() * b[j].clone() - a[j].clone() * b[i].clone())
}
