//! TODO
use super::{FormatError, Limits};
use crate::PointCloud;
pub(super) fn decode(_b: &[u8], _l: &Limits) -> Result<PointCloud, FormatError> {
    Err(FormatError::unsupported("x"))
}
pub(super) fn encode(_c: &PointCloud) -> Result<Vec<u8>, FormatError> {
    Err(FormatError::unsupported("x"))
}
