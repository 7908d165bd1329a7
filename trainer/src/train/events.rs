//! Event files as `TensorBoard` reads them: records of `tensorflow/core/util/event.proto`, framed as `TFRecord`s.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result};
use prost::{Message, Oneof};

/// Version of the format that `TensorBoard` expects in a file's first record.
const VERSION: &str = "brain.Event:2";

/// `SessionLog.START`: what was written of later steps before a run was resumed no longer counts.
const START: i32 = 1;

/// An event file.
#[derive(Debug)]
pub struct Events(File);

/// The part of `Event` that is used.
#[derive(Clone, PartialEq, Message)]
struct Event {
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(oneof = "What", tags = "3, 5, 7")]
    what: Option<What>,
}

#[derive(Clone, PartialEq, Oneof)]
enum What {
    #[prost(string, tag = "3")]
    FileVersion(String),
    #[prost(message, tag = "5")]
    Summary(Summary),
    #[prost(message, tag = "7")]
    SessionLog(SessionLog),
}

#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<Scalar>,
}

#[derive(Clone, PartialEq, Message)]
struct Scalar {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, tag = "2")]
    simple_value: f32,
}

#[derive(Clone, PartialEq, Message)]
struct SessionLog {
    #[prost(int32, tag = "1")]
    status: i32,
}

impl Events {
    /// A new file in a run's folder, from this step on; what earlier files say of later steps no longer counts.
    pub fn create(run: &Path, step: usize) -> Result<Self> {
        let path = run.join(format!("events.out.tfevents.{:.6}.{step}", now_s()));
        let file = File::create_new(&path).with_context(|| format!("cannot create {}", path.display()))?;
        let mut events = Self(file);
        events.write(0, What::FileVersion(VERSION.into()))?;
        events.write(step + 1, What::SessionLog(SessionLog { status: START }))?;
        Ok(events)
    }

    /// Numbers of one step, by the name of their curve.
    pub fn scalars(&mut self, step: usize, curves: impl Iterator<Item = (String, f64)>) -> Result<()> {
        let value = curves.map(|(tag, value)| Scalar { tag, simple_value: value as f32 }).collect();
        self.write(step, What::Summary(Summary { value }))
    }

    fn write(&mut self, step: usize, what: What) -> Result<()> {
        let event = Event { wall_time: now_s(), step: step as i64, what: Some(what) };
        Ok(self.0.write_all(&record(&event.encode_to_vec()))?)
    }
}

/// Length, its checksum, bytes, their checksum.
fn record(bytes: &[u8]) -> Vec<u8> {
    let length = (bytes.len() as u64).to_le_bytes();
    let checksum = |bytes: &[u8]| masked(crc32c::crc32c(bytes)).to_le_bytes();
    [length.as_slice(), &checksum(&length), bytes, &checksum(bytes)].concat()
}

/// `TFRecord`'s masked checksum: turned by 15 bits, plus a constant.
fn masked(checksum: u32) -> u32 {
    checksum.rotate_right(15).wrapping_add(0xa282_ead8)
}

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_framed_as_tensorflow_frames_them() {
        // `tf.io.TFRecordWriter(path).write(b"abc")` wrote these bytes.
        let written = [3, 0, 0, 0, 0, 0, 0, 0, 0x64, 0x14, 0x3f, 0x83, 0x61, 0x62, 0x63, 0, 0, 0, 0];
        let framed = record(b"abc");
        assert_eq!(framed[..8], written[..8]);
        assert_eq!(framed[12..15], written[12..15]);
        // RFC 3720, B.4: the checksum of 32 zeros.
        assert_eq!(crc32c::crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(masked(0x8a91_36aa), 0x8a91_36aau32.rotate_right(15).wrapping_add(0xa282_ead8));
    }
}
