//! The files that bring other readers down, each refused by the name of the field that lies.

use std::io::Cursor;

use lidar::PointCloud;
use lidar::formats::{Format, Limits, decode, encode};

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Offsets in a LAS header (LAS 1.4 R15, table 3).
const POINT_DATA: usize = 96;
const POINTS_OF_1_4: usize = 247;

fn cloud(points: usize) -> PointCloud {
    let zeros = vec![0.0; points];
    PointCloud { x: zeros.clone(), y: zeros.clone(), z: zeros.clone(), intensity: zeros, ..PointCloud::new(1.0) }
}

fn refusal(format: Format, bytes: &[u8]) -> String {
    match decode(format, bytes, &Limits::default()) {
        Ok(cloud) => format!("read as {} points", cloud.len()),
        Err(error) => error.to_string(),
    }
}

fn overwrite(bytes: &mut [u8], offset: usize, with: &[u8]) {
    bytes[offset..offset + with.len()].copy_from_slice(with);
}

#[test]
fn a_las_file_of_2_to_the_62_points_is_refused() -> Outcome {
    let mut bytes = encode(Format::Las, &cloud(3))?;
    // The old count is zero where the new one counts.
    overwrite(&mut bytes, 107, &[0; 4]);
    overwrite(&mut bytes, POINTS_OF_1_4, &(1_u64 << 62).to_le_bytes());
    let error = refusal(Format::Las, &bytes);
    assert_eq!(
        error,
        "number of point records at byte 247: 4611686018427387904 points is more than the limit of 4000000"
    );
    overwrite(&mut bytes, POINTS_OF_1_4, &4_u64.to_le_bytes());
    let error = refusal(Format::Las, &bytes);
    assert_eq!(error, "number of point records at byte 247: 136 bytes are announced, 102 are there");
    Ok(())
}

#[test]
fn a_laz_chunk_table_of_4_billion_chunks_is_refused() -> Outcome {
    let mut bytes = encode(Format::Laz, &cloud(3))?;
    let body = u32::from_le_bytes(bytes[POINT_DATA..][..4].try_into()?) as usize;
    let table = u64::from_le_bytes(bytes[body..][..8].try_into()?) as usize;
    overwrite(&mut bytes, table + 4, &u32::MAX.to_le_bytes());
    let error = refusal(Format::Laz, &bytes);
    assert_eq!(error, format!("number of chunks at byte {}: 4294967295 is more than the limit of 2", table + 4));
    Ok(())
}

#[test]
fn a_laz_layer_of_4_gigabytes_is_refused() -> Outcome {
    let mut bytes = encode(Format::Laz, &cloud(3))?;
    let body = u32::from_le_bytes(bytes[POINT_DATA..][..4].try_into()?) as usize;
    // After the table's offset, the first record (format 6, and the intensity's four) and the chunk's count.
    overwrite(&mut bytes, body + 8 + 34 + 4, &u32::MAX.to_le_bytes());
    let error = refusal(Format::Laz, &bytes);
    assert!(error.starts_with("layer size at byte"), "{error}");
    Ok(())
}

#[test]
fn an_extended_record_of_a_terabyte_is_left_unread() -> Outcome {
    let mut builder = las::Builder::default();
    builder.version = las::Version::new(1, 4);
    builder.evlrs.push(las::Vlr::default());
    let mut writer = las::Writer::new(Cursor::new(Vec::new()), builder.into_header()?)?;
    writer.write_point(las::Point::default())?;
    let mut bytes = writer.into_inner()?.into_inner();
    let evlr = bytes.len() - 60;
    for length in [1_u64 << 40, 1 << 63] {
        overwrite(&mut bytes, evlr + 20, &length.to_le_bytes());
        assert_eq!(decode(Format::Las, &bytes, &Limits::default())?.len(), 1);
    }
    Ok(())
}

#[test]
fn five_million_equal_points_in_some_kilobytes_are_refused() -> Outcome {
    let limits = Limits { max_points: 100_000, ..Limits::default() };
    let bytes = encode(Format::Laz, &cloud(100_001))?;
    assert!(bytes.len() < 10_000, "{}", bytes.len());
    assert!(decode(Format::Laz, &bytes, &limits).is_err());
    assert_eq!(decode(Format::Laz, &bytes, &Limits::default())?.len(), 100_001);
    Ok(())
}

#[test]
fn a_ply_of_10_to_the_30_vertices_is_refused() {
    let count = format!("1{}", "0".repeat(30));
    let header = format!("ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nend_header\n");
    let error = refusal(Format::Ply, header.as_bytes());
    assert_eq!(error, format!("element vertex at byte 21: {count} points is more than the limit of 4000000"));
}

#[test]
fn ply_elements_without_properties_take_nothing() {
    for encoding in ["ascii", "binary_little_endian"] {
        let header = format!(
            "ply\nformat {encoding} 1.0\nelement nothing 99999999999999999999\nelement vertex 1000000\nend_header\n"
        );
        assert_eq!(refusal(Format::Ply, header.as_bytes()), "no field `x`; the file has: ");
    }
}

#[test]
fn ply_lists_in_points_are_refused_by_name() {
    let header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int echoes\nend_header\n2 1 2\n";
    assert_eq!(refusal(Format::Ply, header.as_bytes()), "a list (`echoes`) in element vertex is not supported");
}

#[test]
fn an_npy_shape_beyond_its_bytes_is_refused() {
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (4294967295, 4294967295, 4), }";
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    let error = refusal(Format::Npy, &bytes);
    assert_eq!(error, "shape at byte 10: 295147905041913872400 bytes are announced, 0 are there");
}

#[test]
fn a_pcd_that_unpacks_to_more_than_its_bytes_can_is_refused() {
    let header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1000000\nHEIGHT 1\nDATA binary_compressed\n";
    let mut bytes = header.as_bytes().to_vec();
    bytes.extend(6_u32.to_le_bytes());
    bytes.extend(12_000_000_u32.to_le_bytes());
    bytes.extend([0, 0, 255, 255, 255, 0]);
    let error = refusal(Format::Pcd, &bytes);
    assert!(error.starts_with("uncompressed size at byte"), "{error}");
}

#[test]
fn utm_coordinates_in_las_are_refused_with_the_reason() -> Outcome {
    let mut builder = las::Builder::default();
    builder.transforms.x = las::Transform { scale: 0.001, offset: 500_000.0 };
    let mut writer = las::Writer::new(Cursor::new(Vec::new()), builder.into_header()?)?;
    writer.write_point(las::Point { x: 500_123.457, ..las::Point::default() })?;
    let error = refusal(Format::Las, &writer.into_inner()?.into_inner());
    assert_eq!(
        error,
        "x of point 0 is 500123.457 m: too far from the origin to hold a millimetre; subtract the map's offset first"
    );
    Ok(())
}

#[test]
fn points_without_a_place_are_no_las() {
    let mut cloud = cloud(2);
    cloud.y[1] = f32::NAN;
    let error = encode(Format::Las, &cloud).map(|_| ()).map_err(|error| error.to_string());
    assert!(error.is_err_and(|error| error.starts_with("y of point 1 is NaN m, which LAS cannot hold")));
}
