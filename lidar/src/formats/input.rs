//! A walk through a file's bytes that never leaves them.

use std::fmt::Display;

use super::{FormatError, Limits};

/// The bytes of a file and the place reached in them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Input<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> Input<'a> {
    /// The start of `bytes`.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    /// Goes on at `position`, which `field` announced.
    pub(super) fn seek(&mut self, position: usize, field: &str) -> Result<(), FormatError> {
        if position > self.bytes.len() {
            return Err(truncated(field, self.position, position, self.bytes.len()));
        }
        self.position = position;
        Ok(())
    }

    /// Bytes from the start of the file.
    pub(super) fn position(&self) -> usize {
        self.position
    }

    /// The bytes not yet taken.
    pub(super) fn rest(&self) -> &'a [u8] {
        &self.bytes[self.position..]
    }

    /// The next `length` bytes, which are `field`.
    pub(super) fn take(&mut self, length: usize, field: &str) -> Result<&'a [u8], FormatError> {
        let rest = self.rest();
        let taken = rest.get(..length).ok_or_else(|| truncated(field, self.position, length, rest.len()))?;
        self.position += length;
        Ok(taken)
    }

    /// The next `N` bytes, which are `field`.
    pub(super) fn array<const N: usize>(&mut self, field: &str) -> Result<[u8; N], FormatError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, field)?);
        Ok(array)
    }

    /// The next two bytes as a little-endian number.
    pub(super) fn u16(&mut self, field: &str) -> Result<u16, FormatError> {
        Ok(u16::from_le_bytes(self.array(field)?))
    }

    /// The next four bytes as a little-endian number.
    pub(super) fn u32(&mut self, field: &str) -> Result<u32, FormatError> {
        Ok(u32::from_le_bytes(self.array(field)?))
    }

    /// The next line without its end, `\n` or `\r\n`; the header it belongs to may not be longer than `max_bytes` in all.
    pub(super) fn line(&mut self, field: &str, max_bytes: usize) -> Result<&'a str, FormatError> {
        let offset = self.position;
        let window = &self.bytes[offset..self.bytes.len().min(max_bytes.max(offset))];
        let Some(length) = window.iter().position(|&byte| byte == b'\n') else {
            return Err(FormatError::field(field, offset, format!("a line end before byte {max_bytes}"), "none"));
        };
        self.position += length + 1;
        let line = &window[..length];
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        str::from_utf8(line)
            .map_err(|_| FormatError::field(field, offset, "text in UTF-8", String::from_utf8_lossy(line)))
    }
}

/// Splits a body into whole records of `stride` bytes, at most as many as the limits allow.
pub(super) fn whole_records<'a>(
    bytes: &'a [u8],
    stride: usize,
    format: &str,
    limits: &Limits,
) -> Result<&'a [u8], FormatError> {
    if !bytes.len().is_multiple_of(stride) {
        return Err(FormatError::field(
            "file length",
            bytes.len(),
            format!("a multiple of {stride} bytes, the size of a {format} point"),
            bytes.len(),
        ));
    }
    check_points((bytes.len() / stride) as u128, "file length", 0, limits)?;
    Ok(bytes)
}

/// The count of points that `field` announces, where the limits allow it.
pub(super) fn check_points(count: u128, field: &str, offset: usize, limits: &Limits) -> Result<usize, FormatError> {
    match usize::try_from(count) {
        Ok(count) if count <= limits.max_points => Ok(count),
        _ => Err(FormatError::TooMany {
            field: field.into(),
            offset,
            found: format!("{count} points"),
            limit: limits.max_points,
        }),
    }
}

/// The error for bytes that are not there.
pub(super) fn truncated(field: &str, offset: usize, needed: impl Display, available: usize) -> FormatError {
    FormatError::Truncated { field: field.into(), offset, needed: needed.to_string(), available }
}
