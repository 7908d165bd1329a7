//! Media types of scans, and which one an answer has.

use lidar::formats::Format;
use serde::{Deserialize, Serialize, Serializer};
use thiserror::Error;

/// A media type by which a scan travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct MediaType {
    /// The type's name, in lower case.
    pub name: &'static str,
    /// The format of the bytes; in JSON the ending of its files' names.
    #[serde(rename = "extension", serialize_with = "extension")]
    pub format: Format,
    /// The frame of a body of this type, unless the query names another.
    pub frame: Frame,
}

/// The axes in which a scan's coordinates are given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// Right-handed: x ahead, y left, z up.
    #[default]
    Ros,
    /// Left-handed, as CARLA and Unreal: x ahead, y right, z up.
    Carla,
}

/// Every type that the service reads and writes; the first one is the default.
///
/// The types named after CARLA hold what its sensors give (`raw_data`), in CARLA's frame.
pub const MEDIA_TYPES: [MediaType; 13] = [
    MediaType::ros("application/octet-stream", Format::Kitti),
    MediaType::ros("application/vnd.kitti.bin", Format::Kitti),
    MediaType::carla("application/vnd.carla.lidar", Format::Kitti),
    MediaType::ros("application/vnd.nuscenes.bin", Format::NuScenes),
    MediaType::carla("application/vnd.carla.semantic-lidar", Format::CarlaSemantic),
    MediaType::ros("model/x-ply", Format::Ply),
    MediaType::ros("application/ply", Format::Ply),
    MediaType::ros("application/vnd.las", Format::Las),
    MediaType::ros("application/vnd.laz", Format::Laz),
    MediaType::ros("application/x-pcd", Format::Pcd),
    MediaType::ros("application/x-npy", Format::Npy),
    MediaType::ros("application/x-npz", Format::Npz),
    MediaType::ros("application/cdr", Format::PointCloud2),
];

/// What an answer to a scan shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The realistic scan, in a format.
    Scan(Format),
    /// The range images before and after beside each other, as PNG.
    Picture,
    /// Every point before and after, and what became of it, as JSON.
    Points,
    /// The same without the names: ten little-endian float32 a point, as `GET /` takes them.
    PointRecords,
}

/// A media type by which an answer travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnswerType {
    /// The type's name, in lower case.
    pub name: &'static str,
    /// What the answer shows.
    pub form: Form,
}

/// Types of answers that are no scans. A wildcard means one of them only where it covers no type of [`MEDIA_TYPES`].
pub const VIEW_TYPES: [AnswerType; 3] = [
    AnswerType { name: "image/png", form: Form::Picture },
    AnswerType { name: "application/json", form: Form::Points },
    AnswerType { name: "application/vnd.realbeam.points", form: Form::PointRecords },
];

/// A `Content-Type` that is none of [`MEDIA_TYPES`].
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("content type `{found}` is not known; there are {}", names(&MEDIA_TYPES.map(AnswerType::from)))]
pub struct UnknownMediaType {
    /// The type without its parameters.
    pub found: String,
}

/// An `Accept` header that no type of [`MEDIA_TYPES`] or [`VIEW_TYPES`] meets.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("none of the accepted types `{accept}` can be given; there are {}", names(&answer_types()))]
pub struct NotAcceptable {
    /// The header.
    pub accept: String,
}

impl MediaType {
    const fn ros(name: &'static str, format: Format) -> Self {
        Self { name, format, frame: Frame::Ros }
    }

    const fn carla(name: &'static str, format: Format) -> Self {
        Self { name, format, frame: Frame::Carla }
    }

    /// The type that a `Content-Type` header names; parameters after `;` are ignored, no header means the default.
    pub fn of_content(header: Option<&str>) -> Result<Self, UnknownMediaType> {
        let Some(header) = header else { return Ok(MEDIA_TYPES[0]) };
        let found = header.split(';').next().unwrap_or_default().trim().to_ascii_lowercase();
        MEDIA_TYPES.into_iter().find(|media| media.name == found).ok_or(UnknownMediaType { found })
    }

    /// The first type of a format.
    pub fn of_format(format: Format) -> Self {
        // Every format has one, as a test proves.
        MEDIA_TYPES.into_iter().find(|media| media.format == format).unwrap_or(MEDIA_TYPES[0])
    }

    /// The type of the answer to a body of this type: the one that the `Accept` header weighs highest (RFC 9110, 12.5.1: of several
    /// ranges that cover a type the most specific one counts, `q=0` excludes). Among equals a type named in full goes before a
    /// wildcard, then the body's own type before others, then the one named first. No header means the body's own type.
    pub fn negotiate(self, accept: Option<&str>) -> Result<AnswerType, NotAcceptable> {
        let own = AnswerType::from(self);
        let Some(accept) = accept.filter(|a| !a.trim().is_empty()) else { return Ok(own) };
        let ranges: Vec<Range<'_>> = accept.split(',').filter_map(Range::parse).collect();
        let weigh = |media: AnswerType| {
            let covering = ranges.iter().enumerate().filter(|(_, range)| range.covers(media.name));
            let (place, range) = covering.max_by_key(|(place, range)| (range.specificity(), usize::MAX - place))?;
            // Weights have at most three decimals.
            let weight = (range.weight * 1000.0).round() as u32;
            (weight > 0).then_some((weight, range.specificity(), media == own, usize::MAX - place))
        };
        let weighed = answer_types().into_iter().rev().filter_map(|media| Some((weigh(media)?, media)));
        let best = weighed.max_by_key(|(weight, _)| *weight).map(|(_, media)| media);
        best.ok_or_else(|| NotAcceptable { accept: accept.into() })
    }
}

/// One entry of an `Accept` header, such as `application/*;q=0.5`.
struct Range<'a> {
    kind: &'a str,
    subtype: &'a str,
    weight: f32,
}

impl<'a> Range<'a> {
    fn parse(text: &'a str) -> Option<Self> {
        let mut parts = text.split(';');
        let (kind, subtype) = parts.next()?.trim().split_once('/')?;
        let weight = parts.find_map(|p| p.trim().strip_prefix("q=").or(p.trim().strip_prefix("Q=")));
        let weight = weight.map_or(Some(1.0), |q| q.trim().parse().ok().filter(|q| (0.0..=1.0).contains(q)))?;
        Some(Self { kind, subtype, weight })
    }

    fn covers(&self, name: &str) -> bool {
        let Some((kind, subtype)) = name.split_once('/') else { return false };
        let matches = |pattern: &str, value: &str| pattern == "*" || pattern.eq_ignore_ascii_case(value);
        matches(self.kind, kind) && matches(self.subtype, subtype)
    }

    fn specificity(&self) -> u8 {
        u8::from(self.kind != "*") + u8::from(self.subtype != "*")
    }
}

impl From<MediaType> for AnswerType {
    fn from(media: MediaType) -> Self {
        Self { name: media.name, form: Form::Scan(media.format) }
    }
}

// The signature is serde's.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn extension<S: Serializer>(format: &Format, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(format.extension())
}

/// Every type of an answer, scans first.
fn answer_types() -> Vec<AnswerType> {
    MEDIA_TYPES.into_iter().map(AnswerType::from).chain(VIEW_TYPES).collect()
}

fn names(types: &[AnswerType]) -> String {
    types.iter().map(|media| media.name).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content(header: &str) -> Result<MediaType, UnknownMediaType> {
        MediaType::of_content(Some(header))
    }

    #[test]
    fn parameters_and_case_do_not_matter() -> Result<(), UnknownMediaType> {
        assert_eq!(MediaType::of_content(None)?.format, Format::Kitti);
        assert_eq!(content("Model/X-PLY; charset=binary")?.format, Format::Ply);
        assert_eq!(content("application/vnd.carla.lidar")?.frame, Frame::Carla);
        assert!(content("text/html").is_err_and(|e| e.to_string().contains("`text/html`")));
        Ok(())
    }

    #[test]
    fn every_format_has_a_type() {
        for format in Format::ALL {
            assert_eq!(MediaType::of_format(format).format, format);
        }
        assert_eq!(MediaType::of_format(Format::Kitti).frame, Frame::Ros);
        assert_eq!(MediaType::of_format(Format::CarlaSemantic).frame, Frame::Carla);
    }

    #[test]
    fn the_answer_has_the_type_that_is_weighed_highest() -> Result<(), Box<dyn std::error::Error>> {
        let pcd = content("application/x-pcd")?;
        let answer = |accept: &str| pcd.negotiate(Some(accept)).map(|media| media.name);
        assert_eq!(answer("*/*"), Ok("application/x-pcd"));
        assert_eq!(answer("text/html, */*;q=0.1"), Ok("application/x-pcd"));
        assert_eq!(answer("application/x-npy, model/x-ply"), Ok("application/x-npy"));
        assert_eq!(answer("application/x-npy, application/x-pcd"), Ok("application/x-pcd"));
        assert_eq!(answer("model/x-ply, */*"), Ok("model/x-ply"));
        assert_eq!(answer("application/x-npy;q=0.2, model/x-ply;q=0.9"), Ok("model/x-ply"));
        assert_eq!(answer("model/*"), Ok("model/x-ply"));
        assert_eq!(answer("application/*, application/x-pcd;q=0"), Ok("application/octet-stream"));
        assert!(answer("image/jpeg").is_err());
        assert!(answer("*/*;q=0").is_err());
        assert_eq!(pcd.negotiate(None)?, pcd.into());
        Ok(())
    }

    #[test]
    fn a_view_is_given_where_it_is_named_or_nothing_else_is_covered() -> Result<(), Box<dyn std::error::Error>> {
        let pcd = content("application/x-pcd")?;
        let answer = |accept: &str| pcd.negotiate(Some(accept)).map(|media| media.name);
        assert_eq!(answer("image/png"), Ok("image/png"));
        assert_eq!(answer("image/*"), Ok("image/png"));
        assert_eq!(answer("image/*;q=0.9, */*;q=0.8"), Ok("image/png"));
        assert_eq!(answer("application/json, */*"), Ok("application/json"));
        assert_eq!(answer("application/json;q=0.5, model/x-ply"), Ok("model/x-ply"));
        assert_eq!(answer("application/*"), Ok("application/x-pcd"));
        assert!(answer("image/png;q=0").is_err());
        Ok(())
    }
}
