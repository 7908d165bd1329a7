//! Casts an HDL-64E at a street (or a mesh file) and paints what comes back:
//! `cargo run --release -p scene --example look -- FOLDER [SEED | MESH-FILE [X Y [YAW-DEGREES]]]`
//! writes `images.png` (range, class, reflectance, incidence), `cloud.png` (the points, from behind and from above) and
//! `view.png` (the scene as a camera in the sensor's place would see it).

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use image::{Rgb, RgbImage};
use lidar::Sensor;
use lidar::label::class_of;
use scene::street::{StreetConfig, street};
use scene::{Cast, Motion, Pose, Scene, cast, mesh_file};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(arguments.first().ok_or("which FOLDER shall the pictures be written to?")?);
    let seed = arguments.get(1).map_or("1", String::as_str);
    let started = Instant::now();
    let (scene, pose) = if let Ok(seed) = seed.parse() {
        (street(seed, &StreetConfig::default()), Pose::default())
    } else {
        let scene = Scene::new(mesh_file::load(seed)?);
        let number = |i: usize| arguments.get(i).map_or(Ok(0.0), |text| text.parse::<f32>());
        let yaw_rad = number(4)?.to_radians();
        let [x_m, y_m] = nearest_road(&scene, [number(2)?, number(3)?]);
        let pose = Pose::above_ground(&scene, x_m, y_m, yaw_rad).ok_or("no ground at X, Y")?;
        (scene, pose)
    };
    println!("{} triangles in {:.0} ms", scene.mesh().len(), started.elapsed().as_secs_f64() * 1e3);
    let sensor = Sensor::builtin("hdl64e")?;
    let started = Instant::now();
    let scan = cast(&scene, &sensor, &pose, &Motion::default());
    let share = 100.0 * scan.cloud.len() as f64 / sensor.pixels() as f64;
    println!("{} returns ({share:.1} %) in {:.0} ms", scan.cloud.len(), started.elapsed().as_secs_f64() * 1e3);
    std::fs::create_dir_all(folder)?;
    images(&scan).save(folder.join("images.png"))?;
    cloud(&scan).save(folder.join("cloud.png"))?;
    view(&scene, &pose).save(folder.join("view.png"))?;
    Ok(())
}

/// The middle of the piece of road that is nearest to a place; the place itself where there is no road.
fn nearest_road(scene: &Scene, [x_m, y_m]: [f32; 2]) -> [f32; 2] {
    let mesh = scene.mesh();
    let roads = (0..mesh.len()).filter(|i| class_of(mesh.material(*i).label) == 9);
    let middles = roads.map(|i| {
        let [a, b, c] = mesh.corners(i);
        [(a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0]
    });
    let far = |at: &[f32; 2]| (at[0] - x_m).hypot(at[1] - y_m);
    middles.min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or([x_m, y_m])
}

/// The scan's images one below the other, each ring three pixels high.
fn images(scan: &Cast) -> RgbImage {
    let (rings, columns) = (scan.image.rings() as u32, scan.image.columns() as u32);
    let height = 3 * rings + 6;
    RgbImage::from_fn(columns, 4 * height, |x, y| {
        let (picture, row) = (y / height, (y % height) / 3);
        let i = (row.min(rings - 1) * columns + x) as usize;
        let range_m = scan.image.range_m()[i];
        if row >= rings || range_m == 0.0 {
            return Rgb([0, 0, 0]);
        }
        match picture {
            0 => heat(1.0 - (range_m / 1.5).ln() / (120.0f32 / 1.5).ln()),
            1 => class_colour(scan.image.class()[i]),
            2 => grey(scan.image.reflectance()[i].sqrt()),
            _ => heat(1.0 - scan.incidence_rad[i] / 1.571),
        }
    })
}

/// The points seen from behind and above, and straight from above.
fn cloud(scan: &Cast) -> RgbImage {
    let (width, height) = (1600u32, 800u32);
    let mut picture = RgbImage::new(width, 2 * height);
    let mut depth = vec![f32::INFINITY; (width * 2 * height) as usize];
    let (eye, down) = ([-13.0f32, 0.0, 8.0], 0.42f32);
    for i in 0..scan.cloud.len() {
        let (x, y, z) = (scan.cloud.x[i], scan.cloud.y[i], scan.cloud.z[i]);
        let label = scan.cloud.label.as_ref().map_or(0, |l| l[i]);
        let colour = tinted(class_of(label), scan.cloud.intensity[i]);
        let (dx, dz) = (x - eye[0], z - eye[2]);
        let (ahead, up) = (dx * down.cos() - dz * down.sin(), dx * down.sin() + dz * down.cos());
        if ahead > 1.0 {
            let (u, v) = (800.0 - 900.0 * (y - eye[1]) / ahead, 330.0 - 900.0 * up / ahead);
            let size = (16.0 / ahead).clamp(1.0, 3.0) as i32;
            dot(&mut picture, &mut depth, [u, v], [0.0, 800.0], ahead, size, colour);
        }
        let (u, v) = (800.0 + 13.0 * x, 1200.0 - 13.0 * y);
        dot(&mut picture, &mut depth, [u, v], [800.0, 1600.0], 100.0 - z, 1, colour);
    }
    picture
}

fn dot(to: &mut RgbImage, depth: &mut [f32], at: [f32; 2], rows: [f32; 2], far: f32, size: i32, colour: Rgb<u8>) {
    for dy in 0..size {
        for dx in 0..size {
            let (u, v) = (at[0] + dx as f32, at[1] + dy as f32);
            if u >= 0.0 && u < to.width() as f32 && v >= rows[0] && v < rows[1] {
                let i = v as usize * to.width() as usize + u as usize;
                if far < depth[i] {
                    depth[i] = far;
                    to.put_pixel(u as u32, v as u32, colour);
                }
            }
        }
    }
}

/// What a camera two metres above the sensor would see: ahead, and below it to the left, behind and to the right.
fn view(scene: &Scene, pose: &Pose) -> RgbImage {
    let (width, height) = (1600u32, 600u32);
    let mut picture = RgbImage::new(width, 2 * height);
    let origin = [pose.position_m[0], pose.position_m[1], pose.position_m[2] + 0.8].map(f64::from);
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let (span, start) = if y < height { (1.6, 0.8) } else { (4.7, 3.93) };
        let azimuth = f64::from(pose.yaw_rad) + start - span * f64::from(x) / f64::from(width)
            + if y < height { 0.0 } else { 1.57 };
        let elevation = span * (0.17 - f64::from(y % height) / f64::from(width));
        let (sin_e, cos_e) = elevation.sin_cos();
        let direction = [cos_e * azimuth.cos(), cos_e * azimuth.sin(), sin_e];
        *pixel = scene.hit(origin, direction, 400.0).map_or(Rgb([200, 220, 240]), |hit| {
            let light = hit.normal[0] * -0.3 + hit.normal[1] * 0.35 + hit.normal[2] * 0.8;
            let haze = (-hit.distance_m / 250.0).exp() as f32;
            let lit = 0.45 + 0.55 * light.max(0.0) as f32;
            let colour = tinted(class_of(hit.material.label), hit.material.reflectance);
            let sky = [200.0, 220.0, 240.0];
            Rgb(std::array::from_fn(|k| (f32::from(colour.0[k]) * lit * haze + sky[k] * (1.0 - haze)) as u8))
        });
    }
    picture
}

fn grey(value: f32) -> Rgb<u8> {
    Rgb([(255.0 * value.clamp(0.0, 1.0)) as u8; 3])
}

/// From dark blue (0) over green to red (1).
fn heat(value: f32) -> Rgb<u8> {
    let v = value.clamp(0.0, 1.0);
    let hump = |centre: f32| (255.0 * (1.6 - (v - centre).abs() * 4.0).clamp(0.05, 1.0)) as u8;
    Rgb([hump(0.85), hump(0.5), hump(0.15)])
}

/// The class's colour, as bright as the surface.
fn tinted(class: u8, reflectance: f32) -> Rgb<u8> {
    let Rgb(colour) = class_colour(class);
    let bright = 0.3 + 0.9 * reflectance.sqrt();
    Rgb(colour.map(|c| (f32::from(c) * bright).min(255.0) as u8))
}

/// `SemanticKITTI`'s colours.
fn class_colour(class: u8) -> Rgb<u8> {
    const COLOURS: [[u8; 3]; 20] = [
        [120, 120, 120],
        [100, 150, 245],
        [100, 230, 245],
        [30, 60, 150],
        [80, 30, 180],
        [100, 80, 250],
        [255, 30, 30],
        [255, 40, 200],
        [150, 30, 90],
        [255, 0, 255],
        [255, 150, 255],
        [75, 0, 75],
        [175, 0, 75],
        [255, 200, 0],
        [255, 120, 50],
        [0, 175, 0],
        [135, 60, 0],
        [150, 240, 80],
        [255, 240, 150],
        [255, 0, 0],
    ];
    Rgb(COLOURS[usize::from(class).min(19)])
}
