//! What can be wrong with a point cloud file.

use std::path::PathBuf;

use thiserror::Error;

use crate::cloud::ColumnLengthError;

/// A file that cannot be read, or a cloud that cannot be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FormatError {
    /// A field holds what it must not.
    #[error("{field} at byte {offset}: expected {expected}, found {found}")]
    Field {
        /// The field, in the words of the format.
        field: String,
        /// Where the field is, from the start of the file (of the member, in an archive).
        offset: usize,
        /// What the format asks for.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The bytes end before what a field announces.
    #[error("{field} at byte {offset}: {needed} bytes are announced, {available} are there")]
    Truncated {
        /// The field that announces them.
        field: String,
        /// Where the field is, or where the bytes should begin.
        offset: usize,
        /// Bytes announced.
        needed: String,
        /// Bytes there.
        available: usize,
    },
    /// A count or size that no honest scan has.
    #[error("{field} at byte {offset}: {found} is more than the limit of {limit}")]
    TooMany {
        /// The field.
        field: String,
        /// Where the field is.
        offset: usize,
        /// What the file announces.
        found: String,
        /// What is accepted.
        limit: usize,
    },
    /// A field that no cloud goes without.
    #[error("no field `{field}`; the file has: {present}")]
    Missing {
        /// The field.
        field: &'static str,
        /// The fields that are there.
        present: String,
    },
    /// A part of the format that this reader does not know.
    #[error("{what} is not supported{}", hint.map(|hint| format!("; {hint}")).unwrap_or_default())]
    Unsupported {
        /// The part.
        what: String,
        /// What to do instead.
        hint: Option<&'static str>,
    },
    /// A coordinate so large that `f32` does not hold it to a millimetre.
    #[error(
        "{field} of point {point} is {value_m} m: too far from the origin to hold a millimetre; subtract the map's offset first"
    )]
    FarFromOrigin {
        /// The coordinate.
        field: &'static str,
        /// Index of the point.
        point: usize,
        /// Its value in metres.
        value_m: f64,
    },
    /// A value that the format has no number for.
    #[error("{field} of point {point} is {value}, which {format} cannot hold: {range}")]
    Unwritable {
        /// The field.
        field: &'static str,
        /// Index of the point.
        point: usize,
        /// Its value.
        value: String,
        /// The format.
        format: &'static str,
        /// What it can hold.
        range: &'static str,
    },
    /// A cloud whose columns disagree.
    #[error(transparent)]
    Columns(#[from] ColumnLengthError),
    /// The library behind a format refuses the file.
    #[error("{library}: {message}")]
    Library {
        /// The library.
        library: &'static str,
        /// Its words.
        message: String,
    },
    /// The file's name tells no format.
    #[error("{}: the name tells no point cloud format", path.display())]
    UnknownName {
        /// The file.
        path: PathBuf,
    },
    /// The operating system refuses.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Its reason.
        source: std::io::Error,
    },
    /// What is wrong with the file of this name.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<FormatError>,
    },
}

impl FormatError {
    /// A [`FormatError::Field`] from whatever can be shown.
    pub(super) fn field(
        field: impl Into<String>,
        offset: usize,
        expected: impl Into<String>,
        found: impl std::fmt::Display,
    ) -> Self {
        // What is there may be the stranger's: show some of it, never all of it.
        let mut found = found.to_string().escape_debug().to_string();
        if let Some((end, _)) = found.char_indices().nth(80) {
            found.truncate(end);
            found.push('…');
        }
        Self::Field { field: field.into(), offset, expected: expected.into(), found }
    }

    /// A [`FormatError::Unsupported`] without a hint.
    pub(super) fn unsupported(what: impl Into<String>) -> Self {
        Self::Unsupported { what: what.into(), hint: None }
    }
}
