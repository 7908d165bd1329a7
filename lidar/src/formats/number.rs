//! The number types of files, and columns of them in byte records.

use std::borrow::Cow;

use crate::cloud::Values;

/// A number type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NumberType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

/// The order of a number's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Endian {
    Little,
    Big,
}

/// Where a column lies: one number in each record of `stride` bytes, `offset` bytes into it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lane {
    pub(super) stride: usize,
    pub(super) offset: usize,
    pub(super) endian: Endian,
}

/// A column to write, borrowed where the cloud holds it in the right type.
#[derive(Clone, Debug)]
pub(super) enum Numbers<'a> {
    I8(Cow<'a, [i8]>),
    U8(Cow<'a, [u8]>),
    I16(Cow<'a, [i16]>),
    U16(Cow<'a, [u16]>),
    I32(Cow<'a, [i32]>),
    U32(Cow<'a, [u32]>),
    I64(Cow<'a, [i64]>),
    U64(Cow<'a, [u64]>),
    F32(Cow<'a, [f32]>),
    F64(Cow<'a, [f64]>),
}

/// A double in another type, the nearest that it has.
macro_rules! from_double {
    (F32 $float:ty, $double:expr) => {
        $double as $float
    };
    (F64 $float:ty, $double:expr) => {
        $double
    };
    ($kind:ident $whole:ty, $double:expr) => {
        $double.round() as $whole
    };
}

macro_rules! for_every_type {
    ($($kind:ident $number:ty),*) => {
        impl NumberType {
            /// Size in bytes.
            pub(super) fn bytes(self) -> usize {
                match self { $(Self::$kind => size_of::<$number>(),)* }
            }

            /// A column of this type without values.
            pub(super) fn column(self) -> Values {
                match self { $(Self::$kind => Values::$kind(Vec::new()),)* }
            }
        }

        /// Appends the lane's number of each record to a column of its type.
        pub(super) fn append(column: &mut Values, records: &[u8], lane: Lane) {
            match column {
                $(Values::$kind(to) => {
                    const BYTES: usize = size_of::<$number>();
                    let numbers = records.chunks_exact(lane.stride).map(|record| {
                        let mut bytes = [0; BYTES];
                        bytes.copy_from_slice(&record[lane.offset..lane.offset + BYTES]);
                        bytes
                    });
                    match lane.endian {
                        Endian::Little => to.extend(numbers.map(<$number>::from_le_bytes)),
                        Endian::Big => to.extend(numbers.map(<$number>::from_be_bytes)),
                    }
                })*
            }
        }

        impl Numbers<'_> {
            /// The type of the numbers.
            pub(super) fn number_type(&self) -> NumberType {
                match self { $(Self::$kind(_) => NumberType::$kind,)* }
            }

            /// Writes each number into the lane of its record.
            pub(super) fn write_lane(&self, records: &mut [u8], lane: Lane) {
                match self {
                    $(Self::$kind(numbers) => {
                        const BYTES: usize = size_of::<$number>();
                        let to_bytes = match lane.endian {
                            Endian::Little => <$number>::to_le_bytes,
                            Endian::Big => <$number>::to_be_bytes,
                        };
                        for (record, number) in records.chunks_exact_mut(lane.stride).zip(numbers.iter()) {
                            record[lane.offset..lane.offset + BYTES].copy_from_slice(&to_bytes(*number));
                        }
                    })*
                }
            }

            /// All numbers, little-endian, one after the other.
            pub(super) fn to_bytes(&self) -> Vec<u8> {
                match self { $(Self::$kind(numbers) => numbers.iter().flat_map(|n| n.to_le_bytes()).collect(),)* }
            }
        }

        impl<'a> Numbers<'a> {
            /// The same numbers in another type: whole ones are rounded, and held to what the type has.
            pub(super) fn converted(self, to: NumberType) -> Self {
                if self.number_type() == to {
                    return self;
                }
                let doubles = self.into_doubles();
                match to {
                    $(NumberType::$kind => Self::$kind(doubles.into_iter().map(|double| from_double!($kind $number, double)).collect()),)*
                }
            }

            /// The numbers as doubles; exact but for 64-bit integers past 2⁵³.
            // The macro's body serves every type, `f64` among them.
            #[allow(clippy::unnecessary_cast)]
            fn into_doubles(self) -> Vec<f64> {
                match self { $(Self::$kind(numbers) => numbers.iter().map(|&number| number as f64).collect(),)* }
            }
        }

        impl<'a> From<&'a Values> for Numbers<'a> {
            fn from(values: &'a Values) -> Self {
                match values { $(Values::$kind(numbers) => Self::$kind(Cow::Borrowed(numbers)),)* }
            }
        }
    };
}
for_every_type!(I8 i8, U8 u8, I16 i16, U16 u16, I32 i32, U32 u32, I64 i64, U64 u64, F32 f32, F64 f64);

impl Numbers<'_> {
    /// Writes each number, little-endian, into its record.
    pub(super) fn write(&self, records: &mut [u8], stride: usize, offset: usize) {
        self.write_lane(records, Lane { stride, offset, endian: Endian::Little });
    }
}

/// The lane of each record as one new column.
pub(super) fn column(number_type: NumberType, records: &[u8], lane: Lane) -> Values {
    let mut values = number_type.column();
    append(&mut values, records, lane);
    values
}

/// One little-endian float32 of each record: the columns of the formats without a header.
pub(super) fn f32_column(records: &[u8], stride: usize, offset: usize) -> Vec<f32> {
    match column(NumberType::F32, records, Lane { stride, offset, endian: Endian::Little }) {
        Values::F32(values) => values,
        _ => Vec::new(), // `column` keeps the type it is asked for
    }
}
