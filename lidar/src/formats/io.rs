//! Clouds in files: the only place of the formats that touches a disk.

use std::fs::{self, File};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::{Format, FormatError, Limits, decode, decode_labels, encode, encode_labels};
use crate::PointCloud;

/// Most bytes a point takes in any file: text with a dozen fields.
const MAX_FILE_BYTES_PER_POINT: u64 = 256;

/// Reads the cloud in a file, its format told by its name.
///
/// Beside a `.bin` scan without labels it looks for `SemanticKITTI`'s: `<stem>.label` in the same folder or in `../labels/`.
pub fn read(path: &Path, limits: &Limits) -> Result<PointCloud, FormatError> {
    let format = Format::from_path(path).ok_or_else(|| FormatError::UnknownName { path: path.into() })?;
    let max_bytes = MAX_FILE_BYTES_PER_POINT.saturating_mul(limits.max_points as u64).saturating_add(1 << 20);
    let in_file = |path: &Path| {
        let path = path.to_path_buf();
        move |source| FormatError::File { path, source: Box::new(source) }
    };
    let mut cloud = decode(format, &read_bytes(path, max_bytes)?, limits).map_err(in_file(path))?;
    if matches!(format, Format::Kitti | Format::NuScenes) {
        for labels in label_paths(path, format) {
            match read_bytes(&labels, max_bytes) {
                Ok(bytes) => {
                    cloud.label = Some(decode_labels(&bytes, cloud.len()).map_err(in_file(&labels))?);
                    break;
                }
                Err(FormatError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
    }
    Ok(cloud)
}

/// Writes a cloud, its format told by the file's name, so that a reader finds the old file or the new one and never a half.
///
/// Labels that a `.bin` cannot hold go into `<stem>.label` beside it.
pub fn write(path: &Path, cloud: &PointCloud) -> Result<(), FormatError> {
    let format = Format::from_path(path).ok_or_else(|| FormatError::UnknownName { path: path.into() })?;
    let bytes = encode(format, cloud)?;
    if let (Some(labels), Format::Kitti | Format::NuScenes) = (&cloud.label, format) {
        let [beside, _] = label_paths(path, format);
        write_atomically(&beside, &encode_labels(labels))?;
    }
    write_atomically(path, &bytes)
}

/// Where the labels of a `.bin` may be: beside it, or in `SemanticKITTI`'s `labels` beside `velodyne`.
fn label_paths(path: &Path, format: Format) -> [PathBuf; 2] {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = &name[..name.len() - format.extension().len()];
    let folder = path.parent().unwrap_or(Path::new(""));
    let labels = format!("{stem}label");
    [folder.join(&labels), folder.join("..").join("labels").join(&labels)]
}

fn read_bytes(path: &Path, max_bytes: u64) -> Result<Vec<u8>, FormatError> {
    let io = |source| FormatError::Io { path: path.into(), source };
    let mut bytes = Vec::new();
    // The length is not asked for: a pipe has none, and a file may grow while it is read.
    File::open(path).map_err(io)?.take(max_bytes + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > max_bytes {
        return Err(FormatError::TooMany {
            field: path.display().to_string(),
            offset: 0,
            found: format!("over {max_bytes} bytes"),
            limit: max_bytes as usize,
        });
    }
    Ok(bytes)
}

/// Writes a file whole or not at all: beside its place, kept by the disk, then renamed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    static WRITES: AtomicU64 = AtomicU64::new(0);
    let io = |source| FormatError::Io { path: path.into(), source };
    let count = WRITES.fetch_add(1, Ordering::Relaxed);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let beside = path.with_file_name(format!(".{name}.{}.{count}.part", std::process::id()));
    let written = File::create_new(&beside).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&beside, path)
    });
    if let Err(error) = written {
        // The error that matters is the first one; the part may not even be there.
        let _ = fs::remove_file(&beside);
        return Err(io(error));
    }
    // The rename lives in the folder: without this a power cut may take it back.
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(io)
}
