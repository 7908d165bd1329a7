//! The whole part of a number, in a loop that vectorises.

#![allow(
    clippy::inline_always,
    reason = "a loop is compiled for the processor at hand only where all of it is inlined"
)]

/// 2²³: from here on a single-precision number's last binary digit is worth 1.
const UNIT_DIGITS: f32 = 8_388_608.0;

/// The whole part of a number in [0, 2²³); of any other number some number below 2²³.
///
/// `x as u32` gives the same, but its rules for all other numbers are compiled number by number.
#[inline(always)]
pub(crate) fn whole_part(x: f32) -> u32 {
    (x.floor() + UNIT_DIGITS).to_bits() & 0x7f_ffff
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_that_of_a_cast_below_2_to_the_23_and_small_for_every_other_number() {
        let ends = [0.0, f32::MIN_POSITIVE, 0.999_999_94, 1.0, 1.5, 4095.9998, 4_194_303.5, 8_388_607.0, 8_388_607.5];
        let between = (0..100_000).map(|i| i as f32 * 0.313);
        for x in between.chain(ends) {
            assert_eq!(whole_part(x), x as u32, "{x}");
        }
        for x in [-0.0, -1.0, -1e9, 8_388_608.0, 1e30, f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            assert!(whole_part(x) < 1 << 23, "{x}");
        }
    }
}
