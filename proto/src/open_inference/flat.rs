//! The elements of a tensor in JSON: a list of numbers, or lists in lists as the shape has them, in one order either way.

use std::fmt;

use serde::de::{Deserialize, DeserializeSeed, Deserializer, Error, SeqAccess, Visitor};

/// Deepest nesting of lists; no tensor has as many axes.
const MAX_DEPTH: usize = 8;

/// All numbers of a list, whatever lists they lie in.
#[derive(Debug)]
pub(super) struct Flat(pub(super) Vec<f32>);

/// What comes next: a number or a list, to go to the end of `into`.
struct Next<'a> {
    into: &'a mut Vec<f32>,
    depth: usize,
}

impl<'de> Deserialize<'de> for Flat {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut values = Vec::new();
        deserializer.deserialize_seq(Next { into: &mut values, depth: 0 })?;
        Ok(Self(values))
    }
}

impl<'de> DeserializeSeed<'de> for Next<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Next<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "numbers, in at most {MAX_DEPTH} lists in one another")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        if self.depth == MAX_DEPTH {
            return Err(A::Error::custom(format!("expected at most {MAX_DEPTH} lists in one another")));
        }
        while list.next_element_seed(Next { into: &mut *self.into, depth: self.depth + 1 })?.is_some() {}
        Ok(())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        self.into.push(value as f32);
        Ok(())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<(), E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<(), E> {
        self.visit_f64(value as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_and_flat_lists_hold_the_same_numbers() -> Result<(), serde_json::Error> {
        let read = |text: &str| serde_json::from_str::<Flat>(text).map(|flat| flat.0);
        assert_eq!(read("[1, 2.5, -3]")?, [1.0, 2.5, -3.0]);
        assert_eq!(read("[[[1], [2.5]], [[-3]]]")?, [1.0, 2.5, -3.0]);
        assert!(read("[]")?.is_empty());
        for wrong in ["7", "[null]", "[\"1\"]", "[true]", "[[[[[[[[[1]]]]]]]]]"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        Ok(())
    }
}
