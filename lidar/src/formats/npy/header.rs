//! The header of an NPY array: its number types, order and shape.

use super::literal::{Literal, parse};
use super::{Endian, Field, FormatError, NumberType};
use crate::formats::input::Input;
use crate::formats::record;

const MAGIC: [u8; 6] = *b"\x93NUMPY";

/// `NumPy` itself refuses longer ones.
const MAX_HEADER_BYTES: usize = 1 << 16;

/// More dimensions than a batch of images has are no points.
const MAX_DIMENSIONS: usize = 8;

#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) fields: Vec<Field>,
    /// True where the array has named fields; false for a plain one, whose one field has no name.
    pub(super) is_structured: bool,
    pub(super) endian: Endian,
    pub(super) is_fortran: bool,
    pub(super) shape: Vec<u128>,
    pub(super) shape_offset: usize,
    pub(super) body_offset: usize,
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, FormatError> {
        let mut input = Input::new(bytes);
        let magic: [u8; 6] = input.array("magic")?;
        if magic != MAGIC {
            return Err(FormatError::field("magic", 0, "\\x93NUMPY", String::from_utf8_lossy(&magic)));
        }
        let [major, _minor] = input.array("version")?;
        let length = match major {
            1 => usize::from(input.u16("HEADER_LEN")?),
            2 | 3 => input.u32("HEADER_LEN")? as usize,
            _ => return Err(FormatError::field("version", 6, "1, 2 or 3", major)),
        };
        if length > MAX_HEADER_BYTES {
            let found = format!("{length} bytes");
            return Err(FormatError::TooMany { field: "HEADER_LEN".into(), offset: 8, found, limit: MAX_HEADER_BYTES });
        }
        let offset = input.position();
        let text = input.take(length, "HEADER_LEN")?;
        // Versions 1 and 2 are Latin-1, version 3 is UTF-8.
        let text = match str::from_utf8(text) {
            Ok(text) => text.to_owned(),
            Err(_) => text.iter().map(|&byte| char::from(byte)).collect(),
        };
        Self::from_literal(&parse(&text, offset)?, offset, input.position())
    }

    fn from_literal(literal: &Literal, offset: usize, body_offset: usize) -> Result<Self, FormatError> {
        let entry = |key: &str| {
            let Literal::Dict(entries) = literal else {
                return Err(FormatError::field("NPY header", offset, "a dictionary", "something else"));
            };
            let found = entries.iter().find(|(name, _)| *name == Literal::Text(key.into()));
            found
                .map(|(_, value)| value)
                .ok_or_else(|| FormatError::field(key, offset, "an entry of the header", "none"))
        };
        let (fields, is_structured, endian) = parse_descr(entry("descr")?, offset)?;
        let Literal::Bool(is_fortran) = *entry("fortran_order")? else {
            return Err(FormatError::field("fortran_order", offset, "True or False", "something else"));
        };
        let shape = parse_shape(entry("shape")?, "shape", offset)?;
        Ok(Self { fields, is_structured, endian, is_fortran, shape, shape_offset: offset, body_offset })
    }
}

fn parse_descr(descr: &Literal, offset: usize) -> Result<(Vec<Field>, bool, Endian), FormatError> {
    if let Literal::Text(text) = descr {
        let (number_type, count, endian) = parse_type(text, offset)?;
        let field = Field { name: String::new(), number_type, count };
        return Ok((vec![field], false, endian.unwrap_or(Endian::Little)));
    }
    let Literal::Sequence(items) = descr else {
        return Err(FormatError::field("descr", offset, "a type or a list of fields", "something else"));
    };
    let mut endian = None;
    let mut fields = Vec::with_capacity(items.len());
    for item in items {
        let Literal::Sequence(item) = item else {
            return Err(FormatError::field("descr", offset, "(name, type) for each field", "something else"));
        };
        let (name, text, shape) = match item.as_slice() {
            [name, Literal::Text(text)] => (name, text, 1),
            [name, Literal::Text(text), shape] => {
                let shape = parse_shape(shape, "descr", offset)?;
                (name, text, shape.iter().try_fold(1_u128, |a, &b| a.checked_mul(b)).unwrap_or(u128::MAX))
            }
            _ => return Err(FormatError::unsupported("an NPY field of fields")),
        };
        let name = match name {
            Literal::Text(name) => name,
            // (title, name)
            Literal::Sequence(pair) => match pair.as_slice() {
                [_, Literal::Text(name)] => name,
                _ => return Err(FormatError::field("descr", offset, "(title, name)", "something else")),
            },
            _ => return Err(FormatError::field("descr", offset, "a name", "something else")),
        };
        let (number_type, count, order) = parse_type(text, offset)?;
        if let (Some(one), Some(other)) = (endian, order)
            && one != other
        {
            return Err(FormatError::unsupported("an NPY record of both byte orders"));
        }
        endian = endian.or(order);
        let count = usize::try_from(shape).unwrap_or(usize::MAX).saturating_mul(count);
        // NumPy names padding with nothing.
        let name = if name.is_empty() { record::PADDING.into() } else { name.clone() };
        fields.push(Field { name, number_type, count });
    }
    Ok((fields, true, endian.unwrap_or(Endian::Little)))
}

/// A type such as `<f4`, how many of them (padding is `|V12`: twelve bytes), and its byte order if it has one.
fn parse_type(text: &str, offset: usize) -> Result<(NumberType, usize, Option<Endian>), FormatError> {
    let (order, kind) = match text.split_at_checked(1) {
        Some(("<", kind)) => (Some(Endian::Little), kind),
        Some((">", kind)) => (Some(Endian::Big), kind),
        Some(("|", kind)) => (None, kind),
        _ => (None, text),
    };
    let number_type = match kind {
        "i1" => NumberType::I8,
        "u1" | "b1" => NumberType::U8,
        "i2" => NumberType::I16,
        "u2" => NumberType::U16,
        "i4" => NumberType::I32,
        "u4" => NumberType::U32,
        "i8" => NumberType::I64,
        "u8" => NumberType::U64,
        "f4" => NumberType::F32,
        "f8" => NumberType::F64,
        _ => {
            if let Some(bytes) = kind.strip_prefix('V').and_then(|bytes| bytes.parse().ok()) {
                return Ok((NumberType::U8, bytes, None));
            }
            return Err(FormatError::field("descr", offset, "numbers: i1 to i8, u1 to u8, f4 or f8", text));
        }
    };
    let order = order.filter(|_| number_type.bytes() > 1);
    Ok((number_type, 1, order))
}

fn parse_shape(shape: &Literal, field: &str, offset: usize) -> Result<Vec<u128>, FormatError> {
    let wrong =
        || FormatError::field(field, offset, format!("at most {MAX_DIMENSIONS} whole numbers"), "something else");
    match shape {
        Literal::Whole(length) => Ok(vec![*length]),
        Literal::Sequence(lengths) if lengths.len() <= MAX_DIMENSIONS => {
            let length = |length: &Literal| match length {
                Literal::Whole(length) => Ok(*length),
                _ => Err(wrong()),
            };
            lengths.iter().map(length).collect()
        }
        _ => Err(wrong()),
    }
}

/// The NPY name of a little-endian type.
pub(in crate::formats) fn descr(number_type: NumberType) -> &'static str {
    match number_type {
        NumberType::I8 => "|i1",
        NumberType::U8 => "|u1",
        NumberType::I16 => "<i2",
        NumberType::U16 => "<u2",
        NumberType::I32 => "<i4",
        NumberType::U32 => "<u4",
        NumberType::I64 => "<i8",
        NumberType::U64 => "<u8",
        NumberType::F32 => "<f4",
        NumberType::F64 => "<f8",
    }
}

/// A header for `descr` (a Python literal, brackets and quotes included) and `shape` (numbers between commas).
pub(in crate::formats) fn write_header(descr: &str, shape: &str) -> Result<Vec<u8>, FormatError> {
    // A tuple of one needs its comma.
    let comma = if shape.is_empty() || shape.contains(',') { "" } else { "," };
    let mut text = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': ({shape}{comma}), }}");
    // Body at a multiple of 64 bytes, header ended by a line feed, as NumPy does.
    let prefix = MAGIC.len() + 2 + 4;
    text.push_str(&" ".repeat(63 - (prefix + text.len()) % 64));
    text.push('\n');
    if text.len() > MAX_HEADER_BYTES {
        let found = format!("{} bytes", text.len());
        return Err(FormatError::TooMany { field: "HEADER_LEN".into(), offset: 8, found, limit: MAX_HEADER_BYTES });
    }
    let mut header = MAGIC.to_vec();
    // Version 2 and up have four bytes of length; 3 is 2 in UTF-8.
    header.extend([if text.is_ascii() { 2 } else { 3 }, 0]);
    header.extend((text.len() as u32).to_le_bytes());
    header.extend(text.as_bytes());
    Ok(header)
}
