//! How surfaces lie to the rays that hit them, told apart from how far away they are.

use burn::tensor::{Tensor, s};

use super::border::Border;

/// Channels that [`with_relief`] adds.
pub(super) const RELIEF_CHANNELS: usize = 3;

/// What a difference of two range codes is multiplied by before it is squashed. A wall at 45° to the ray changes the logarithmic code of a
/// sensor that sees as far as 120 m by 0.003 from one pixel of 0.2° to the next but one: the whole code's range, and with it the edge of an
/// object, is hundreds of times as large.
const STEEPNESS: f64 = 100.0;

/// The least range code that is taken for a return: −1 stands for none.
const LEAST_CODE: f64 = -1.0 + 1e-4;

/// An image `[batch, 2, ring, column]`, and beside its range code and reflectance: whether there is a return, and how the range code changes
/// from column to column and from ring to ring, −1 to 1, 0 where one of the two neighbours has no return; `[batch, 5, ring, column]`.
///
/// Which angle a ray meets a surface at decides how much of it comes back (Lambert's cosine law). In a range image it is a small difference
/// of large numbers, beside which the norms of the first layer see the edges of objects and of the sky.
pub(super) fn with_relief(image: Tensor<4>, border: Border) -> Tensor<4> {
    let [_, _, rings, columns] = image.dims();
    let around = border.pad(image.clone().slice(s![.., 0..1, .., ..]), 1);
    let at = |ring: usize, column: usize| {
        let code = around.clone().slice(s![.., .., ring..ring + rings, column..column + columns]);
        (code.clone().greater_elem(LEAST_CODE).float(), code)
    };
    let (returned, _) = at(1, 1);
    let slope = |before: (Tensor<4>, Tensor<4>), after: (Tensor<4>, Tensor<4>)| {
        ((after.1 - before.1) * STEEPNESS).tanh() * before.0 * after.0 * returned.clone()
    };
    let (along, across) = (slope(at(1, 0), at(1, 2)), slope(at(0, 1), at(2, 1)));
    Tensor::cat(vec![image, returned, along, across], 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, TensorData};

    #[test]
    fn slopes_are_told_where_both_neighbours_are_there() {
        // Rises from column to column; the middle of the last ring is no return.
        let code = |ring: usize, column: usize| match (ring, column) {
            (2, 2) => -1.0,
            _ => 0.01 * column as f32 + 0.002 * ring as f32,
        };
        let (rings, columns) = (3, 5);
        let codes = (0..rings).flat_map(|ring| (0..columns).map(move |column| code(ring, column)));
        let image: Vec<f32> = codes.chain(vec![0.5; rings * columns]).collect();
        let image = Tensor::<4>::from_data(TensorData::new(image, [1, 2, rings, columns]), &Device::flex());
        let relief = with_relief(image.clone(), Border::Mirror);
        assert_eq!(relief.dims(), [1, 5, rings, columns]);
        assert_eq!(relief.clone().slice(s![.., 0..2, .., ..]).into_data(), image.into_data());
        let channel = |i: usize| -> Vec<f32> {
            relief.clone().slice(s![.., i..i + 1, .., ..]).into_data().iter::<f32>().collect()
        };
        let (returned, along, across) = (channel(2), channel(3), channel(4));
        let expect = |found: &[f32], ring: usize, column: usize, expected: f32| {
            let found = found[ring * columns + column];
            assert!((found - expected).abs() < 1e-4, "ring {ring}, column {column}: {found}, expected {expected}");
        };
        expect(&returned, 2, 2, 0.0);
        expect(&returned, 1, 2, 1.0);
        expect(&along, 1, 2, 2f32.tanh());
        expect(&across, 1, 1, 0.4f32.tanh());
        // A neighbour without a return, and the pixel without one itself; at the border, both neighbours are the same.
        expect(&along, 2, 1, 0.0);
        expect(&across, 1, 2, 0.0);
        expect(&along, 2, 2, 0.0);
        expect(&along, 1, 0, 0.0);
    }
}
