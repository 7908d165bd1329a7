//! Pictures inside the page: PNGs as `data:` addresses.

use std::io::Cursor;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::{ImageFormat, Rgb, RgbImage};
use lidar::RangeImage;
use lidar::picture::range_colour;

/// Colour of what was not measured.
const NOTHING: [u8; 3] = [232, 232, 236];

/// Colours of a residual from far below 0 to far above: the scale `RdBu` (Harrower and Brewer 2003), told apart by every eye.
pub(super) const DIVERGING: [[u8; 3]; 9] = [
    [33, 102, 172],
    [67, 147, 195],
    [146, 197, 222],
    [209, 229, 240],
    [247, 247, 247],
    [253, 219, 199],
    [244, 165, 130],
    [214, 96, 77],
    [178, 24, 43],
];

/// A map of residuals, a pixel a ray, full colour at ±`scale`.
pub(super) fn residuals(mean: &[f32], columns: usize, scale: f64) -> anyhow::Result<String> {
    let rings = mean.len() / columns.max(1);
    png(&RgbImage::from_fn(columns as u32, rings as u32, |x, y| {
        let value = f64::from(mean[y as usize * columns + x as usize]);
        Rgb(if value.is_nan() { NOTHING } else { diverging(value / scale) })
    }))
}

/// The ranges of a scan, a pixel a ray.
pub(super) fn ranges(scan: &RangeImage) -> anyhow::Result<String> {
    png(&RgbImage::from_fn(scan.columns() as u32, scan.rings() as u32, |x, y| {
        range_colour(scan.range_m()[y as usize * scan.columns() + x as usize])
    }))
}

/// The colour at −1 … 1, between the nearest two of the list.
fn diverging(x: f64) -> [u8; 3] {
    let at = (x.clamp(-1.0, 1.0) + 1.0) * 0.5 * (DIVERGING.len() - 1) as f64;
    let from = (at.floor() as usize).min(DIVERGING.len() - 2);
    let part = at - from as f64;
    let mix = |c: usize| {
        let [a, b] = [DIVERGING[from][c], DIVERGING[from + 1][c]].map(f64::from);
        (a + part * (b - a)).round() as u8
    };
    [mix(0), mix(1), mix(2)]
}

fn png(picture: &RgbImage) -> anyhow::Result<String> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(bytes.into_inner())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_left_is_white_and_the_ends_are_blue_and_red() {
        assert_eq!(diverging(0.0), DIVERGING[4]);
        assert_eq!(diverging(-7.0), DIVERGING[0]);
        assert_eq!(diverging(1.0), DIVERGING[8]);
        assert_eq!(diverging(0.125), [250, 233, 223]);
    }

    #[test]
    fn a_map_is_a_picture_with_a_pixel_a_ray() -> anyhow::Result<()> {
        let address = residuals(&[0.0, 1.0, f32::NAN, -1.0, 0.5, 0.0], 3, 1.0)?;
        let bytes = STANDARD.decode(address.trim_start_matches("data:image/png;base64,"))?;
        let picture = image::load_from_memory(&bytes)?.to_rgb8();
        assert_eq!(picture.dimensions(), (3, 2));
        assert_eq!(picture.get_pixel(2, 0).0, NOTHING);
        assert_eq!(picture.get_pixel(0, 1).0, DIVERGING[0]);
        Ok(())
    }
}
