//! The Common Data Representation (OMG, "DDS Interoperability Wire Protocol" 2.5, 10.2) as ROS 2 writes it: four bytes that name the
//! byte order, then numbers, each aligned to its size, counted from the fifth byte.

use super::FormatError;
use crate::formats::input::Input;
use crate::formats::number::Endian;

/// Bytes before the first that alignment counts.
const HEADER_BYTES: usize = 4;
/// Middleware fills a message up to a multiple of four bytes.
const MOST_FILLING: usize = 3;

/// A walk through a message.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reader<'a> {
    input: Input<'a>,
    endian: Endian,
}

impl<'a> Reader<'a> {
    /// Reads the byte order. Representations with members by number or with delimiters are refused: ROS 2 writes neither.
    pub(super) fn new(bytes: &'a [u8]) -> Result<Self, FormatError> {
        let mut input = Input::new(bytes);
        let [high, low, ..]: [u8; HEADER_BYTES] = input.array("representation")?;
        let endian = match [high, low] {
            [0, 0] => Endian::Big,
            [0, 1] => Endian::Little,
            other => {
                let found = format!("{:#06x}", u16::from_be_bytes(other));
                return Err(FormatError::field("representation", 0, "0x0000 (CDR_BE) or 0x0001 (CDR_LE)", found));
            }
        };
        Ok(Self { input, endian })
    }

    /// The message's byte order.
    pub(super) fn endian(&self) -> Endian {
        self.endian
    }

    /// Bytes from the start of the message.
    pub(super) fn position(&self) -> usize {
        self.input.position()
    }

    /// Bytes that are left.
    pub(super) fn left(&self) -> usize {
        self.input.rest().len()
    }

    pub(super) fn u8(&mut self, field: &str) -> Result<u8, FormatError> {
        let [byte] = self.input.array(field)?;
        Ok(byte)
    }

    pub(super) fn bool(&mut self, field: &str) -> Result<bool, FormatError> {
        let offset = self.position();
        match self.u8(field)? {
            0 => Ok(false),
            1 => Ok(true),
            other => Err(FormatError::field(field, offset, "0 or 1", other)),
        }
    }

    pub(super) fn u32(&mut self, field: &str) -> Result<u32, FormatError> {
        let past = (self.position() - HEADER_BYTES) % size_of::<u32>();
        self.input.take((size_of::<u32>() - past) % size_of::<u32>(), field)?;
        let bytes = self.input.array(field)?;
        Ok(match self.endian {
            Endian::Little => u32::from_le_bytes(bytes),
            Endian::Big => u32::from_be_bytes(bytes),
        })
    }

    /// Text with its length, which counts the NUL at its end. Some writers give an empty text the length 0.
    pub(super) fn string(&mut self, field: &str) -> Result<&'a str, FormatError> {
        let length = self.u32(field)? as usize;
        let offset = self.position();
        let text = match self.input.take(length, field)? {
            [] => &[],
            [text @ .., 0] => text,
            _ => return Err(FormatError::field(field, offset + length - 1, "a NUL", "none")),
        };
        let lossy = || String::from_utf8_lossy(text).into_owned();
        str::from_utf8(text).map_err(|_| FormatError::field(field, offset, "text in UTF-8", lossy()))
    }

    /// Bytes with their number.
    pub(super) fn bytes(&mut self, field: &str) -> Result<&'a [u8], FormatError> {
        let length = self.u32(field)? as usize;
        self.input.take(length, field)
    }

    /// Checks that this was all.
    pub(super) fn end(self) -> Result<(), FormatError> {
        if self.left() > MOST_FILLING {
            let expected = format!("at most {MOST_FILLING} bytes");
            return Err(FormatError::field("end of the message", self.position(), expected, self.left()));
        }
        Ok(())
    }
}

/// A message that is being written.
#[derive(Clone, Debug)]
pub(super) struct Writer {
    bytes: Vec<u8>,
    endian: Endian,
}

impl Writer {
    /// A message of this byte order, of about `capacity` bytes.
    pub(super) fn new(endian: Endian, capacity: usize) -> Self {
        let mut bytes = Vec::with_capacity(capacity);
        bytes.extend([0, u8::from(endian == Endian::Little), 0, 0]);
        Self { bytes, endian }
    }

    pub(super) fn u8(&mut self, byte: u8) {
        self.bytes.push(byte);
    }

    pub(super) fn u32(&mut self, number: u32) {
        let past = (self.bytes.len() - HEADER_BYTES) % size_of::<u32>();
        self.bytes.extend(std::iter::repeat_n(0, (size_of::<u32>() - past) % size_of::<u32>()));
        self.bytes.extend(match self.endian {
            Endian::Little => number.to_le_bytes(),
            Endian::Big => number.to_be_bytes(),
        });
    }

    pub(super) fn string(&mut self, text: &str) {
        // Texts come from messages, whose lengths are 32 bits, or from columns' names.
        self.u32(text.len() as u32 + 1);
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.push(0);
    }

    /// Appends `length` zeros and gives them to be written to.
    pub(super) fn zeros(&mut self, length: usize) -> &mut [u8] {
        let start = self.bytes.len();
        self.bytes.resize(start + length, 0);
        &mut self.bytes[start..]
    }

    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}
