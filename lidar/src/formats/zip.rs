//! The part of ZIP (PKWARE APPNOTE 6.3) that `NumPy` archives use: stored and deflated members, no encryption, under 4 GiB.
//!
//! A general library keeps more of the format than an archive of arrays needs, and each feature is a way in. Here every size is
//! checked against the bytes there and a budget before anything is unpacked; `npyz` is the tests' oracle.

use std::io::Read;

use flate2::Crc;
use flate2::read::DeflateDecoder;

use super::FormatError;
use super::input::{Input, truncated};

const LOCAL: u32 = 0x0403_4b50;
const CENTRAL: u32 = 0x0201_4b50;
const END: u32 = 0x0605_4b50;
const END_BYTES: usize = 22;
const STORED: u16 = 0;
const DEFLATED: u16 = 8;

/// An archive of a scan has a dozen members, one of a recording some hundreds.
const MAX_MEMBERS: usize = 1024;

/// Deflate turns at most 258 bytes into two bits: no honest member swells more.
const MAX_EXPANSION: usize = 1032;

/// An archive and what its directory says.
#[derive(Debug)]
pub(super) struct Archive<'a> {
    bytes: &'a [u8],
    directory: usize,
    pub(super) entries: Vec<Entry>,
}

/// One member.
#[derive(Debug)]
pub(super) struct Entry {
    pub(super) name: String,
    flags: u16,
    method: u16,
    crc: u32,
    packed: usize,
    unpacked: usize,
    local_offset: usize,
}

impl<'a> Archive<'a> {
    /// Reads the directory.
    pub(super) fn read(bytes: &'a [u8]) -> Result<Self, FormatError> {
        let mut input = Input::new(bytes);
        input.seek(find_end(bytes)? + 10, "end of central directory")?;
        let count = usize::from(input.u16("number of members")?);
        let offset = input.position();
        let _directory_bytes = input.u32("size of central directory")?;
        let directory = input.u32("offset of central directory")? as usize;
        if count > MAX_MEMBERS {
            let found = format!("{count} members");
            return Err(FormatError::TooMany { field: "number of members".into(), offset, found, limit: MAX_MEMBERS });
        }
        input.seek(directory, "offset of central directory")?;
        let entries = (0..count).map(|_| Entry::read(&mut input)).collect::<Result<Vec<_>, _>>()?;
        // Members that share their bytes make a small archive a large one (Fifield, "A better zip bomb", 2019).
        let packed = entries.iter().fold(0, |sum: usize, entry| sum.saturating_add(entry.packed));
        if packed > directory {
            let expected = format!("members of at most the {directory} bytes before it");
            return Err(FormatError::field("central directory", directory, expected, format!("{packed} bytes")));
        }
        Ok(Self { bytes, directory, entries })
    }

    /// Checks what all members claim to unpack to, before the first one is.
    pub(super) fn check_unpacked(&self, limit: usize) -> Result<(), FormatError> {
        let unpacked = self.entries.iter().fold(0, |sum: usize, entry| sum.saturating_add(entry.unpacked));
        if unpacked > limit {
            let found = format!("{unpacked} bytes unpacked");
            return Err(FormatError::TooMany {
                field: "central directory".into(),
                offset: self.directory,
                found,
                limit,
            });
        }
        Ok(())
    }

    /// Unpacks a member of at most `budget` bytes.
    pub(super) fn unpack(&self, entry: &Entry, budget: usize) -> Result<Vec<u8>, FormatError> {
        let mut input = Input::new(self.bytes);
        input.seek(entry.local_offset, &entry.name)?;
        signature(&mut input, LOCAL, "local header")?;
        input.take(22, "local header")?;
        let name = input.u16("local header")?;
        let extra = input.u16("local header")?;
        input.take(usize::from(name) + usize::from(extra), "local header")?;
        let offset = input.position();
        let packed = input.take(entry.packed, &entry.name)?;
        if entry.flags & 1 == 1 {
            return Err(FormatError::unsupported("an encrypted archive"));
        }
        let limit = budget.min(entry.packed.saturating_mul(MAX_EXPANSION));
        if entry.unpacked > limit {
            let found = format!("{} bytes unpacked", entry.unpacked);
            return Err(FormatError::TooMany { field: entry.name.clone(), offset, found, limit });
        }
        let unpacked = match entry.method {
            STORED => packed.to_vec(),
            DEFLATED => {
                let mut unpacked = Vec::with_capacity(entry.unpacked);
                // One byte more than declared shows a member that lies about its size.
                let read = DeflateDecoder::new(packed).take(entry.unpacked as u64 + 1).read_to_end(&mut unpacked);
                read.map_err(|error| FormatError::field(&entry.name, offset, "a deflate stream", error))?;
                unpacked
            }
            method => return Err(FormatError::unsupported(format!("ZIP method {method} of `{}`", entry.name))),
        };
        if unpacked.len() != entry.unpacked {
            let expected = format!("{} bytes unpacked", entry.unpacked);
            return Err(FormatError::field(&entry.name, offset, expected, unpacked.len()));
        }
        if crc(&unpacked) != entry.crc {
            let expected = format!("a CRC-32 of {:08x}", entry.crc);
            return Err(FormatError::field(&entry.name, offset, expected, format!("{:08x}", crc(&unpacked))));
        }
        Ok(unpacked)
    }
}

impl Entry {
    fn read(input: &mut Input<'_>) -> Result<Self, FormatError> {
        const FIELD: &str = "central directory";
        signature(input, CENTRAL, FIELD)?;
        input.take(4, FIELD)?;
        let (flags, method) = (input.u16(FIELD)?, input.u16(FIELD)?);
        input.take(4, FIELD)?;
        let crc = input.u32(FIELD)?;
        let (packed, unpacked) = (input.u32(FIELD)? as usize, input.u32(FIELD)? as usize);
        let (name, extra, comment) = (input.u16(FIELD)?, input.u16(FIELD)?, input.u16(FIELD)?);
        input.take(8, FIELD)?;
        let local_offset = input.u32(FIELD)? as usize;
        let name = String::from_utf8_lossy(input.take(usize::from(name), FIELD)?).into_owned();
        input.take(usize::from(extra) + usize::from(comment), FIELD)?;
        Ok(Self { name, flags, method, crc, packed, unpacked, local_offset })
    }
}

/// Where the end record starts: the last one whose comment fills the rest of the file.
fn find_end(bytes: &[u8]) -> Result<usize, FormatError> {
    let last = bytes
        .len()
        .checked_sub(END_BYTES)
        .ok_or_else(|| truncated("end of central directory", 0, END_BYTES, bytes.len()))?;
    let first = last.saturating_sub(usize::from(u16::MAX));
    let is_end = |&start: &usize| {
        let comment = usize::from(u16::from_le_bytes([bytes[start + 20], bytes[start + 21]]));
        bytes[start..].starts_with(&END.to_le_bytes()) && start + END_BYTES + comment == bytes.len()
    };
    (first..=last)
        .rev()
        .find(is_end)
        .ok_or_else(|| FormatError::field("end of central directory", last, "a ZIP archive's end record", "none"))
}

fn signature(input: &mut Input<'_>, expected: u32, field: &str) -> Result<(), FormatError> {
    let offset = input.position();
    let found = input.u32(field)?;
    if found == expected {
        return Ok(());
    }
    Err(FormatError::field(field, offset, format!("signature {expected:08x}"), format!("{found:08x}")))
}

fn crc(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// An archive to be: members stored as they are.
#[derive(Debug, Default)]
pub(super) struct Writer {
    members: Vec<u8>,
    directory: Vec<u8>,
    count: u16,
}

impl Writer {
    /// Appends a member.
    pub(super) fn add(&mut self, name: &str, bytes: &[u8]) -> Result<(), FormatError> {
        let offset = small(self.members.len(), name)?;
        let size = small(bytes.len(), name)?;
        // Version 2.0; names in UTF-8 (bit 11); stored; 1980-01-01, so that the same cloud makes the same bytes.
        let mut shared = vec![20, 0, 0, 8];
        shared.extend(STORED.to_le_bytes());
        shared.extend([0, 0, 33, 0]);
        for number in [crc(bytes), size, size] {
            shared.extend(number.to_le_bytes());
        }
        shared.extend((name.len() as u16).to_le_bytes());
        shared.extend([0, 0]);

        self.members.extend(LOCAL.to_le_bytes());
        self.members.extend(&shared);
        self.members.extend(name.as_bytes());
        self.members.extend(bytes);

        self.directory.extend(CENTRAL.to_le_bytes());
        self.directory.extend([20, 0]);
        self.directory.extend(&shared);
        self.directory.extend([0; 10]); // comment, disk, attributes
        self.directory.extend(offset.to_le_bytes());
        self.directory.extend(name.as_bytes());
        self.count += 1;
        Ok(())
    }

    /// The archive's bytes.
    pub(super) fn finish(mut self) -> Result<Vec<u8>, FormatError> {
        let offset = small(self.members.len(), "central directory")?;
        let size = small(self.directory.len(), "central directory")?;
        self.members.extend(&self.directory);
        self.members.extend(END.to_le_bytes());
        self.members.extend([0; 4]);
        self.members.extend([self.count.to_le_bytes(), self.count.to_le_bytes()].concat());
        self.members.extend(size.to_le_bytes());
        self.members.extend(offset.to_le_bytes());
        self.members.extend([0, 0]);
        Ok(self.members)
    }
}

/// A size that fits the format without its 64-bit extension.
fn small(size: usize, field: &str) -> Result<u32, FormatError> {
    u32::try_from(size).ok().filter(|&size| size < u32::MAX).ok_or_else(|| FormatError::TooMany {
        field: field.into(),
        offset: 0,
        found: format!("{size} bytes"),
        limit: u32::MAX as usize - 1,
    })
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::DeflateEncoder;

    use super::*;

    /// An archive of one deflated member of zeros that claims to unpack to `unpacked` bytes.
    fn deflated(zeros: usize, unpacked: u32) -> std::io::Result<Vec<u8>> {
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(&vec![0; zeros])?;
        let packed = encoder.finish()?;
        let mut archive = Writer::default();
        archive.add("a.npy", &packed).map_err(std::io::Error::other)?;
        let mut bytes = archive.finish().map_err(std::io::Error::other)?;
        // In the directory, the method is at 10, the checksum at 16, the unpacked size at 24.
        let directory = 30 + 5 + packed.len();
        bytes[directory + 10] = DEFLATED as u8;
        bytes[directory + 16..][..4].copy_from_slice(&crc(&vec![0; zeros]).to_le_bytes());
        bytes[directory + 24..][..4].copy_from_slice(&unpacked.to_le_bytes());
        Ok(bytes)
    }

    #[test]
    fn a_deflated_member_unpacks_within_the_budget_only() -> std::io::Result<()> {
        let bytes = deflated(100_000, 100_000)?;
        let archive = Archive::read(&bytes).map_err(std::io::Error::other)?;
        let entry = &archive.entries[0];
        assert_eq!(archive.unpack(entry, 100_000).map_err(std::io::Error::other)?, vec![0; 100_000]);
        assert!(matches!(archive.unpack(entry, 99_999), Err(FormatError::TooMany { .. })));
        Ok(())
    }

    #[test]
    fn a_member_that_lies_about_its_size_is_refused() -> std::io::Result<()> {
        for unpacked in [0, 99_999, 100_001, u32::MAX] {
            let bytes = deflated(100_000, unpacked)?;
            let archive = Archive::read(&bytes).map_err(std::io::Error::other)?;
            assert!(archive.unpack(&archive.entries[0], 1 << 30).is_err(), "{unpacked}");
        }
        Ok(())
    }

    #[test]
    fn members_that_share_their_bytes_are_refused() -> Result<(), FormatError> {
        let mut archive = Writer::default();
        archive.add("a.npy", &[7; 100])?;
        // The directory names it twice; its place is kept.
        archive.directory = archive.directory.repeat(2);
        archive.count = 2;
        let error = Archive::read(&archive.finish()?).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(error.contains("expected members of at most the 135 bytes before it, found 200 bytes"), "{error}");
        Ok(())
    }

    #[test]
    fn a_stored_member_survives_and_a_damaged_one_is_named() -> Result<(), FormatError> {
        let mut archive = Writer::default();
        archive.add("x.npy", b"numbers")?;
        let mut bytes = archive.finish()?;
        let read = Archive::read(&bytes)?;
        assert_eq!(read.unpack(&read.entries[0], 7)?, b"numbers");
        bytes[36] ^= 1;
        let read = Archive::read(&bytes)?;
        let error = read.unpack(&read.entries[0], 7).map_err(|error| error.to_string());
        assert!(error.is_err_and(|error| error.starts_with("x.npy at byte 35: expected a CRC-32")));
        Ok(())
    }
}
