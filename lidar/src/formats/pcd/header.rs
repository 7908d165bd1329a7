//! The header of a PCD file.

use super::{Field, FormatError, NumberType};
use crate::formats::input::Input;
use crate::formats::record::full_scale_note;

/// A header longer than this describes no scan.
const MAX_HEADER_BYTES: usize = 1 << 16;

/// How the body is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Data {
    Ascii,
    Binary,
    Compressed,
}

#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) fields: Vec<Field>,
    pub(super) points: u128,
    /// Where the header says how many points there are.
    pub(super) points_offset: usize,
    pub(super) data: Data,
    /// The intensity that means 1, from our own comment.
    pub(super) full_scale: Option<f32>,
    pub(super) body_offset: usize,
}

/// A header line's words after its key, and where the line is.
type Line<'a> = (Vec<&'a str>, usize);

#[derive(Default)]
struct Lines<'a> {
    fields: Line<'a>,
    sizes: Line<'a>,
    types: Line<'a>,
    counts: Line<'a>,
    width: Option<(u128, usize)>,
    height: Option<(u128, usize)>,
    points: Option<(u128, usize)>,
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        let mut input = Input::new(bytes);
        let mut lines = Lines::default();
        let mut full_scale = None;
        let data = loop {
            let offset = input.position();
            let line = input.line("header", MAX_HEADER_BYTES)?;
            if let Some(comment) = line.trim_start().strip_prefix('#') {
                full_scale = full_scale_note(comment).or(full_scale);
                continue;
            }
            let mut words = line.split_ascii_whitespace();
            let key = words.next().unwrap_or_default();
            let words: Vec<&str> = words.collect();
            match key {
                "" | "VERSION" | "VIEWPOINT" => {}
                "FIELDS" | "COLUMNS" => lines.fields = (words, offset),
                "SIZE" => lines.sizes = (words, offset),
                "TYPE" => lines.types = (words, offset),
                "COUNT" => lines.counts = (words, offset),
                "WIDTH" => lines.width = Some((parse_count(key, &words, offset)?, offset)),
                "HEIGHT" => lines.height = Some((parse_count(key, &words, offset)?, offset)),
                "POINTS" => lines.points = Some((parse_count(key, &words, offset)?, offset)),
                "DATA" => break parse_data(&words, offset)?,
                _ => return Err(FormatError::field("header", offset, "a line of a PCD header", line)),
            }
        };
        let body_offset = input.position();
        let (points, points_offset) = lines.point_count(body_offset)?;
        Ok(Self { fields: lines.into_fields()?, points, points_offset, data, full_scale, body_offset })
    }
}

impl Lines<'_> {
    fn point_count(&self, end: usize) -> Result<(u128, usize), FormatError> {
        let area = |width: u128, height: u128| width.saturating_mul(height);
        let points = match (self.points, self.width, self.height) {
            (Some(points), Some((width, offset)), Some((height, _))) if area(width, height) != points.0 => {
                let expected = format!("WIDTH × HEIGHT = POINTS = {}", points.0);
                return Err(FormatError::field("WIDTH", offset, expected, format!("{width} × {height}")));
            }
            (Some(points), _, _) => points,
            (None, Some((width, offset)), height) => (area(width, height.map_or(1, |(height, _)| height)), offset),
            (None, None, _) => return Err(FormatError::field("POINTS", end, "a line before DATA", "none")),
        };
        Ok(points)
    }

    fn into_fields(self) -> Result<Vec<Field>, FormatError> {
        let (names, _) = self.fields;
        let same = |key: &str, line: &Line<'_>| {
            if line.0.len() == names.len() {
                return Ok(());
            }
            Err(FormatError::field(key, line.1, format!("{} words, one a field", names.len()), line.0.len()))
        };
        same("SIZE", &self.sizes)?;
        same("TYPE", &self.types)?;
        if !self.counts.0.is_empty() {
            same("COUNT", &self.counts)?;
        }
        let field = |(i, name): (usize, &&str)| {
            let (size, kind) = (self.sizes.0[i], self.types.0[i]);
            let number_type = parse_type(kind, size).ok_or_else(|| {
                let found = format!("{kind}{size} for `{name}`");
                FormatError::field("TYPE", self.types.1, "I, U or F of 1, 2, 4 or 8 bytes", found)
            })?;
            let count = match self.counts.0.get(i) {
                Some(count) => usize::try_from(parse_count("COUNT", &[*count], self.counts.1)?).unwrap_or(usize::MAX),
                None => 1,
            };
            Ok(Field { name: (*name).into(), number_type, count })
        };
        names.iter().enumerate().map(field).collect()
    }
}

/// A count of any size that is written: the limits refuse it, not the parser.
fn parse_count(key: &str, words: &[&str], offset: usize) -> Result<u128, FormatError> {
    match words {
        [word] if word.bytes().all(|byte| byte.is_ascii_digit()) => Ok(word.parse().unwrap_or(u128::MAX)),
        _ => Err(FormatError::field(key, offset, "a count", words.join(" "))),
    }
}

fn parse_data(words: &[&str], offset: usize) -> Result<Data, FormatError> {
    match words {
        ["ascii"] => Ok(Data::Ascii),
        ["binary"] => Ok(Data::Binary),
        ["binary_compressed"] => Ok(Data::Compressed),
        _ => Err(FormatError::field("DATA", offset, "ascii, binary or binary_compressed", words.join(" "))),
    }
}

fn parse_type(kind: &str, size: &str) -> Option<NumberType> {
    Some(match (kind, size) {
        ("I", "1") => NumberType::I8,
        ("U", "1") => NumberType::U8,
        ("I", "2") => NumberType::I16,
        ("U", "2") => NumberType::U16,
        ("I", "4") => NumberType::I32,
        ("U", "4") => NumberType::U32,
        ("I", "8") => NumberType::I64,
        ("U", "8") => NumberType::U64,
        ("F", "4") => NumberType::F32,
        ("F", "8") => NumberType::F64,
        _ => return None,
    })
}

/// The letter of a type; its size is another line.
pub(super) fn type_letter(number_type: NumberType) -> &'static str {
    match number_type {
        NumberType::I8 | NumberType::I16 | NumberType::I32 | NumberType::I64 => "I",
        NumberType::U8 | NumberType::U16 | NumberType::U32 | NumberType::U64 => "U",
        NumberType::F32 | NumberType::F64 => "F",
    }
}
