//! What is small in every honest request: read as far as it is small, so that no body becomes many times as large in memory.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};

/// A list of at most `MOST`.
pub(super) struct Few<T, const MOST: usize>(pub(super) Vec<T>);

/// Parameters: as the protocol has them, each is a text, a number, or true or false.
#[derive(Default)]
pub(super) struct Parameters(pub(super) Map<String, Value>);

/// Most parameters.
const MAX_PARAMETERS: usize = 64;

struct Scalar(Value);

struct ListVisitor<T, const MOST: usize>(PhantomData<T>);

struct ParametersVisitor;

struct ScalarVisitor;

impl<'de, T: Deserialize<'de>, const MOST: usize> Deserialize<'de> for Few<T, MOST> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(ListVisitor::<T, MOST>(PhantomData)).map(Self)
    }
}

impl<'de, T: Deserialize<'de>, const MOST: usize> Visitor<'de> for ListVisitor<T, MOST> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of at most {MOST}")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<T>, A::Error> {
        let mut few = Vec::new();
        while let Some(element) = list.next_element()? {
            if few.len() == MOST {
                return Err(A::Error::invalid_length(MOST + 1, &self));
            }
            few.push(element);
        }
        Ok(few)
    }
}

impl<'de> Deserialize<'de> for Parameters {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(ParametersVisitor).map(Self)
    }
}

impl<'de> Visitor<'de> for ParametersVisitor {
    type Value = Map<String, Value>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at most {MAX_PARAMETERS} parameters")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Self::Value, A::Error> {
        let mut parameters = Map::new();
        while let Some((name, Scalar(value))) = entries.next_entry::<String, Scalar>()? {
            if parameters.len() == MAX_PARAMETERS {
                return Err(A::Error::invalid_length(MAX_PARAMETERS + 1, &self));
            }
            parameters.insert(name, value);
        }
        Ok(parameters)
    }
}

impl<'de> Deserialize<'de> for Scalar {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ScalarVisitor).map(Self)
    }
}

impl Visitor<'_> for ScalarVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a text, a number, true or false")
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_more_than_few_is_refused() -> Result<(), serde_json::Error> {
        let list = |text: &str| serde_json::from_str::<Few<u8, 3>>(text).map(|few| few.0);
        assert_eq!(list("[1, 2, 3]")?, [1, 2, 3]);
        let error = list("[1, 2, 3, 4]").err().map(|error| error.to_string()).unwrap_or_default();
        assert!(error.contains("invalid length 4, expected a list of at most 3"), "{error}");

        let parameters = |text: &str| serde_json::from_str::<Parameters>(text).map(|parameters| parameters.0);
        assert_eq!(parameters(r#"{"a": 1, "b": "x", "c": true, "d": -0.5, "e": null}"#)?.len(), 5);
        for wrong in [r#"{"a": [0, 0, 0]}"#, r#"{"a": {}}"#, "[]", "7"] {
            assert!(parameters(wrong).is_err(), "{wrong}");
        }
        let many: Map<String, Value> = (0..=MAX_PARAMETERS).map(|i| (i.to_string(), i.into())).collect();
        assert!(parameters(&Value::from(many).to_string()).is_err());
        Ok(())
    }
}
