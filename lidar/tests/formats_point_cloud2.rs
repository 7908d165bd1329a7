//! ROS messages against bytes that `rosbags` wrote (`scripts/point_cloud2_goldens.py`), and messages that contradict themselves.

use std::path::Path;

use lidar::PointCloud;
use lidar::cloud::Values;
use lidar::formats::{Format, FormatError, Limits, decode, encode};

type Outcome = Result<(), Box<dyn std::error::Error>>;

const POINTS: usize = 6;

fn golden(name: &str) -> std::io::Result<Vec<u8>> {
    std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name).with_extension("cdr"))
}

fn read(bytes: &[u8]) -> Result<PointCloud, FormatError> {
    decode(Format::PointCloud2, bytes, &Limits::default())
}

fn each<T>(value: impl Fn(usize) -> T) -> Vec<T> {
    (0..POINTS).map(value).collect()
}

fn extra<'a>(cloud: &'a PointCloud, name: &str) -> Option<&'a Values> {
    cloud.extra.iter().find(|column| column.name == name).map(|column| &column.values)
}

#[test]
fn either_byte_order_of_message_and_points_gives_the_same_cloud() -> Outcome {
    for name in ["xyzirc", "xyzirc_big_endian_message", "xyzirc_big_endian_points"] {
        let cloud = read(&golden(name)?)?;
        assert_eq!(cloud.x, each(|i| i as f32 + 0.5), "{name}");
        assert_eq!(cloud.y, each(|i| -0.25 * i as f32), "{name}");
        assert_eq!(cloud.z, each(|i| 0.125 * i as f32), "{name}");
        assert_eq!((&cloud.intensity, cloud.full_scale), (&each(|i| 40.0 * i as f32), 255.0), "{name}");
        assert_eq!(cloud.ring, Some(each(|i| 5 - i as u16)), "{name}: the ring is called channel");
        assert_eq!(extra(&cloud, "return_type"), Some(&Values::U8(each(|i| i as u8 % 2))), "{name}");
        let ros = cloud.ros.ok_or("no message")?;
        assert_eq!((ros.frame_id(), ros.stamp()), ("lidar_top", (1_700_000_000, 123_456_789)), "{name}");
    }
    Ok(())
}

#[test]
fn a_message_in_one_row_comes_back_byte_for_byte() -> Outcome {
    for name in ["xyzirc", "xyzirc_big_endian_message", "xyzirc_big_endian_points", "every_datatype", "empty"] {
        let bytes = golden(name)?;
        assert_eq!(encode(Format::PointCloud2, &read(&bytes)?)?, bytes, "{name}");
    }
    Ok(())
}

#[test]
fn rows_with_bytes_after_them_and_points_with_bytes_between_their_fields_are_read() -> Outcome {
    let cloud = read(&golden("ouster_organised")?)?;
    assert_eq!(cloud.y, each(|i| -0.25 * i as f32));
    assert_eq!(cloud.x.iter().map(|x| x.is_nan()).collect::<Vec<_>>(), each(|i| i == 4));
    assert_eq!(cloud.ring, Some(each(|i| i as u16 / 3)));
    // 80 ms from first to last: nanoseconds.
    assert_eq!(cloud.time_s, Some(each(|i| i as f64 * 0.016)));
    assert_eq!(cloud.intensity, each(|i| 100.0 * i as f32));
    for (name, values) in [
        ("reflectivity", Values::U16(each(|i| 7 * i as u16))),
        ("ambient", Values::U16(each(|i| 1000 + i as u16))),
        ("range", Values::U32(each(|i| 1000 * i as u32))),
    ] {
        assert_eq!(extra(&cloud, name), Some(&values), "{name}");
    }
    // What is left of an organised cloud is one row, in the same layout; bytes between fields mean nothing and come back as zeros.
    let kept: Vec<u32> = vec![0, 5];
    let again = read(&encode(Format::PointCloud2, &cloud.select(&kept))?)?;
    assert_eq!(again, cloud.select(&kept));
    Ok(())
}

#[test]
fn every_datatype_and_fields_of_several_values_are_read() -> Outcome {
    let cloud = read(&golden("every_datatype")?)?;
    assert_eq!((&cloud.x, &cloud.y), (&each(|i| i as f32 + 0.5), &each(|i| -0.25 * i as f32)));
    assert_eq!((&cloud.intensity, cloud.full_scale), (&each(|i| 300.0 * i as f32), 65535.0));
    for (name, values) in [
        ("i8", Values::I8(each(|i| -(i as i8)))),
        ("u8", Values::U8(each(|i| 250 + i as u8))),
        ("i16", Values::I16(each(|i| -300 * i as i16))),
        ("u16", Values::U16(each(|i| 60_000 + i as u16))),
        ("i32", Values::I32(each(|i| -100_000 * i as i32))),
        ("u32", Values::U32(each(|i| 4_000_000_000 + i as u32))),
        ("f32", Values::F32(each(|i| (0.1 * i as f64) as f32))),
        ("normal_1", Values::F32(each(|i| i as f32 + 10.0))),
    ] {
        assert_eq!(extra(&cloud, name), Some(&values), "{name}");
    }
    assert!(cloud.extra.iter().all(|column| !column.name.starts_with('_')), "padding is no column");
    Ok(())
}

#[test]
fn measured_reflectance_is_rounded_to_the_type_that_intensity_has() -> Outcome {
    let mut cloud = read(&golden("xyzirc")?)?;
    cloud.intensity = vec![0.4, 0.6, 254.6, 300.0, -1.0, f32::NAN];
    let again = read(&encode(Format::PointCloud2, &cloud)?)?;
    assert_eq!(again.intensity, [0.0, 1.0, 255.0, 255.0, 0.0, 0.0]);
    Ok(())
}

/// Bytes in `xyzirc`, which is little-endian, of what the next test changes.
mod place {
    /// The string `lidar_top` has 14 bytes with its length, and two more up to the height.
    pub(super) const HEIGHT: usize = 4 + 8 + 16;
    pub(super) const FIELDS: usize = HEIGHT + 8;
    /// The first field: the text `x`, two bytes up to its offset.
    pub(super) const FIRST_OFFSET: usize = FIELDS + 4 + 8;
    pub(super) const FIRST_TYPE: usize = FIRST_OFFSET + 4;
    pub(super) const FIRST_COUNT: usize = FIRST_TYPE + 4;
}

#[test]
fn messages_that_contradict_themselves_are_refused_by_field() -> Outcome {
    let honest = golden("xyzirc")?;
    let tail = honest.len() - 1 - 16 * POINTS;
    let changed = |at: usize, value: &[u8]| {
        let mut bytes = honest.clone();
        bytes[at..at + value.len()].copy_from_slice(value);
        read(&bytes).err().map(|error| error.to_string()).unwrap_or_default()
    };
    let number = |at: usize, value: u32| changed(at, &value.to_le_bytes());
    for (said, expected) in [
        (changed(0, &[0, 3]), "representation at byte 0"),
        (number(place::HEIGHT, 2), "data at byte"),
        (number(place::HEIGHT, 0), ""),
        (number(place::HEIGHT, u32::MAX), "25769803770 points is more"),
        (number(place::HEIGHT + 4, 7), "row_step at byte"),
        (number(place::FIELDS, u32::MAX), "fields at byte"),
        (number(place::FIRST_OFFSET, 2), "nothing before byte 6 twice, found bytes 4 to 8 for `y`"),
        (number(place::FIRST_OFFSET, 13), "within point_step = 16 bytes"),
        (number(place::FIRST_OFFSET, u32::MAX), "within point_step = 16 bytes"),
        (changed(place::FIRST_TYPE, &[9]), "field datatype"),
        (changed(place::FIRST_TYPE, &[0]), "field datatype"),
        (number(place::FIRST_COUNT, u32::MAX), "numbers a point is more than the limit"),
        (number(place::FIRST_COUNT, 0), ""),
        // The tail: is_bigendian, point_step, row_step, the data and their length, is_dense.
        (number(tail - 12, 0), "within point_step = 0 bytes"),
        (number(tail - 12, 1 << 30), "point_step at byte"),
        (number(tail - 4, u32::MAX), "data at byte"),
        (number(tail - 4, 16 * POINTS as u32 - 16), "end of the message"),
        (changed(tail - 16, &[7]), "is_bigendian at byte"),
        (changed(honest.len() - 1, &[2]), "is_dense at byte"),
    ] {
        assert!(said.contains(expected) && (expected.is_empty() == said.is_empty()), "`{said}` is not `{expected}`");
    }
    Ok(())
}

#[test]
fn a_message_that_nobody_filled_is_an_empty_cloud() -> Outcome {
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend([0; 41]);
    assert!(read(&bytes)?.is_empty());
    assert!(encode(Format::PointCloud2, &read(&bytes)?).is_ok());
    Ok(())
}
