//! The header of a PLY file, and how to step over the elements it lists.

use super::{Endian, FormatError, NumberType};
use crate::formats::input::{Input, truncated};
use crate::formats::number;
use crate::formats::record::{Field, full_scale_note};

/// A header longer than this describes no scan.
const MAX_HEADER_BYTES: usize = 1 << 16;

/// How the body is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Binary(Endian),
}

#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// The intensity that means 1, from our own comment.
    pub(super) full_scale: Option<f32>,
    pub(super) body_offset: usize,
}

/// One `element` and its properties.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u128,
    pub(super) offset: usize,
    pub(super) properties: Vec<Property>,
}

#[derive(Clone, Debug)]
pub(super) enum Property {
    Number(Field),
    List { name: String, length: NumberType, item: NumberType },
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        let mut input = Input::new(bytes);
        if input.line("magic", MAX_HEADER_BYTES)?.trim_end() != "ply" {
            let found = String::from_utf8_lossy(&bytes[..bytes.len().min(16)]);
            return Err(FormatError::field("magic", 0, "ply", found));
        }
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut full_scale = None;
        loop {
            let offset = input.position();
            let line = input.line("header", MAX_HEADER_BYTES)?;
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words.as_slice() {
                ["end_header"] => break,
                ["format", name, "1.0"] => encoding = Some(parse_encoding(name, offset)?),
                ["comment", ..] => {
                    full_scale = full_scale_note(line.trim_start_matches("comment")).or(full_scale);
                }
                [] | ["obj_info", ..] => {}
                ["element", name, count] => elements.push(Element {
                    name: (*name).into(),
                    count: parse_count(count, name, offset)?,
                    offset,
                    properties: Vec::new(),
                }),
                ["property", words @ ..] => {
                    let property = parse_property(words, offset)?;
                    let element = elements.last_mut().ok_or_else(|| {
                        FormatError::field("property", offset, "an element before its properties", line)
                    })?;
                    element.properties.push(property);
                }
                _ => return Err(FormatError::field("header", offset, "a line of a PLY 1.0 header", line)),
            }
        }
        let encoding = encoding
            .ok_or_else(|| FormatError::field("format", input.position(), "a format before end_header", "none"))?;
        Ok(Self { encoding, elements, full_scale, body_offset: input.position() })
    }
}

impl Element {
    /// The properties as fields of a record.
    pub(super) fn fields(&self) -> Result<Vec<Field>, FormatError> {
        let field = |property: &Property| match property {
            Property::Number(field) => Ok(field.clone()),
            Property::List { name, .. } => {
                Err(FormatError::unsupported(format!("a list (`{name}`) in element {}", self.name)))
            }
        };
        self.properties.iter().map(field).collect()
    }

    /// Steps over the element in an ASCII body.
    pub(super) fn skip_lines(&self, body: &mut Input<'_>) -> Result<(), FormatError> {
        let mut left = if self.properties.is_empty() { 0 } else { self.count };
        while left > 0 {
            let rest = body.rest();
            let Some(length) = rest.iter().position(|&byte| byte == b'\n') else {
                return Err(truncated(&self.name, body.position(), format!("{left} more lines"), rest.len()));
            };
            let line = body.take(length + 1, &self.name)?;
            left -= u128::from(!line.trim_ascii().is_empty());
        }
        Ok(())
    }

    /// Steps over the element in a binary body.
    pub(super) fn skip_bytes(&self, body: &mut Input<'_>, endian: Endian) -> Result<(), FormatError> {
        if let Ok(fields) = self.fields() {
            let stride: usize = fields.iter().map(Field::bytes).sum();
            let needed = self.count.saturating_mul(stride as u128);
            body.take(usize::try_from(needed).unwrap_or(usize::MAX), &self.name)?;
            return Ok(());
        }
        // Every pass takes the length of a list at the least, so it ends with the bytes.
        for _ in 0..self.count {
            for property in &self.properties {
                match property {
                    Property::Number(field) => {
                        body.take(field.bytes(), &self.name)?;
                    }
                    Property::List { length, item, .. } => {
                        let offset = body.position();
                        let bytes = body.take(length.bytes(), &self.name)?;
                        let lane = number::Lane { stride: length.bytes(), offset: 0, endian };
                        let items = number::column(*length, bytes, lane).to_f64().first().copied().unwrap_or(-1.0);
                        if !(items >= 0.0 && items.fract() == 0.0) {
                            return Err(FormatError::field(&self.name, offset, "the length of a list", items));
                        }
                        body.take((items as usize).saturating_mul(item.bytes()), &self.name)?;
                    }
                }
            }
        }
        Ok(())
    }
}

fn parse_encoding(name: &str, offset: usize) -> Result<Encoding, FormatError> {
    match name {
        "ascii" => Ok(Encoding::Ascii),
        "binary_little_endian" => Ok(Encoding::Binary(Endian::Little)),
        "binary_big_endian" => Ok(Encoding::Binary(Endian::Big)),
        _ => Err(FormatError::field("format", offset, "ascii, binary_little_endian or binary_big_endian", name)),
    }
}

/// A count of any size that is written: the limits refuse it, not the parser.
fn parse_count(word: &str, name: &str, offset: usize) -> Result<u128, FormatError> {
    if word.is_empty() || !word.bytes().all(|byte| byte.is_ascii_digit()) {
        return Err(FormatError::field(format!("element {name}"), offset, "a count", word));
    }
    Ok(word.parse().unwrap_or(u128::MAX))
}

fn parse_property(words: &[&str], offset: usize) -> Result<Property, FormatError> {
    let number_type = |name: &str| {
        parse_type(name).ok_or_else(|| FormatError::field("property", offset, "a number type, such as float", name))
    };
    match words {
        ["list", length, item, name] => {
            Ok(Property::List { name: (*name).into(), length: number_type(length)?, item: number_type(item)? })
        }
        [kind, name] => Ok(Property::Number(Field { name: (*name).into(), number_type: number_type(kind)?, count: 1 })),
        _ => Err(FormatError::field("property", offset, "a type and a name", words.join(" "))),
    }
}

/// The names of 1994, those of the `rply` era with sizes in bits, and 64-bit integers, which some tools add.
fn parse_type(name: &str) -> Option<NumberType> {
    Some(match name {
        "char" | "int8" => NumberType::I8,
        "uchar" | "uint8" => NumberType::U8,
        "short" | "int16" => NumberType::I16,
        "ushort" | "uint16" => NumberType::U16,
        "int" | "int32" => NumberType::I32,
        "uint" | "uint32" => NumberType::U32,
        "int64" => NumberType::I64,
        "uint64" => NumberType::U64,
        "float" | "float32" => NumberType::F32,
        "double" | "float64" => NumberType::F64,
        _ => return None,
    })
}

/// The type's name of 1994, which every reader knows.
pub(super) fn type_name(number_type: NumberType) -> &'static str {
    match number_type {
        NumberType::I8 => "char",
        NumberType::U8 => "uchar",
        NumberType::I16 => "short",
        NumberType::U16 => "ushort",
        NumberType::I32 => "int",
        NumberType::U32 => "uint",
        NumberType::I64 => "int64",
        NumberType::U64 => "uint64",
        NumberType::F32 => "float",
        NumberType::F64 => "double",
    }
}
