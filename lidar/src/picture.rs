//! Pictures of range images: what a person looks at.

use std::io::Cursor;

use font8x8::legacy::BASIC_LEGACY;
use image::{ImageFormat, Rgb, RgbImage};
use thiserror::Error;

use crate::birds_eye::{BirdsEye, Outline};
use crate::range_image::RangeImage;

/// Colour of what is not there: no return, no ray.
const NOTHING: Rgb<u8> = Rgb([18, 18, 24]);
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);
const INK: Rgb<u8> = Rgb([30, 30, 36]);
/// Colour of what is outlined.
const OUTLINE: Rgb<u8> = Rgb([255, 214, 64]);

/// Margin around and between panels, in pixels.
const MARGIN: u32 = 12;
/// Height of a line of text.
const LINE: u32 = 20;

/// A picture that could not be encoded.
#[derive(Debug, Error)]
#[error("cannot encode PNG: {0}")]
pub struct PictureError(#[from] image::ImageError);

/// The middle half turn (90° left to 90° right of straight ahead) of a scan before and after, as one PNG: range, reflectance and ray
/// drop in rows, before and after in columns.
///
/// # Panics
/// If the two differ in size.
pub fn before_after(before: &RangeImage, after: &RangeImage) -> Result<Vec<u8>, PictureError> {
    let size = (before.rings(), before.columns());
    assert_eq!(size, (after.rings(), after.columns()), "images of one size");
    let kept = |i: usize| match (before.range_m()[i] > 0.0, after.range_m()[i] > 0.0) {
        (true, true) => Rgb([86, 180, 120]),
        (true, false) => Rgb([214, 69, 65]),
        (false, _) => NOTHING,
    };
    let returned = |i: usize| if before.range_m()[i] > 0.0 { Rgb([86, 180, 120]) } else { NOTHING };
    let panels = [
        [panel(before, |i| range_colour(before.range_m()[i])), panel(before, |i| range_colour(after.range_m()[i]))],
        [panel(before, |i| reflectance_colour(before, i)), panel(before, |i| reflectance_colour(after, i))],
        [panel(before, returned), panel(before, kept)],
    ];
    let captions = [
        ["range, simulated (near: red, far: blue)", "range, as the sensor reports it"],
        ["reflectance, simulated", "reflectance, as the sensor reports it"],
        ["rays with a return (green)", "ray drop: reported (green), dropped (red)"],
    ];
    encode(&sheet(&panels, &captions))
}

/// Range and reflectance of one scan, its whole turn, as one PNG.
pub fn scan(image: &RangeImage) -> Result<Vec<u8>, PictureError> {
    let whole = |colour: &dyn Fn(usize) -> Rgb<u8>| {
        let (rows, columns) = (image.rings() as u32 * 4, image.columns() as u32);
        RgbImage::from_fn(columns, rows, |x, y| colour((y / 4 * columns + x) as usize))
    };
    let range = whole(&|i| range_colour(image.range_m()[i]));
    let reflectance = whole(&|i| reflectance_colour(image, i));
    encode(&sheet(&[[range], [reflectance]], &[["range"], ["reflectance"]]))
}

/// The middle half turns of several scans side by side, each with its caption, as one PNG: range above, reflectance below.
///
/// # Panics
/// If there is none, or they differ in size.
pub fn beside<const N: usize>(scans: &[(&RangeImage, &str); N]) -> Result<Vec<u8>, PictureError> {
    let size = |image: &RangeImage| (image.rings(), image.columns());
    assert!(scans.iter().all(|(image, _)| size(image) == size(scans[0].0)), "images of one size");
    let range = scans.map(|(image, _)| panel(image, |i| range_colour(image.range_m()[i])));
    let reflectance = scans.map(|(image, _)| panel(image, |i| reflectance_colour(image, i)));
    let captions = scans.map(|(_, caption)| caption);
    encode(&sheet(&[range, reflectance], &[captions, captions.map(|_| "reflectance")]))
}

/// The middle half turns of any number of scans one below the other, each with its caption, as one PNG: range left, reflectance right.
///
/// # Panics
/// If there is none, or they differ in size.
pub fn stacked(scans: &[(&RangeImage, &str)]) -> Result<Vec<u8>, PictureError> {
    let size = |image: &RangeImage| (image.rings(), image.columns());
    assert!(scans.iter().all(|(image, _)| size(image) == size(scans[0].0)), "images of one size");
    let panels = |(image, _): &(&RangeImage, &str)| {
        [panel(image, |i| range_colour(image.range_m()[i])), panel(image, |i| reflectance_colour(image, i))]
    };
    let panels: Vec<_> = scans.iter().map(panels).collect();
    let captions: Vec<_> = scans.iter().map(|(_, caption)| [*caption, "reflectance"]).collect();
    encode(&sheet(&panels, &captions))
}

/// Scans from above side by side, each with its caption and outlines over it, as one PNG: height is red, reflectance green, density blue, by
/// their square roots.
///
/// # Panics
/// If there is none, or they differ in size.
pub fn from_above<const N: usize>(scans: &[(&BirdsEye, &[Outline], &str); N]) -> Result<Vec<u8>, PictureError> {
    assert!(scans.iter().all(|(scan, ..)| scan.cells == scans[0].0.cells), "images of one size");
    let panels = scans.map(|(scan, outlines, _)| {
        let (side, wide) = (scan.cells as u32, (512 / scan.cells as u32).max(1));
        let shade = |value: f32| (18.0 + 237.0 * value.clamp(0.0, 1.0).sqrt()) as u8;
        let colour = |i: usize| Rgb([0, 1, 2].map(|channel| shade(scan.channel(channel)[i])));
        let mut panel =
            RgbImage::from_fn(side * wide, side * wide, |x, y| colour((y / wide * side + x / wide) as usize));
        for corners in outlines {
            for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
                line(&mut panel, *from, *to, wide as f32);
            }
        }
        panel
    });
    encode(&sheet(&[panels], &[scans.map(|(.., caption)| caption)]))
}

/// A line between two places of a panel, each row and column, whose cells are so many pixels wide.
fn line(panel: &mut RgbImage, from: [f32; 2], to: [f32; 2], wide: f32) {
    let pixel = |place: [f32; 2]| place.map(|cell| (cell + 0.5) * wide);
    let ([y0, x0], [y1, x1]) = (pixel(from), pixel(to));
    let steps = (y1 - y0).abs().max((x1 - x0).abs()).ceil().clamp(1.0, 1e4);
    for step in 0..=steps as u32 {
        let part = step as f32 / steps;
        let (x, y) = (x0 + part * (x1 - x0), y0 + part * (y1 - y0));
        if x >= 0.0 && y >= 0.0 && x < panel.width() as f32 && y < panel.height() as f32 {
            panel.put_pixel(x as u32, y as u32, OUTLINE);
        }
    }
}

/// Colour of a range: Turbo over the logarithm from 2 m (red) to 100 m (blue).
///
/// Turbo: Anton Mikhailov, "Turbo, An Improved Rainbow Colormap for Visualization", Google AI Blog 2019, polynomial form.
pub fn range_colour(range_m: f32) -> Rgb<u8> {
    if range_m <= 0.0 {
        return NOTHING;
    }
    let near = 1.0 - ((range_m / 2.0).ln() / 50f32.ln()).clamp(0.0, 1.0);
    turbo(0.08 + 0.8 * near)
}

/// Colour of a reflectance: black to white by its square root, since most of the world is dark.
fn reflectance_colour(image: &RangeImage, i: usize) -> Rgb<u8> {
    if image.range_m()[i] <= 0.0 {
        return NOTHING;
    }
    let value = (30.0 + 225.0 * image.reflectance()[i].clamp(0.0, 1.0).sqrt()) as u8;
    Rgb([value, value, value])
}

fn turbo(t: f32) -> Rgb<u8> {
    let polynomial = |c: [f32; 6]| {
        let value = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
        (255.0 * value.clamp(0.0, 1.0)) as u8
    };
    Rgb([
        polynomial([0.135_721, 4.615_392, -42.660_32, 132.131_08, -152.942_4, 59.286_38]),
        polynomial([0.091_402_6, 2.194_188, 4.842_966, -14.185_033, 4.277_298, 2.829_566]),
        polynomial([0.106_673, 12.641_946, -60.582_05, 110.362_77, -89.903_11, 27.348_25]),
    ])
}

/// The middle half of the columns, each ring as many pixels high as makes 256 rows or more.
fn panel(image: &RangeImage, colour: impl Fn(usize) -> Rgb<u8>) -> RgbImage {
    let (rings, columns) = (image.rings(), image.columns());
    let height = (256 / rings).max(2);
    let width = (1024 / (columns / 2)).max(1);
    RgbImage::from_fn((columns / 2 * width) as u32, (rings * height) as u32, |x, y| {
        colour(y as usize / height * columns + columns / 4 + x as usize / width)
    })
}

fn sheet<const N: usize>(panels: &[[RgbImage; N]], captions: &[[&str; N]]) -> RgbImage {
    let (w, h) = panels[0][0].dimensions();
    let (rows, columns) = (panels.len() as u32, N as u32);
    let mut out = RgbImage::from_pixel(columns * (w + MARGIN) + MARGIN, rows * (h + MARGIN + LINE) + MARGIN, PAPER);
    for (row, (panels, captions)) in panels.iter().zip(captions).enumerate() {
        for (column, (panel, caption)) in panels.iter().zip(captions).enumerate() {
            let x = MARGIN + column as u32 * (w + MARGIN);
            let y = MARGIN + row as u32 * (h + MARGIN + LINE);
            write(&mut out, caption, x, y);
            image::imageops::replace(&mut out, panel, i64::from(x), i64::from(y + LINE));
        }
    }
    out
}

/// Writes a line of ASCII text, each dot of the font two pixels wide and high.
fn write(out: &mut RgbImage, text: &str, x: u32, y: u32) {
    for (k, letter) in text.chars().enumerate() {
        let Some(glyph) = BASIC_LEGACY.get(letter as usize) else { continue };
        for (row, bits) in glyph.iter().enumerate() {
            for bit in (0..8).filter(|bit| bits >> bit & 1 == 1) {
                let (left, top) = (x + 2 * (8 * k as u32 + bit), y + 2 * row as u32);
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    if left + dx < out.width() && top + dy < out.height() {
                        out.put_pixel(left + dx, top + dy, INK);
                    }
                }
            }
        }
    }
}

fn encode(picture: &RgbImage) -> Result<Vec<u8>, PictureError> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::birds_eye::Grid;

    #[test]
    fn scans_are_stacked_in_their_order() -> Result<(), Box<dyn std::error::Error>> {
        let near = RangeImage::from_channels(8, vec![5.0; 16], vec![0.5; 16], vec![0; 16]);
        let far = RangeImage::from_channels(8, vec![50.0; 16], vec![0.5; 16], vec![0; 16]);
        let picture = image::load_from_memory(&stacked(&[(&near, "near"), (&far, "far")])?)?.to_rgb8();
        let has = |y: u32, range_m: f32| *picture.get_pixel(MARGIN, y) == range_colour(range_m);
        let near = (0..picture.height()).rfind(|y| has(*y, 5.0));
        let far = (0..picture.height()).find(|y| has(*y, 50.0));
        assert!(near.is_some() && near < far, "{near:?} {far:?}");
        Ok(())
    }

    #[test]
    fn what_is_outlined_is_drawn_where_it_is() -> Result<(), Box<dyn std::error::Error>> {
        let grid = Grid { reach_m: 8.0, cell_m: 1.0, height_m: [-2.0, 2.0] };
        let scan = grid.see([[4.5, 4.5, 2.0, 1.0]]);
        let square = [[7.0, 1.0], [7.0, 7.0], [1.0, 7.0], [1.0, 1.0]].map(|corner| grid.place(corner));
        let picture = image::load_from_memory(&from_above(&[(&scan, &[square], "a return")])?)?.to_rgb8();
        let wide = 512 / 16;
        let at = |x_m: f32, y_m: f32| {
            let [row, column] = grid.place([x_m, y_m]).map(|cell| ((cell + 0.5) * wide as f32) as u32);
            *picture.get_pixel(MARGIN + column, MARGIN + LINE + row)
        };
        assert_eq!([at(7.0, 4.0), at(4.0, 1.0), at(1.0, 6.0)], [OUTLINE; 3]);
        let (there, nowhere) = (at(4.5, 4.5), at(2.5, 2.5));
        assert!(there[0] == 255 && there[1] == 255 && nowhere[0] == 18 && nowhere[1] == 18, "{there:?} {nowhere:?}");
        Ok(())
    }

    #[test]
    fn a_dropped_ray_is_red_and_a_kept_one_green() -> Result<(), Box<dyn std::error::Error>> {
        let before = RangeImage::from_channels(8, vec![5.0; 16], vec![0.5; 16], vec![0; 16]);
        let mut after = before.clone();
        after.remove(4);
        let picture = image::load_from_memory(&before_after(&before, &after)?)?.to_rgb8();
        let reds = picture.pixels().filter(|p| **p == Rgb([214, 69, 65])).count();
        let greens = picture.pixels().filter(|p| **p == Rgb([86, 180, 120])).count();
        // 4 of 8 columns are shown, so 8 pixels a panel; one of 16 shown rays is dropped.
        assert_eq!(reds * 15, greens);
        Ok(())
    }

    #[test]
    fn near_is_red_and_far_is_blue() {
        let (near, far) = (range_colour(2.0), range_colour(100.0));
        assert!(near[0] > 180 && near[2] < 60, "{near:?}");
        assert!(far[2] > 150 && far[0] < 100, "{far:?}");
    }
}
