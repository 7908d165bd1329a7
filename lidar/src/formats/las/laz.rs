//! Decompression of LAZ points, after every size that the `laz` crate would allocate by has been checked.
//!
//! The layout is `LASzip`'s (Isenburg, "LASzip: lossless compression of lidar data", 2013): the offset of the chunk table, the chunks,
//! the table. Point formats 6–10 compress each field of a chunk as a layer of its own, whose size stands before it.

use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};

use laz::laszip::{ChunkTable, LazItemRecordBuilder};
use laz::{LasZipDecompressor, LazItemType, LazVlr};

use super::{FormatError, Header, STEP};
use crate::formats::input::Input;

/// Each chunk makes the decompressor build its tables anew, which takes far longer than reading the chunk's bytes.
const MAX_CHUNKS: u64 = 4096;

/// `LASzip`'s word for one chunk of all points, for chunks, and for chunks of layers.
const POINT_WISE: u16 = 1;
const CHUNKED: u16 = 2;
const LAYERED: u16 = 3;

/// Decompresses all points, some records at a time.
pub(super) fn unpack(
    bytes: &[u8],
    header: &Header,
    mut each: impl FnMut(Vec<u8>) -> Result<(), FormatError>,
) -> Result<(), FormatError> {
    let vlr = check(bytes, header)?;
    if header.points == 0 {
        return Ok(());
    }
    let mut source = Cursor::new(bytes);
    source.set_position(header.body_offset as u64);
    let mut decompressor = caught(|| LasZipDecompressor::new(source, vlr).map_err(|error| library(&error)))?;
    let mut left = header.points;
    while left > 0 {
        let step = left.min(STEP);
        let mut records = vec![0; step * header.record_bytes];
        caught(|| decompressor.decompress_many(&mut records).map_err(|error| library(&error)))?;
        each(records)?;
        left -= step;
    }
    Ok(())
}

/// Turns a panic of the crate into an error: the last resort, for what the checks may have missed.
fn caught<T>(run: impl FnOnce() -> Result<T, FormatError>) -> Result<T, FormatError> {
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|_| Err(library(&"the decompressor panicked")))
}

fn library(error: &dyn std::fmt::Display) -> FormatError {
    FormatError::Library { library: "laz", message: error.to_string() }
}

/// Checks the `LASzip` record, the chunk table and the sizes of all layers.
fn check(bytes: &[u8], header: &Header) -> Result<LazVlr, FormatError> {
    let Some((data, offset)) = &header.laszip else {
        return Err(FormatError::Missing { field: "LASzip record", present: "compressed points".into() });
    };
    let offset = *offset;
    let compressor = Input::new(data).u16("LASzip compressor")?;
    let vlr = LazVlr::from_buffer(data).map_err(|error| library(&error))?;
    check_items(&vlr, compressor, header, offset)?;
    if compressor == POINT_WISE {
        return Ok(vlr);
    }
    let points = header.points as u64;
    let table_offset = table_offset(bytes, header.body_offset)?;
    let mut input = Input::new(bytes);
    input.seek(table_offset, "chunk table offset")?;
    input.u32("chunk table version")?;
    let chunks = input.u32("number of chunks")?;
    let is_fixed = !vlr.uses_variable_size_chunks();
    let most = if is_fixed { points.div_ceil(vlr.chunk_size().into()) + 1 } else { MAX_CHUNKS };
    // Chunks that the table leaves out are read all the same.
    let needed = if is_fixed { points.div_ceil(vlr.chunk_size().into()) } else { 0 };
    if u64::from(chunks) > most.min(MAX_CHUNKS) || needed > MAX_CHUNKS {
        return Err(FormatError::TooMany {
            field: "number of chunks".into(),
            offset: table_offset + 4,
            found: needed.max(chunks.into()).to_string(),
            limit: most.min(MAX_CHUNKS) as usize,
        });
    }
    let mut cursor = Cursor::new(&bytes[table_offset..]);
    let table = caught(|| ChunkTable::read(&mut cursor, !is_fixed).map_err(|error| library(&error)))?;
    let sizes: Vec<u64> = if is_fixed {
        vec![vlr.chunk_size().into(); needed as usize]
    } else {
        table.into_iter().map(|entry| entry.point_count).collect()
    };
    let covered = sizes.iter().fold(0_u64, |sum, &size| sum.saturating_add(size));
    if covered < points || (!is_fixed && sizes.contains(&0)) {
        let expected = format!("chunks of {points} points, none empty");
        return Err(FormatError::field("chunk table", table_offset, expected, covered));
    }
    if compressor == LAYERED {
        check_layers(bytes, header, &vlr, &sizes)?;
    }
    Ok(vlr)
}

/// The compressed fields must be exactly those of the point format: their sizes are what the crate allocates by.
fn check_items(vlr: &LazVlr, compressor: u16, header: &Header, offset: usize) -> Result<(), FormatError> {
    let expected = LazItemRecordBuilder::default_for_point_format_id(header.format_id, header.format.extra_bytes)
        .map_err(|error| library(&error))?;
    let versions = match compressor {
        POINT_WISE | CHUNKED => [1, 2],
        LAYERED => [3, 4],
        _ => return Err(FormatError::field("LASzip compressor", offset, "1, 2 or 3", compressor)),
    };
    let fits = vlr.items().len() == expected.len()
        && vlr.items().iter().zip(&expected).all(|(item, expected)| {
            item.item_type() == expected.item_type()
                && item.size() == expected.size()
                && versions.contains(&item.version())
        });
    if fits {
        return Ok(());
    }
    let list = |items: &[laz::LazItem]| format!("{:?}", items.iter().map(laz::LazItem::item_type).collect::<Vec<_>>());
    let what = format!("{} in versions {versions:?}", list(&expected));
    Err(FormatError::field("LASzip items", offset + 32, what, list(vlr.items())))
}

/// Where the chunk table is: at the start of the points, or, of a file written to a pipe, at its very end.
fn table_offset(bytes: &[u8], body_offset: usize) -> Result<usize, FormatError> {
    const FIELD: &str = "chunk table offset";
    let read = |position: usize| -> Result<i64, FormatError> {
        let mut input = Input::new(bytes);
        input.seek(position, FIELD)?;
        Ok(i64::from_le_bytes(input.array(FIELD)?))
    };
    let mut offset = read(body_offset)?;
    if offset <= body_offset as i64 {
        offset = read(bytes.len().saturating_sub(8))?;
    }
    let first = body_offset + 8;
    match usize::try_from(offset) {
        Ok(offset) if offset >= first && offset.saturating_add(8) <= bytes.len() => Ok(offset),
        _ => Err(FormatError::field(FIELD, body_offset, format!("{first} to the end of the file"), offset)),
    }
}

/// Walks the chunks as the decompressor will, so that no layer is larger than the bytes there.
fn check_layers(bytes: &[u8], header: &Header, vlr: &LazVlr, sizes: &[u64]) -> Result<(), FormatError> {
    let layers: usize = vlr.items().iter().map(|item| layer_count(item.item_type())).sum();
    let mut input = Input::new(bytes);
    input.seek(header.body_offset + 8, "chunk")?;
    let mut left = header.points as u64;
    for &size in sizes {
        if left == 0 {
            break;
        }
        left = left.saturating_sub(size);
        // The first point as it is, the number of points, the sizes, the layers.
        input.take(header.record_bytes + 4, "chunk")?;
        let mut length = 0_usize;
        for _ in 0..layers {
            length = length.saturating_add(input.u32("layer size")? as usize);
        }
        input.take(length, "layer size")?;
    }
    Ok(())
}

fn layer_count(item: LazItemType) -> usize {
    match item {
        LazItemType::Point14 => 9,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(count) => count.into(),
        _ => 1,
    }
}
