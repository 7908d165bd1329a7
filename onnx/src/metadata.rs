//! What a file says about itself.

use crate::file::{File, FileError};
use crate::proto::StringStringEntryProto;

/// The same file with this metadata property, in the place of the one that has this key, if there is one.
///
/// # Errors
/// A file that cannot be read.
pub fn with_metadata(onnx: &[u8], key: &str, value: &str) -> Result<Vec<u8>, FileError> {
    let mut file = File::read(onnx)?;
    match file.metadata.iter_mut().find(|property| property.key == key) {
        Some(property) => property.value = value.into(),
        None => file.metadata.push(StringStringEntryProto { key: key.into(), value: value.into() }),
    }
    file.write()
}

#[cfg(test)]
mod tests {
    use burn::module::Module;
    use burn::tensor::{Device, Tensor};

    use super::*;
    use crate::Exporter;

    #[derive(Module, Debug)]
    struct Plain {}

    fn exported(properties: &[(&str, &str)]) -> Result<Vec<u8>, crate::Error> {
        let exporter = Exporter::new().input("x").output("y");
        let exporter = properties.iter().fold(exporter, |exporter, (key, value)| exporter.metadata(key, value));
        exporter.export(&Plain {}, |_| Tensor::<2>::zeros([2, 3], &Device::flex()), |_, x| x * 2.0)
    }

    #[test]
    fn a_property_is_replaced_or_added_and_nothing_else_changes() -> Result<(), Box<dyn std::error::Error>> {
        let before = exported(&[("licence", "MIT"), ("card", "one")])?;
        assert_eq!(with_metadata(&before, "card", "another")?, exported(&[("licence", "MIT"), ("card", "another")])?);
        let more = exported(&[("licence", "MIT"), ("card", "one"), ("note", "new")])?;
        assert_eq!(with_metadata(&before, "note", "new")?, more);
        assert!(with_metadata(b"no file", "note", "new").is_err());
        Ok(())
    }
}
