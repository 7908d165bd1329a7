//! The azimuth of a point in single precision: a polynomial that every processor evaluates to the same bits.

#![allow(
    clippy::inline_always,
    reason = "a loop is compiled for the processor at hand only where all of it is inlined"
)]

/// Most that [`turns`] may differ from the exact azimuth, in turns (2·10⁻⁶ rad would be 3.2·10⁻⁷; measured 4·10⁻⁸).
///
/// A column of a grid of 4000 is 2.5·10⁻⁴ turns wide.
#[cfg(test)]
const MAX_ERROR_TURNS: f64 = 6e-8;

/// Minimax coefficients of atan(q) / (2π·q) in powers of q², q in [0, 1] (Lawson's iteration, error 4·10⁻⁸ rad before rounding).
const COEFFICIENTS: [f32; 8] = [
    0.159_154_83,
    -0.053_046_122,
    0.031_745_944,
    -0.022_136_27,
    0.015_346_03,
    -0.008_898_718,
    0.003_479_594_1,
    -0.000_645_303_35,
];

/// Azimuth of (x, y) in turns, from −½ to ½: 0 along x, ¼ along y. The origin has azimuth 0; NaN and infinities give any number.
///
/// Plain multiplications and additions only, never fused, so that a column decided on one machine is the same on every other.
#[inline(always)]
pub(crate) fn turns(x: f32, y: f32) -> f32 {
    let (across, along) = (y.abs(), x.abs());
    let steep = across > along;
    let (small, large) = if steep { (along, across) } else { (across, along) };
    let q = small / if large > 0.0 { large } else { 1.0 };
    let s = q * q;
    let mut sum = COEFFICIENTS[7];
    sum = sum * s + COEFFICIENTS[6];
    sum = sum * s + COEFFICIENTS[5];
    sum = sum * s + COEFFICIENTS[4];
    sum = sum * s + COEFFICIENTS[3];
    sum = sum * s + COEFFICIENTS[2];
    sum = sum * s + COEFFICIENTS[1];
    sum = sum * s + COEFFICIENTS[0];
    let octant = sum * q;
    let quadrant = if steep { 0.25 - octant } else { octant };
    let half = if x < 0.0 { 0.5 - quadrant } else { quadrant };
    half.copysign(y)
}

/// asin(s) in turns: the angle by which a beam that passes `s` distances beside the spin axis is turned. `s` is cut to ±½.
///
/// Taylor's series to s¹¹, in error by less than 2·10⁻⁶ turns at ½ and 10⁻⁹ at ¼; a beam 26 mm beside the axis has s = 0.03 at 0.9 m.
#[inline(always)]
pub(crate) fn asin_turns(s: f32) -> f32 {
    const PER_TURN: f32 = 1.0 / std::f32::consts::TAU;
    let s = if s > 0.5 { 0.5 } else { s };
    let s = if s < -0.5 { -0.5 } else { s };
    let q = s * s;
    let mut sum: f32 = 63.0 / 2816.0;
    sum = sum * q + 35.0 / 1152.0;
    sum = sum * q + 5.0 / 112.0;
    sum = sum * q + 3.0 / 40.0;
    sum = sum * q + 1.0 / 6.0;
    (sum * q + 1.0) * s * PER_TURN
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn the_polynomial_is_the_azimuth_far_below_a_column() {
        let mut worst = 0f64;
        for i in 0..2_000_003u32 {
            let angle = f64::from(i) * (TAU / 2_000_003.0) - TAU / 2.0;
            let range_m = 0.3 * f64::from(1 + i % 997);
            let (x, y) = ((range_m * angle.cos()) as f32, (range_m * angle.sin()) as f32);
            let exact = f64::from(y).atan2(f64::from(x)) / TAU;
            worst = worst.max((f64::from(turns(x, y)) - exact).abs());
        }
        assert!(worst < MAX_ERROR_TURNS, "{worst:e} turns");
    }

    #[test]
    fn the_axes_are_exact() {
        assert_eq!([turns(2.0, 0.0), turns(0.0, 2.0), turns(-2.0, 0.0), turns(0.0, -2.0)], [0.0, 0.25, 0.5, -0.25]);
        assert_eq!(turns(0.0, 0.0), 0.0);
        assert!((turns(1e-30, 1e-30) - 0.125).abs() < 1e-7);
    }

    #[test]
    fn the_series_is_the_arcsine_of_a_beam_beside_the_axis() {
        for i in -250..=250 {
            let s = i as f32 / 1000.0;
            let exact = f64::from(s).asin() / TAU;
            assert!((f64::from(asin_turns(s)) - exact).abs() < 1e-8, "{s}");
        }
    }
}
