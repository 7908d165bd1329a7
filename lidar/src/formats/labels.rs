//! `SemanticKITTI`'s `.label`: one little-endian u32 a point, beside the scan.

use super::number::Numbers;
use super::{FormatError, input::truncated};

/// Reads the labels of a scan of `points` points.
pub fn decode_labels(bytes: &[u8], points: usize) -> Result<Vec<u32>, FormatError> {
    let needed = points as u128 * 4;
    if (bytes.len() as u128) < needed {
        return Err(truncated("labels", 0, format!("{needed} (4 for each of {points} points)"), bytes.len()));
    }
    if bytes.len() as u128 > needed {
        return Err(FormatError::field(
            "labels",
            needed as usize,
            format!("the end after {points} labels"),
            format!("{} bytes", bytes.len()),
        ));
    }
    Ok(bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
}

/// Writes labels.
pub fn encode_labels(labels: &[u32]) -> Vec<u8> {
    Numbers::U32(labels.into()).to_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_another_scan_are_refused() {
        let bytes = encode_labels(&[10, 0x0007_00fc]);
        assert_eq!(decode_labels(&bytes, 2).ok(), Some(vec![10, 0x0007_00fc]));
        for points in [0, 1, 3, usize::MAX] {
            assert!(decode_labels(&bytes, points).is_err(), "{points}");
        }
    }
}
