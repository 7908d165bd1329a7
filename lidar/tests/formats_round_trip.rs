//! What is written is what is read, for every format and any cloud.

use lidar::PointCloud;
use lidar::cloud::{Column, Values};
use lidar::formats::{Format, Limits, decode, encode};
use proptest::collection::vec;
use proptest::prelude::*;

type Outcome = Result<(), TestCaseError>;

/// Extra columns of every number type.
fn extra(points: usize) -> impl Strategy<Value = Vec<Column>> {
    let values = prop_oneof![
        vec(any::<i8>(), points).prop_map(Values::I8),
        vec(any::<u8>(), points).prop_map(Values::U8),
        vec(any::<i16>(), points).prop_map(Values::I16),
        vec(any::<u16>(), points).prop_map(Values::U16),
        vec(any::<i32>(), points).prop_map(Values::I32),
        vec(any::<u32>(), points).prop_map(Values::U32),
        vec(any::<i64>(), points).prop_map(Values::I64),
        vec(any::<u64>(), points).prop_map(Values::U64),
        vec(any::<f32>(), points).prop_map(Values::F32),
        // The crate `laz` writes a GPS time of 0 after one of −0 as −0 too: adding 0 leaves only the one.
        vec(any::<f64>().prop_map(|time| time + 0.0), points).prop_map(Values::F64),
    ];
    let name = prop_oneof![
        "[a-z]{3}_[a-z]{1,8}",
        Just("user_data".to_owned()),
        Just("gps_time".to_owned()),
        Just("red".to_owned()),
        Just("scan_angle_deg".to_owned()),
        Just("las_classification".to_owned()),
    ];
    vec((name, values), 0..4).prop_map(|columns| {
        let mut unique: Vec<Column> = Vec::new();
        for (name, values) in columns {
            if unique.iter().all(|column| column.name != name) {
                unique.push(Column { name, values });
            }
        }
        unique
    })
}

/// Intensities with their scale: bytes, 16 bits, or floats of any scale.
fn intensity(points: usize) -> impl Strategy<Value = (Vec<f32>, f32)> {
    prop_oneof![
        vec((0_u8..=255).prop_map(f32::from), points).prop_map(|v| (v, 255.0)),
        vec(any::<u16>().prop_map(f32::from), points).prop_map(|v| (v, 65535.0)),
        vec(0.0_f32..1.0, points).prop_map(|v| (v, 1.0)),
        vec(0.0_f32..1.0, points).prop_map(|v| (v, 255.0)),
        vec(0.0_f32..300.0, points).prop_map(|v| (v, 255.0)),
    ]
}

fn cloud() -> impl Strategy<Value = PointCloud> {
    (0_usize..60).prop_flat_map(|points| {
        let metres = || vec(-300.0_f32..300.0, points);
        let option = proptest::option::of::<BoxedStrategy<_>>;
        (
            (metres(), metres(), metres(), intensity(points)),
            proptest::option::of(vec(any::<u16>(), points)),
            option(vec(any::<u32>(), points).boxed()),
            proptest::option::of(vec(-1e9_f64..1e9, points)),
            proptest::option::of(vec(any::<u8>(), points)),
            extra(points),
        )
            .prop_map(|((x, y, z, (intensity, full_scale)), ring, label, time_s, return_number, extra)| {
                PointCloud { x, y, z, intensity, full_scale, ring, label, time_s, return_number, extra, ros: None }
            })
    })
}

fn there_and_back(format: Format, cloud: &PointCloud) -> Result<PointCloud, TestCaseError> {
    let bytes = encode(format, cloud).map_err(|e| TestCaseError::fail(e.to_string()))?;
    decode(format, &bytes, &Limits::default()).map_err(|e| TestCaseError::fail(e.to_string()))
}

/// Bits, because NaN is a value like any other here.
fn bits(values: &Values) -> (std::mem::Discriminant<Values>, Vec<u64>) {
    let bits = match values {
        Values::F32(v) => v.iter().map(|v| u64::from(v.to_bits())).collect(),
        Values::F64(v) => v.iter().map(|v| v.to_bits()).collect(),
        Values::I64(v) => v.iter().map(|&v| v as u64).collect(),
        Values::U64(v) => v.clone(),
        others => others.to_f64().iter().map(|v| v.to_bits()).collect(),
    };
    (std::mem::discriminant(values), bits)
}

/// Every field but coordinates; extra columns in any order.
fn same_fields(read: &PointCloud, written: &PointCloud) -> Outcome {
    prop_assert_eq!(&read.intensity, &written.intensity);
    prop_assert_eq!(&read.ring, &written.ring);
    prop_assert_eq!(&read.label, &written.label);
    prop_assert_eq!(&read.time_s, &written.time_s);
    prop_assert_eq!(&read.return_number, &written.return_number);
    let names = |cloud: &PointCloud| {
        let mut names: Vec<_> = cloud.extra.iter().map(|column| column.name.clone()).collect();
        names.sort();
        names
    };
    prop_assert_eq!(names(read), names(written));
    for column in &written.extra {
        let found = read.extra.iter().find(|other| other.name == column.name);
        prop_assert_eq!(found.map(|c| bits(&c.values)), Some(bits(&column.values)), "{}", column.name);
    }
    Ok(())
}

fn same_coordinates(read: &PointCloud, written: &PointCloud) -> Outcome {
    prop_assert_eq!((&read.x, &read.y, &read.z), (&written.x, &written.y, &written.z));
    Ok(())
}

fn las_keeps_every_field(format: Format, cloud: &PointCloud) -> Outcome {
    let read = there_and_back(format, cloud)?;
    same_fields(&read, cloud)?;
    prop_assert_eq!(read.full_scale, cloud.full_scale);
    for (read, written) in [(&read.x, &cloud.x), (&read.y, &cloud.y), (&read.z, &cloud.z)] {
        for (read, written) in read.iter().zip(written) {
            // Half a step of 0.1 mm and half a step of f32 at 300 m.
            prop_assert!((read - written).abs() <= 0.5e-4 + 1.6e-5, "{read} {written}");
        }
    }
    // The steps are a fixed point: writing again changes nothing.
    prop_assert_eq!(&there_and_back(format, &read)?.x, &read.x);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn ply_keeps_every_field(cloud in cloud()) {
        let mut cloud = cloud;
        // 64-bit integers become doubles.
        cloud.extra.retain(|column| !matches!(column.values, Values::I64(_) | Values::U64(_)));
        let read = there_and_back(Format::Ply, &cloud)?;
        same_coordinates(&read, &cloud)?;
        same_fields(&read, &cloud)?;
        prop_assert_eq!(read.full_scale, cloud.full_scale);
    }

    #[test]
    fn pcd_keeps_every_field(cloud in cloud()) {
        let read = there_and_back(Format::Pcd, &cloud)?;
        same_coordinates(&read, &cloud)?;
        same_fields(&read, &cloud)?;
        prop_assert_eq!(read.full_scale, cloud.full_scale);
    }

    #[test]
    fn npz_keeps_every_field(cloud in cloud()) {
        let read = there_and_back(Format::Npz, &cloud)?;
        same_coordinates(&read, &cloud)?;
        same_fields(&read, &cloud)?;
        prop_assert_eq!(read.full_scale, cloud.full_scale);
    }

    #[test]
    fn npy_keeps_every_field_and_guesses_the_scale(cloud in cloud()) {
        let read = there_and_back(Format::Npy, &cloud)?;
        same_coordinates(&read, &cloud)?;
        same_fields(&read, &cloud)?;
    }

    #[test]
    fn las_keeps_every_field_and_a_tenth_of_a_millimetre(cloud in cloud()) {
        las_keeps_every_field(Format::Las, &cloud)?;
    }

    #[test]
    fn laz_keeps_every_field_and_a_tenth_of_a_millimetre(cloud in cloud()) {
        las_keeps_every_field(Format::Laz, &cloud)?;
    }

    #[test]
    fn ros_messages_keep_every_field_and_guess_the_scale(cloud in cloud()) {
        let mut cloud = cloud;
        // 64-bit integers become doubles.
        cloud.extra.retain(|column| !matches!(column.values, Values::I64(_) | Values::U64(_)));
        let read = there_and_back(Format::PointCloud2, &cloud)?;
        same_coordinates(&read, &cloud)?;
        same_fields(&read, &cloud)?;
        // Now it has a layout of its own, and keeps it.
        prop_assert_eq!(there_and_back(Format::PointCloud2, &read)?.ros, read.ros);
    }

    #[test]
    fn kitti_keeps_its_four_numbers(cloud in cloud()) {
        let read = there_and_back(Format::Kitti, &cloud)?;
        same_coordinates(&read, &cloud)?;
        prop_assert_eq!(there_and_back(Format::Kitti, &read)?, read);
    }

    #[test]
    fn nuscenes_keeps_its_five_numbers(cloud in cloud()) {
        let read = there_and_back(Format::NuScenes, &cloud)?;
        same_coordinates(&read, &cloud)?;
        prop_assert_eq!(&read.ring, &cloud.ring.clone().or(cloud.is_empty().then(Vec::new)));
        prop_assert_eq!(there_and_back(Format::NuScenes, &read)?, read);
    }

    #[test]
    fn carla_semantic_keeps_tags_and_objects(cloud in cloud()) {
        let read = there_and_back(Format::CarlaSemantic, &cloud)?;
        same_coordinates(&read, &cloud)?;
        prop_assert_eq!(there_and_back(Format::CarlaSemantic, &read)?, read);
    }
}
