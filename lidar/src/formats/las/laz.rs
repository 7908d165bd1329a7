//! LAZ: the chunks of a compressed file, and their decompression by the `laz` crate once every size has been checked.
//!
//! The layout is `LASzip`'s (Isenburg, "`LASzip`: lossless compression of lidar data", 2013): the offset of the chunk table, the chunks,
//! the table. Point formats 6–10 compress each field of a chunk as a layer of its own, whose size stands before it.
//!
//! The crate's own readers are passed by: they allocate by the table's count and the layers' sizes, and both of their decoders of the
//! GPS time call themselves for as long as the stream asks, which overflows the stack and ends the process. For formats 1–5 ours,
//! [`GpsTime`], stands in their place; for formats 6–10, where the time is one layer among others, that layer is left out.

use std::io::Cursor;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};

use laz::laszip::{ChunkTable, LazItemRecordBuilder};
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{DecompressionSelection, LazItem, LazItemType, LazVlr, las as fields};

use super::gps_time::GpsTime;
use super::{FormatError, Header, STEP};
use crate::formats::input::Input;

/// Each chunk makes the decompressor build its tables anew, which takes a millisecond, however few its points: a small file of many
/// chunks would keep a server busy for seconds. Encoders put 50,000 points into a chunk.
const MAX_CHUNKS: u64 = 512;

/// `LASzip`'s word for one chunk of all points, for chunks, and for chunks of layers.
const POINT_WISE: u16 = 1;
const CHUNKED: u16 = 2;
const LAYERED: u16 = 3;

/// Some points and their bytes in the file.
#[derive(Debug)]
struct Chunk {
    points: usize,
    bytes: Range<usize>,
}

/// Decompresses all points, some records at a time.
pub(super) fn unpack(
    bytes: &[u8],
    header: &Header,
    mut each: impl FnMut(Vec<u8>) -> Result<(), FormatError>,
) -> Result<(), FormatError> {
    let Some((data, offset)) = &header.laszip else {
        return Err(FormatError::Missing { field: "LASzip record", present: "compressed points".into() });
    };
    let compressor = Input::new(data).u16("LASzip compressor")?;
    let vlr = LazVlr::from_buffer(data).map_err(|error| library(&error))?;
    check_items(&vlr, compressor, header, *offset)?;
    let chunks = if compressor == POINT_WISE {
        vec![Chunk { points: header.points, bytes: header.body_offset..bytes.len() }]
    } else {
        chunks(bytes, header, &vlr)?
    };
    for chunk in chunks {
        let source = &bytes[chunk.bytes.clone()];
        if compressor == LAYERED {
            check_layers(source, chunk.bytes.start, header, &vlr)?;
        }
        let mut decompressor = decompressor(source, vlr.items(), compressor == LAYERED)?;
        let mut left = chunk.points;
        while left > 0 {
            let step = left.min(STEP);
            let mut records = vec![0; step * header.record_bytes];
            caught(|| decompressor.decompress_many(&mut records).map_err(|error| library(&error)))?;
            each(records)?;
            left -= step;
        }
    }
    Ok(())
}

/// Turns a panic of the crate into an error: its arithmetic decoder indexes tables by what a damaged stream says.
fn caught<T>(run: impl FnOnce() -> Result<T, FormatError>) -> Result<T, FormatError> {
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|_| Err(library(&"the decompressor panicked")))
}

fn library(error: &dyn std::fmt::Display) -> FormatError {
    FormatError::Library { library: "laz", message: error.to_string() }
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
    let list = |items: &[LazItem]| format!("{:?}", items.iter().map(LazItem::item_type).collect::<Vec<_>>());
    let what = format!("{} in versions {versions:?}", list(&expected));
    Err(FormatError::field("LASzip items", offset + 32, what, list(vlr.items())))
}

/// The chunks that the table lists, as many as hold all points, each inside the file.
fn chunks(bytes: &[u8], header: &Header, vlr: &LazVlr) -> Result<Vec<Chunk>, FormatError> {
    let table_offset = table_offset(bytes, header.body_offset)?;
    let mut input = Input::new(bytes);
    input.seek(table_offset, "chunk table offset")?;
    input.u32("chunk table version")?;
    let count = u64::from(input.u32("number of chunks")?);
    let fixed = (!vlr.uses_variable_size_chunks()).then(|| u64::from(vlr.chunk_size()));
    let most = fixed.map_or(MAX_CHUNKS, |size| (header.points as u64).div_ceil(size) + 1).min(MAX_CHUNKS);
    if count > most {
        let (field, offset, limit) = ("number of chunks".into(), table_offset + 4, most as usize);
        return Err(FormatError::TooMany { field, offset, found: count.to_string(), limit });
    }
    let mut cursor = Cursor::new(&bytes[table_offset..]);
    let table = caught(|| ChunkTable::read(&mut cursor, fixed.is_none()).map_err(|error| library(&error)))?;
    let wrong = |expected: String, found: u64| FormatError::field("chunk table", table_offset, expected, found);
    let mut chunks = Vec::new();
    let mut start = header.body_offset + ChunkTable::OFFSET_SIZE;
    let mut left = header.points;
    for entry in &table {
        if left == 0 {
            break;
        }
        let points = left.min(usize::try_from(fixed.unwrap_or(entry.point_count)).unwrap_or(usize::MAX));
        let length = usize::try_from(entry.byte_count).unwrap_or(usize::MAX);
        let end = start.checked_add(length).filter(|&end| end <= bytes.len()).ok_or_else(|| {
            wrong(format!("a chunk of at most the {} bytes left", bytes.len() - start), entry.byte_count)
        })?;
        chunks.push(Chunk { points, bytes: start..end });
        left -= points;
        start = end;
    }
    if left > 0 {
        let expected = format!("chunks of all {} points", header.points);
        return Err(wrong(expected, (header.points - left) as u64));
    }
    Ok(chunks)
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
    let first = body_offset + ChunkTable::OFFSET_SIZE;
    match usize::try_from(offset) {
        Ok(offset) if offset >= first && offset.saturating_add(8) <= bytes.len() => Ok(offset),
        _ => Err(FormatError::field(FIELD, body_offset, format!("{first} to the end of the file"), offset)),
    }
}

/// A chunk of layers: its first point as it is, the number of points, the size of each layer, the layers.
fn check_layers(chunk: &[u8], offset: usize, header: &Header, vlr: &LazVlr) -> Result<(), FormatError> {
    let layers: usize = vlr.items().iter().map(|item| layer_count(item.item_type())).sum();
    let mut input = Input::new(chunk);
    input.take(header.record_bytes + 4, "chunk")?;
    let mut length = 0_usize;
    for _ in 0..layers {
        length = length.saturating_add(input.u32("layer size")? as usize);
    }
    if length > input.rest().len() {
        let expected = format!("layers of {} bytes in all", input.rest().len());
        return Err(FormatError::field("layer size", offset + input.position(), expected, length));
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

/// A decompressor of one chunk.
fn decompressor<'a>(
    source: &'a [u8],
    items: &Vec<LazItem>,
    is_layered: bool,
) -> Result<Box<dyn RecordDecompressor<Cursor<&'a [u8]>> + 'a>, FormatError> {
    let source = Cursor::new(source);
    if is_layered {
        let mut layered = LayeredPointRecordDecompressor::new(source);
        layered.set_fields_from(items).map_err(|error| library(&error))?;
        layered.set_selection(DecompressionSelection::all().skip_gps_time());
        return Ok(Box::new(layered));
    }
    let mut sequential = SequentialPointRecordDecompressor::new(source);
    for item in items {
        let extra_bytes = usize::from(item.size());
        match (item.item_type(), item.version()) {
            (LazItemType::Point10, 1) => {
                sequential.add_field_decompressor(fields::v1::LasPoint0Decompressor::default());
            }
            (LazItemType::Point10, _) => {
                sequential.add_field_decompressor(fields::v2::LasPoint0Decompressor::default());
            }
            (LazItemType::GpsTime, 1) => {
                sequential.add_field_decompressor(fields::v1::LasGpsTimeDecompressor::default());
            }
            (LazItemType::GpsTime, _) => sequential.add_field_decompressor(GpsTime::default()),
            (LazItemType::RGB12, 1) => {
                sequential.add_field_decompressor(fields::v1::LasRGBDecompressor::default());
            }
            (LazItemType::RGB12, _) => {
                sequential.add_field_decompressor(fields::v2::LasRGBDecompressor::default());
            }
            (LazItemType::Byte(_), 1) => {
                sequential.add_field_decompressor(fields::v1::LasExtraByteDecompressor::new(extra_bytes));
            }
            (LazItemType::Byte(_), _) => {
                sequential.add_field_decompressor(fields::v2::LasExtraByteDecompressor::new(extra_bytes));
            }
            (LazItemType::WavePacket13, _) => {
                sequential.add_field_decompressor(fields::v1::LasWavepacketDecompressor::default());
            }
            (other, version) => {
                return Err(FormatError::unsupported(format!("LASzip item {other:?} of version {version}")));
            }
        }
    }
    Ok(Box::new(sequential))
}
