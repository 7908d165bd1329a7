//! What scans of different places cannot show, and why.

use serde::Serialize;

/// An effect of the library that leaves no trace in distributions by strata, or one that real places leave too.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Unseen {
    /// The effect.
    pub name: &'static str,
    /// Why it cannot be seen.
    pub why: &'static str,
}

const fn unseen(name: &'static str, why: &'static str) -> Unseen {
    Unseen { name, why }
}

const EDGES: &str = "turned rays show at vertical edges alone, and where an edge truly is, only a twin says";
const LEAN: &str = "the road leans and the car does: only a twin knows the ground below the sensor";
const LENGTH: &str = "how far a surface truly is, only a twin says";
const STRAY: &str = "a return out of nowhere and one of a thing that no plane fits look alike without a twin";

/// Every effect of the library that is not tried.
pub const CANNOT_BE_SEEN: &[Unseen] = &[
    unseen(
        "elevation_offset",
        "single scans cannot tell it from domed ground; `elevation` measures it where scans see the same ground twice",
    ),
    unseen(
        "elevation_offset_per_ring",
        "the ground's own bumps under a ring are larger than what its offset does, unless a twin shows them",
    ),
    unseen("azimuth_offset_per_ring", EDGES),
    unseen("encoder_eccentricity", EDGES),
    unseen("rolling_shutter", EDGES),
    unseen("mount_yaw", "which way the street runs is the place's, not the sensor's"),
    unseen("mount_pitch", LEAN),
    unseen("mount_roll", LEAN),
    unseen(
        "mount_height",
        "the height of the ground below the sensor is the height of the mount as well as of the road",
    ),
    unseen("range_offset", LENGTH),
    unseen(
        "range_offset_per_ring",
        "a few centimetres between rings are less than walls and ground differ from planes",
    ),
    unseen("range_scale", LENGTH),
    unseen("range_walk", "a bias of centimetres by brightness is hidden by what bright and dark things are made of"),
    unseen("range_noise", "how rough real surfaces are is not known; the noise floor counts roughness as noise"),
    unseen("incidence_stretch", LENGTH),
    unseen("mixed_pixels", "a return between two surfaces may be a third one"),
    unseen("quantisation", "the comb of rounded ranges is in single numbers, not in means by strata"),
    unseen(
        "reflectance_gain",
        "how bright the places are is not known: a gain of all rings and darker streets are the same",
    ),
    unseen("saturation", "how bright the brightest surfaces truly are, only a twin says"),
    unseen("specular", "wet ground and dark ground are told apart by a twin of the same ground alone"),
    unseen("fog", "its fading shows as a fall-off with range, under that name"),
    unseen("drift", "a place's change along the drive and the sensor's change in time are the same"),
    unseen("blocked_sector", "what stands beside the road empties sectors too, in every scan of a drive along it"),
    unseen("range_limits", "how far or near the surfaces of a place are is not known"),
    unseen("random_returns", STRAY),
    unseen("precipitation", STRAY),
    unseen("blooming", STRAY),
];
