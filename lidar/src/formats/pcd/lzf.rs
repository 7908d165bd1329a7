//! LZF decompression (Marc Lehmann's `liblzf`): runs of literal bytes, and copies of what was written before.

use super::FormatError;
use crate::formats::input::{Input, truncated};

/// A copy makes at most 264 bytes of 3: no honest stream swells more.
const MAX_EXPANSION: usize = 88;

/// Unpacks exactly `unpacked` bytes. `offset` is where `packed` starts in the file.
pub(super) fn unpack(packed: &[u8], unpacked: usize, offset: usize) -> Result<Vec<u8>, FormatError> {
    if unpacked > packed.len().saturating_mul(MAX_EXPANSION) {
        let expected = format!("at most {MAX_EXPANSION} times the compressed size of {}", packed.len());
        return Err(FormatError::field("uncompressed size", offset, expected, unpacked));
    }
    let mut out = Vec::with_capacity(unpacked);
    let mut input = Input::new(packed);
    while !input.rest().is_empty() {
        let at = offset + input.position();
        let [control] = input.array("LZF control")?;
        let added = if control < 32 {
            let literals = input.take(usize::from(control) + 1, "LZF literals")?;
            out.extend_from_slice(literals);
            literals.len()
        } else {
            let mut length = usize::from(control >> 5);
            if length == 7 {
                length += usize::from(input.array::<1>("LZF length")?[0]);
            }
            let distance = (usize::from(control & 31) << 8) + usize::from(input.array::<1>("LZF distance")?[0]) + 1;
            let start = out.len().checked_sub(distance).ok_or_else(|| {
                FormatError::field("LZF distance", at, format!("at most {} bytes back", out.len()), distance)
            })?;
            // The copy may reach into itself: that repeats the last `distance` bytes.
            for i in start..start + length + 2 {
                out.push(out[i]);
            }
            length + 2
        };
        if out.len() > unpacked {
            return Err(FormatError::field("LZF stream", at, format!("{unpacked} bytes in all"), out.len() + added));
        }
    }
    if out.len() < unpacked {
        return Err(truncated("LZF stream", offset + packed.len(), unpacked, out.len()));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_overlapping_copies_unpack() -> Result<(), FormatError> {
        // "ab", then 6 bytes from 2 back.
        let packed = [1, b'a', b'b', 4 << 5, 1];
        assert_eq!(unpack(&packed, 8, 0)?, b"abababab");
        Ok(())
    }

    #[test]
    fn a_stream_of_another_length_or_from_before_the_start_is_refused() {
        let packed = [1, b'a', b'b', 4 << 5, 1];
        for unpacked in [0, 7, 9, 100] {
            assert!(unpack(&packed, unpacked, 0).is_err(), "{unpacked}");
        }
        assert!(unpack(&[0, b'a', 1 << 5, 1], 4, 0).is_err());
        assert!(unpack(&[1, b'a'], 2, 0).is_err());
        assert!(unpack(&packed, 1 << 40, 0).is_err());
    }
}
