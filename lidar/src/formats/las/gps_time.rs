//! `LASzip`'s GPS time, version 2, decoded without recursion.
//!
//! Times are the bits of doubles as 64-bit integers. Up to four sequences run side by side, because the pulses of several lasers
//! interleave; each predicts its next time by multiples of its last step (Isenburg 2013, section "GPS time"). A symbol can say that
//! the time is another sequence's. An honest encoder says that once a point at most, since it goes only to a sequence that fits; a
//! crafted stream says it without end, at four ten-thousandths of a bit each, and the `laz` crate follows by recursion.

use std::io::{Error, ErrorKind, Read, Result};

use laz::decoders::ArithmeticDecoder;
use laz::decompressors::{IntegerDecompressor, IntegerDecompressorBuilder};
use laz::models::ArithmeticModel;
use laz::record::FieldDecompressor;

const BYTES: usize = 8;
const SEQUENCES: usize = 4;

/// Symbols of a sequence that stands still: 0 the same time, 1 a step, 2 a new sequence, above it the sequences after this one.
const STILL_SYMBOLS: u32 = 6;
const NEW_WHEN_STILL: usize = 2;

/// Symbols of a sequence in motion: up to 500 its last step that many times, then −1 to −10 times, …
const MOST: usize = 500;
const LEAST: usize = MOST + 10;
/// … the same time, a new sequence, and above it the sequences after this one.
const SAME: usize = LEAST + 1;
const NEW: usize = LEAST + 2;
const MOVING_SYMBOLS: u32 = NEW as u32 + 4;

/// After so many extreme multiples in a row the step itself is replaced.
const MOST_EXTREMES: u32 = 3;

/// Contexts of the integers, one for each kind of prediction.
const CONTEXTS: u32 = 9;
const CONTEXT_OF_HIGH_HALF: u32 = 8;

#[derive(Clone, Copy, Debug, Default)]
struct Sequence {
    /// The last time's bits.
    time: i64,
    step: i32,
    extremes: u32,
}

/// The field decompressor.
pub(super) struct GpsTime {
    sequences: [Sequence; SEQUENCES],
    current: usize,
    newest: usize,
    still: ArithmeticModel,
    moving: ArithmeticModel,
    integers: IntegerDecompressor,
}

impl Default for GpsTime {
    fn default() -> Self {
        Self {
            sequences: [Sequence::default(); SEQUENCES],
            current: 0,
            newest: 0,
            still: ArithmeticModel::new(STILL_SYMBOLS, false, &[]),
            moving: ArithmeticModel::new(MOVING_SYMBOLS, false, &[]),
            integers: IntegerDecompressorBuilder::new().bits(32).contexts(CONTEXTS).build_initialized(),
        }
    }
}

impl<R: Read> FieldDecompressor<R> for GpsTime {
    fn size_of_field(&self) -> usize {
        BYTES
    }

    fn decompress_first(&mut self, source: &mut R, first: &mut [u8]) -> Result<()> {
        let mut bytes = [0; BYTES];
        source.read_exact(&mut bytes)?;
        self.sequences[0].time = i64::from_le_bytes(bytes);
        first.copy_from_slice(&bytes);
        Ok(())
    }

    fn decompress_with(&mut self, decoder: &mut ArithmeticDecoder<R>, field: &mut [u8]) -> Result<()> {
        // Once around is more than any encoder asks for.
        for _ in 0..SEQUENCES {
            let is_found =
                if self.sequences[self.current].step == 0 { self.still(decoder)? } else { self.moving(decoder)? };
            if is_found {
                field.copy_from_slice(&self.sequences[self.current].time.to_le_bytes());
                return Ok(());
            }
        }
        Err(Error::new(ErrorKind::InvalidData, "GPS time: sequences change without a time"))
    }
}

impl GpsTime {
    /// Reads on in a sequence whose last step was zero; false where the time is another sequence's.
    fn still<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> Result<bool> {
        match decoder.decode_symbol(&mut self.still)? as usize {
            0 => {}
            1 => {
                let step = self.integers.decompress(decoder, 0, 0)?;
                let sequence = &mut self.sequences[self.current];
                *sequence = Sequence { time: sequence.time.wrapping_add(step.into()), step, extremes: 0 };
            }
            NEW_WHEN_STILL => self.start(decoder)?,
            other => {
                self.current = (self.current + other - NEW_WHEN_STILL) % SEQUENCES;
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Reads on in a sequence that moves; false where the time is another sequence's.
    fn moving<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> Result<bool> {
        let symbol = decoder.decode_symbol(&mut self.moving)? as usize;
        let (multiple, context, is_extreme) = match symbol {
            0 => (0, 7, true),
            1 => (1, 1, false),
            2..10 => (symbol as i32, 2, false),
            10..MOST => (symbol as i32, 3, false),
            MOST => (MOST as i32, 4, true),
            LEAST => (-10, 6, true),
            501..LEAST => (MOST as i32 - symbol as i32, 5, false),
            SAME => return Ok(true),
            NEW => {
                self.start(decoder)?;
                return Ok(true);
            }
            other => {
                self.current = (self.current + other - NEW) % SEQUENCES;
                return Ok(false);
            }
        };
        let sequence = &mut self.sequences[self.current];
        let step = self.integers.decompress(decoder, sequence.step.wrapping_mul(multiple), context)?;
        sequence.time = sequence.time.wrapping_add(step.into());
        if symbol == 1 {
            sequence.extremes = 0;
        }
        if is_extreme {
            sequence.extremes += 1;
            if sequence.extremes > MOST_EXTREMES {
                sequence.step = step;
                sequence.extremes = 0;
            }
        }
        Ok(true)
    }

    /// Starts the next sequence at a time written in full, its upper half predicted by the current one.
    fn start<R: Read>(&mut self, decoder: &mut ArithmeticDecoder<R>) -> Result<()> {
        let predicted = (self.sequences[self.current].time >> 32) as i32;
        let high = self.integers.decompress(decoder, predicted, CONTEXT_OF_HIGH_HALF)?;
        let low = decoder.read_int()?;
        self.newest = (self.newest + 1) % SEQUENCES;
        self.current = self.newest;
        self.sequences[self.current] =
            Sequence { time: (i64::from(high) << 32) | i64::from(low), ..Sequence::default() };
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use laz::encoders::ArithmeticEncoder;

    use super::*;

    #[test]
    fn a_stream_that_changes_sequences_for_ever_is_refused() -> Result<()> {
        let mut model = ArithmeticModel::new(STILL_SYMBOLS, true, &[]);
        let mut encoder = ArithmeticEncoder::new(Cursor::new(Vec::new()));
        for _ in 0..5_000_000 {
            encoder.encode_symbol(&mut model, NEW_WHEN_STILL as u32 + 1)?;
        }
        encoder.done()?;
        let stream = encoder.into_inner().into_inner();
        assert!(stream.len() < 1000, "five million changes take {} bytes", stream.len());

        let mut decoder = ArithmeticDecoder::new(stream.as_slice());
        decoder.read_init_bytes()?;
        let refused = GpsTime::default().decompress_with(&mut decoder, &mut [0; BYTES]);
        assert_eq!(refused.map_err(|error| error.kind()), Err(ErrorKind::InvalidData));
        Ok(())
    }
}
