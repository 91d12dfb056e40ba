//! JSON that people write: as `serde_json` reads it, but a key that is repeated in an object is an
//! error.

use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};

/// Begins the message about a repeated key.
pub const REPEATED: &str = "a repeated key";

/// Reads a document; errors have line and column.
pub fn parse(text: &str) -> serde_json::Result<Value> {
    serde_json::from_str::<Unique>(text).map(|Unique(value)| value)
}

/// A value in whose objects every key stands once.
struct Unique(Value);

impl<'de> Deserialize<'de> for Unique {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(UniqueVisitor).map(Self)
    }
}

struct UniqueVisitor;

impl<'de> Visitor<'de> for UniqueVisitor {
    type Value = Value;

    fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("a JSON value")
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(Value::Number(value.into()))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(Value::Number(value.into()))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(Number::from_f64(value).map_or(Value::Null, Value::Number))
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(Value::String(value.to_owned()))
    }

    fn visit_string<E>(self, value: String) -> Result<Value, E> {
        Ok(Value::String(value))
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut values = Vec::new();
        while let Some(Unique(value)) = items.next_element()? {
            values.push(value);
        }
        Ok(Value::Array(values))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut fields = Map::new();
        while let Some(key) = members.next_key::<String>()? {
            if fields.contains_key(&key) {
                return Err(A::Error::custom(format!("{REPEATED}, {key:?}")));
            }
            let Unique(value) = members.next_value()?;
            fields.insert(key, value);
        }
        Ok(Value::Object(fields))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documents_are_read_as_serde_json_reads_them() {
        let text = r#"{"b": [1, -2, 3.5, 1e300, 18446744073709551615, null, true, "a\n\u00e9"], "a": {"b": {}}}"#;
        assert_eq!(parse(text).unwrap(), serde_json::from_str::<Value>(text).unwrap());
        for wrong in ["", "{", "[1,]", "{\"a\": 1} x", "nan", "1e999", &"[".repeat(200)] {
            let (ours, theirs) = (parse(wrong).unwrap_err(), serde_json::from_str::<Value>(wrong).unwrap_err());
            assert_eq!(ours.to_string(), theirs.to_string(), "{wrong}");
        }
    }

    #[test]
    fn a_repeated_key_is_an_error_with_its_place() {
        let cause = parse("{\"a\": [{\"x\": 1,\n \"y\": 2,\n \"x\": 1}]}").unwrap_err();
        assert_eq!((cause.line(), cause.column()), (3, 4));
        assert!(cause.to_string().contains("a repeated key, \"x\""), "{cause}");
        assert!(parse("{\"a\": {\"x\": 1}, \"b\": {\"x\": 1}}").is_ok());
    }
}
