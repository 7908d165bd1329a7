//! Points as text: one line a point, one word a number.

use super::FormatError;
use super::input::truncated;
use super::record::{Field, empty_columns};
use crate::cloud::{Column, Values};

/// Reads `points` lines of numbers. Blank lines are skipped, words past the last field are refused.
///
/// `offset` is where `body` starts in the file. The count must be checked against the limits before.
pub(super) fn columns(fields: &[Field], body: &[u8], points: usize, offset: usize) -> Result<Vec<Column>, FormatError> {
    let mut columns = empty_columns(fields);
    if columns.is_empty() {
        return Ok(columns);
    }
    // Each number takes a digit and a space or line end, the very last one a digit.
    let least = points as u128 * columns.len() as u128 * 2;
    if least > body.len() as u128 + 1 {
        return Err(truncated("points", offset, least, body.len()));
    }
    let mut read = 0;
    let mut position = 0;
    for line in body.split(|&byte| byte == b'\n') {
        if read == points {
            break;
        }
        let start = offset + position;
        position += line.len() + 1;
        let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).peekable();
        if words.peek().is_none() {
            continue;
        }
        for column in &mut columns {
            let word = words.next().unwrap_or_default();
            if !push(&mut column.values, word) {
                let expected = format!("a number ({})", type_name(&column.values));
                return Err(FormatError::field(&column.name, start, expected, String::from_utf8_lossy(word)));
            }
        }
        if let Some(word) = words.next() {
            let expected = format!("{} numbers a line", columns.len());
            return Err(FormatError::field("point", start, expected, String::from_utf8_lossy(word)));
        }
        read += 1;
    }
    if read < points {
        return Err(FormatError::field("points", offset + body.len(), format!("{points} lines"), read));
    }
    Ok(columns)
}

/// Appends the number that `word` says; false where it says none of the type.
fn push(values: &mut Values, word: &[u8]) -> bool {
    let Ok(word) = str::from_utf8(word) else { return false };
    macro_rules! parse {
        ($($kind:ident),*) => {
            match values { $(Values::$kind(to) => match word.parse() {
                Ok(number) => to.push(number),
                Err(_) => return false,
            },)* }
        };
    }
    parse!(I8, U8, I16, U16, I32, U32, I64, U64, F32, F64);
    true
}

fn type_name(values: &Values) -> &'static str {
    match values {
        Values::I8(_) => "int8",
        Values::U8(_) => "uint8",
        Values::I16(_) => "int16",
        Values::U16(_) => "uint16",
        Values::I32(_) => "int32",
        Values::U32(_) => "uint32",
        Values::I64(_) => "int64",
        Values::U64(_) => "uint64",
        Values::F32(_) => "float32",
        Values::F64(_) => "float64",
    }
}
