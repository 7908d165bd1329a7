//! Independent libraries read what we write, and we read what they write.

use std::io::Cursor;

use lidar::PointCloud;
use lidar::cloud::{Column, Values};
use lidar::formats::{Format, Limits, decode, encode};
use npyz::npz::NpzArchive;
use pcd_rs::{DataKind, DynReader, DynRecord, Field, Schema, ValueKind, WriterInit};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{
    Addable, DefaultElement, ElementDef, Encoding, Ply, Property, PropertyDef, PropertyType, ScalarType,
};

type Outcome = Result<(), Box<dyn std::error::Error>>;

const POINTS: usize = 70;

fn cloud() -> PointCloud {
    let ramp = |step: f32| (0..POINTS).map(|i| i as f32 * step - 3.0).collect::<Vec<_>>();
    PointCloud {
        x: ramp(0.5),
        y: ramp(-0.25),
        z: ramp(0.01),
        intensity: (0..POINTS).map(|i| i as f32 * 0.01).collect(),
        full_scale: 1.0,
        ring: Some((0..POINTS).map(|i| i as u16 * 900).collect()),
        label: Some((0..POINTS).map(|i| i as u32 * 60_000_000).collect()),
        time_s: Some((0..POINTS).map(|i| i as f64 * 1e-6).collect()),
        return_number: Some((0..POINTS).map(|i| 1 + i as u8 % 3).collect()),
        extra: vec![Column { name: "echo".into(), values: Values::I16((0..POINTS).map(|i| -(i as i16)).collect()) }],
        ros: None,
    }
}

fn read(format: Format, bytes: &[u8]) -> Result<PointCloud, lidar::formats::FormatError> {
    decode(format, bytes, &Limits::default())
}

#[test]
fn ply_rs_reads_our_ply() -> Outcome {
    let bytes = encode(Format::Ply, &cloud())?;
    let ply = Parser::<DefaultElement>::new().read_ply(&mut Cursor::new(bytes))?;
    let vertices = &ply.payload["vertex"];
    assert_eq!(vertices.len(), POINTS);
    for (i, vertex) in vertices.iter().enumerate() {
        assert_eq!(vertex["x"], Property::Float(cloud().x[i]));
        assert_eq!(vertex["intensity"], Property::Float(cloud().intensity[i]));
        assert_eq!(vertex["ring"], Property::UShort(i as u16 * 900));
        assert_eq!(vertex["label"], Property::UInt(i as u32 * 60_000_000));
        assert_eq!(vertex["time"], Property::Double(i as f64 * 1e-6));
        assert_eq!(vertex["echo"], Property::Short(-(i as i16)));
    }
    Ok(())
}

#[test]
fn we_read_ply_of_ply_rs_in_all_its_encodings() -> Outcome {
    let scalars = [
        ("x", ScalarType::Double),
        ("y", ScalarType::Float),
        ("z", ScalarType::Short),
        ("reflectivity", ScalarType::UShort),
        ("channel", ScalarType::UChar),
        ("t", ScalarType::UInt),
        ("odd", ScalarType::Char),
    ];
    let mut face = ElementDef::new("face".into());
    let list = PropertyType::List(ScalarType::UChar, ScalarType::Int);
    face.properties.add(PropertyDef::new("vertex_indices".into(), list));
    let mut vertex = ElementDef::new("vertex".into());
    for (name, scalar) in scalars {
        vertex.properties.add(PropertyDef::new(name.into(), PropertyType::Scalar(scalar)));
    }
    let points: Vec<DefaultElement> = (0..POINTS as u8)
        .map(|i| {
            let mut point = DefaultElement::new();
            point.insert("x".into(), Property::Double(f64::from(i) * 0.1));
            point.insert("y".into(), Property::Float(f32::from(i)));
            point.insert("z".into(), Property::Short(-i16::from(i)));
            point.insert("reflectivity".into(), Property::UShort(u16::from(i) * 900));
            point.insert("channel".into(), Property::UChar(i));
            point.insert("t".into(), Property::UInt(u32::from(i) * 1_000_000));
            point.insert("odd".into(), Property::Char(-1));
            point
        })
        .collect();
    let faces = (0..3).map(|i| {
        let mut face = DefaultElement::new();
        face.insert("vertex_indices".into(), Property::ListInt((0..i).collect()));
        face
    });
    for encoding in [Encoding::Ascii, Encoding::BinaryBigEndian, Encoding::BinaryLittleEndian] {
        let mut ply = Ply::<DefaultElement>::new();
        ply.header.encoding = encoding;
        // Faces first: they must be stepped over.
        ply.header.elements.add(face.clone());
        ply.header.elements.add(vertex.clone());
        ply.payload.insert("face".into(), faces.clone().collect());
        ply.payload.insert("vertex".into(), points.clone());
        let mut bytes = Vec::new();
        ply_rs_bw::writer::Writer::new().write_ply(&mut bytes, &mut ply)?;
        let cloud = read(Format::Ply, &bytes)?;
        assert_eq!(cloud.x, (0..POINTS).map(|i| (i as f64 * 0.1) as f32).collect::<Vec<_>>());
        assert_eq!(cloud.z, (0..POINTS).map(|i| -(i as f32)).collect::<Vec<_>>());
        assert_eq!((cloud.intensity[69], cloud.full_scale), (69.0 * 900.0, 65535.0));
        assert_eq!(cloud.ring, Some((0..POINTS as u16).collect()));
        assert_eq!(cloud.time_s.as_ref().and_then(|time| time.last()), Some(&0.069));
        assert_eq!(cloud.extra, [Column { name: "odd".into(), values: Values::I8(vec![-1; POINTS]) }]);
    }
    Ok(())
}

#[test]
fn pcd_rs_reads_our_pcd() -> Outcome {
    let bytes = encode(Format::Pcd, &cloud())?;
    let records = DynReader::from_reader(Cursor::new(bytes))?.collect::<Result<Vec<_>, _>>()?;
    assert_eq!(records.len(), POINTS);
    for (i, DynRecord(fields)) in records.iter().enumerate() {
        assert_eq!(fields[2].to_value::<f32>(), Some(cloud().z[i]));
        assert_eq!(fields[4].to_value::<u16>(), Some(i as u16 * 900));
        assert_eq!(fields[8].to_value::<i16>(), Some(-(i as i16)));
    }
    Ok(())
}

#[test]
fn we_read_pcd_of_pcd_rs_in_all_its_encodings() -> Outcome {
    let schema = [
        ("x", ValueKind::F32, 1),
        ("y", ValueKind::F64, 1),
        ("z", ValueKind::F32, 1),
        ("intensity", ValueKind::U8, 1),
        ("normal", ValueKind::F32, 3),
        ("ring", ValueKind::U16, 1),
    ];
    for data_kind in [DataKind::Ascii, DataKind::Binary, DataKind::BinaryCompressed] {
        let file = tempfile::NamedTempFile::new()?;
        let init = WriterInit {
            width: POINTS as u64,
            height: 1,
            viewpoint: pcd_rs::ViewPoint::default(),
            data_kind,
            schema: Some(Schema::from_iter(schema)),
            version: None,
        };
        let mut writer = init.create::<DynRecord, _>(file.path())?;
        for i in 0..POINTS {
            writer.push(&DynRecord(vec![
                Field::F32(vec![i as f32]),
                Field::F64(vec![0.5]),
                Field::F32(vec![if i == 3 { f32::NAN } else { 1.0 }]),
                Field::U8(vec![i as u8]),
                Field::F32(vec![0.0, 1.0, i as f32]),
                Field::U16(vec![i as u16]),
            ]))?;
        }
        writer.finish()?;
        let cloud = read(Format::Pcd, &std::fs::read(file.path())?)?;
        assert_eq!(cloud.x, (0..POINTS).map(|i| i as f32).collect::<Vec<_>>(), "{data_kind:?}");
        assert_eq!((cloud.y[9], cloud.z[3].is_nan(), cloud.z[4]), (0.5, true, 1.0));
        assert_eq!((cloud.intensity[69], cloud.full_scale), (69.0, 255.0));
        assert_eq!(cloud.ring, Some((0..POINTS as u16).collect()));
        assert_eq!(cloud.extra[2].name, "normal_2");
        assert_eq!(cloud.extra[2].values, Values::F32((0..POINTS).map(|i| i as f32).collect()));
    }
    Ok(())
}

#[test]
fn npyz_reads_our_arrays() -> Outcome {
    let npy = npyz::NpyFile::new(Cursor::new(encode(Format::Npy, &cloud())?))?;
    assert_eq!(npy.shape(), [POINTS as u64]);
    assert!(npy.dtype().descr().contains("('label', '<u4')"), "{}", npy.dtype().descr());

    let mut npz = NpzArchive::new(Cursor::new(encode(Format::Npz, &cloud())?))?;
    let array = npz.by_name("xyz")?.ok_or("no xyz")?;
    assert_eq!(array.shape(), [POINTS as u64, 3]);
    assert_eq!(array.into_vec::<f32>()?[3..6], [cloud().x[1], cloud().y[1], cloud().z[1]]);
    let label: Vec<u32> = npz.by_name("label")?.ok_or("no label")?.into_vec()?;
    assert_eq!(Some(label), cloud().label);
    Ok(())
}

#[test]
fn padding_between_numpy_fields_is_no_column() -> Outcome {
    // What numpy.save writes for an aligned type of f4, u1, f8, f8.
    let header = "{'descr': [('x', '<f4'), ('i', '|u1'), ('', '|V3'), ('y', '<f8'), ('z', '<f8')], \
                  'fortran_order': False, 'shape': (1,), }";
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(1.0_f32.to_le_bytes());
    bytes.extend([77, 9, 9, 9]);
    bytes.extend([2.0_f64, 3.0].map(f64::to_le_bytes).concat());
    let cloud = read(Format::Npy, &bytes)?;
    assert_eq!((cloud.x[0], cloud.y[0], cloud.z[0], cloud.intensity[0]), (1.0, 2.0, 3.0, 77.0));
    assert!(cloud.extra.is_empty(), "{:?}", cloud.extra);
    Ok(())
}

#[test]
fn las_reads_our_las_and_laz() -> Outcome {
    for format in [Format::Las, Format::Laz] {
        let mut reader = las::Reader::new(Cursor::new(encode(format, &cloud())?))?;
        let points = reader.read_all()?;
        assert_eq!(points.len(), POINTS);
        for (i, point) in points.points().enumerate() {
            let point = point?;
            assert!((point.x - f64::from(cloud().x[i])).abs() < 0.51e-4);
            assert_eq!(point.intensity, (i as f32 * 0.01 * 65535.0).round() as u16);
            assert_eq!(point.return_number, 1 + i as u8 % 3);
            assert_eq!(point.gps_time, Some(i as f64 * 1e-6));
        }
    }
    Ok(())
}

/// A point whose every attribute changes, the GPS time among several interleaved sequences and with jumps between them.
fn las_point(i: usize, format: las::point::Format) -> las::Point {
    let gps_time = match i % 11 {
        0..4 | 8 => 1e5 + i as f64 * 1e-5,
        4..7 => 2e5 + i as f64 * 1e-3,
        7 => 3e5 - i as f64,
        _ => i as f64 * 977.0 % 13.0,
    };
    las::Point {
        x: i as f64 * 0.01 - 5.0,
        y: (i * i % 101) as f64 * 0.1,
        z: (i % 7) as f64,
        intensity: (i * 37 % 4001) as u16,
        return_number: 1 + (i % 3) as u8,
        number_of_returns: 3,
        user_data: i as u8,
        point_source_id: (i % 5) as u16,
        scan_angle: (i % 30) as f32,
        gps_time: format.has_gps_time.then_some(gps_time),
        color: format.has_color.then(|| las::Color::new(i as u16, (2 * i) as u16, 9)),
        nir: format.has_nir.then_some(i as u16),
        waveform: format.has_waveform.then(las::raw::point::Waveform::default),
        extra_bytes: vec![i as u8, 7],
        ..las::Point::default()
    }
}

#[test]
fn we_read_every_point_format_of_las() -> Outcome {
    const MANY: usize = 60_000;
    for (number, is_compressed) in (0..=10).flat_map(|number| [(number, false), (number, true)]) {
        let mut builder = las::Builder::default();
        builder.version = las::Version::new(1, 4);
        builder.point_format = las::point::Format::new(number)?;
        builder.point_format.extra_bytes = 2;
        builder.point_format.is_compressed = is_compressed;
        let format = builder.point_format;
        let mut writer = las::Writer::new(Cursor::new(Vec::new()), builder.into_header()?)?;
        for i in 0..MANY {
            writer.write_point(las_point(i, format))?;
        }
        let bytes = writer.into_inner()?.into_inner();
        let cloud = read(Format::Las, &bytes).map_err(|error| format!("{number} {is_compressed}: {error}"))?;
        let points = las::Reader::new(Cursor::new(bytes))?.read_all()?;
        let column = |name: &str| cloud.extra.iter().find(|column| column.name == name).map(|column| &column.values);
        assert!(cloud.x.iter().copied().eq(points.x().map(|x| x as f32)), "{number} {is_compressed}");
        assert!(cloud.z.iter().copied().eq(points.z().map(|z| z as f32)));
        assert!(cloud.intensity.iter().copied().eq(points.intensity().map(f32::from)));
        assert_eq!(cloud.return_number, Some(points.return_number().collect()));
        assert_eq!(column("user_data"), Some(&Values::U8(points.user_data().collect())));
        assert_eq!(column("point_source_id"), Some(&Values::U16(points.point_source_id().collect())));
        assert_eq!(column("extra_byte_0"), Some(&Values::U8((0..MANY).map(|i| i as u8).collect())));
        assert_eq!(column("red").is_some(), format.has_color);
        assert_eq!(column("nir").is_some(), format.has_nir);
        // The GPS time of layered LAZ is left out.
        let gps_time = points.gps_time().filter(|_| !(is_compressed && format.is_extended));
        assert_eq!(cloud.time_s, gps_time.map(Iterator::collect), "{number} {is_compressed}");
    }
    Ok(())
}
