//! What is odd about a scan and yet no error, added up over a set.

use std::collections::BTreeMap;

/// Something noticed in one scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Notice {
    RingsByOrder,
    RingsByElevation,
    RingsRenumbered,
    OffRays,
    ColumnsDrift,
    AtOrigin,
    OutOfRange,
    OutsideView,
    TooBright,
    WholeIntensity,
    NoIntensity,
}

impl Notice {
    fn text(self, points: usize) -> String {
        match self {
            Self::RingsByOrder => "have no ring field: rings are told by the order of the points".into(),
            Self::RingsByElevation => "have no ring field: rings are told by elevation".into(),
            Self::RingsRenumbered => {
                "number their rings otherwise than sensor.toml: rings are matched by elevation".into()
            }
            Self::OffRays => format!("have points beside their ring's elevation ({points} of those looked at)"),
            Self::ColumnsDrift => "step a little wider or narrower in azimuth than sensor.toml's columns".into(),
            Self::AtOrigin => format!("have points at the origin ({points} left out)"),
            Self::OutOfRange => format!("have points nearer or farther than the sensor sees ({points} left out)"),
            Self::OutsideView => format!("have points above or below every ring ({points} left out)"),
            Self::TooBright => format!("have intensities above 1 ({points} cut to 1)"),
            Self::WholeIntensity => {
                "have whole numbers as intensities: taken as 0–255, or 0–65535 where they are larger".into()
            }
            Self::NoIntensity => "have no intensity but 0: nothing can be said on reflectance".into(),
        }
    }
}

/// One line for each kind of notice: how many of the `half`'s scans, how many points.
pub(super) fn notes<'a>(half: &str, scans: impl ExactSizeIterator<Item = &'a [(Notice, usize)]>) -> Vec<String> {
    let of = scans.len();
    let mut sums: BTreeMap<Notice, (usize, usize)> = BTreeMap::new();
    for (notice, points) in scans.flatten() {
        let sum = sums.entry(*notice).or_default();
        *sum = (sum.0 + 1, sum.1 + points);
    }
    sums.into_iter()
        .map(|(notice, (scans, points))| format!("{half}: {scans} of {of} scans {}", notice.text(points)))
        .collect()
}
