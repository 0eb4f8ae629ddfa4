//! A document that can be written as YAML for people and as JSON for programs, with its keys in the order they were put.

use serde::ser::{Serialize, SerializeMap, SerializeSeq, Serializer};
use serde_saphyr::FlowSeq;

use super::model::Description;

/// A value of a document.
#[derive(Clone, Debug, PartialEq)]
pub enum Document {
    /// Not known.
    Null,
    /// Yes or no.
    Flag(bool),
    /// A whole number.
    Whole(u64),
    /// A number; one that is not finite is written as null, so that no file ever holds a NaN.
    Number(f64),
    /// Text.
    Text(String),
    /// A list on one line.
    Row(Vec<Document>),
    /// A list, an item a line.
    List(Vec<Document>),
    /// A mapping in order.
    Map(Vec<(String, Document)>),
}

impl Document {
    /// A list of numbers on one line.
    #[must_use]
    pub fn numbers(values: &[f64]) -> Self {
        Self::Row(values.iter().map(|value| Self::Number(*value)).collect())
    }

    /// A list of numbers some of which are not known.
    #[must_use]
    pub fn known(values: &[Option<f64>]) -> Self {
        Self::Row(values.iter().map(|value| value.map_or(Self::Null, Self::Number)).collect())
    }

    /// Text.
    #[must_use]
    pub fn text(value: impl Into<String>) -> Self {
        Self::Text(value.into())
    }

    /// A mapping.
    #[must_use]
    pub fn map<const N: usize>(entries: [(&str, Document); N]) -> Self {
        Self::Map(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
    }

    /// As YAML.
    ///
    /// # Errors
    /// None that a document can cause; the writer's own are passed on.
    pub fn to_yaml(&self) -> Result<String, std::io::Error> {
        serde_saphyr::to_string(self).map_err(std::io::Error::other)
    }

    /// As JSON, indented.
    ///
    /// # Errors
    /// None that a document can cause; the writer's own are passed on.
    pub fn to_json(&self) -> Result<String, std::io::Error> {
        serde_json::to_string_pretty(self).map_err(std::io::Error::other)
    }
}

impl From<&Description> for Document {
    fn from(description: &Description) -> Self {
        match description {
            Description::Scalar { text, quoted } => match text.as_str() {
                _ if *quoted => Self::Text(text.clone()),
                "true" => Self::Flag(true),
                "false" => Self::Flag(false),
                _ => match (text.parse::<u64>(), text.parse::<f64>()) {
                    (Ok(whole), _) => Self::Whole(whole),
                    (_, Ok(number)) if number.is_finite() => Self::Number(number),
                    _ => Self::Text(text.clone()),
                },
            },
            Description::List(items) => {
                let items: Vec<Self> = items.iter().map(Self::from).collect();
                let plain = items.iter().all(|item| !matches!(item, Self::Map(_) | Self::List(_) | Self::Row(_)));
                if plain { Self::Row(items) } else { Self::List(items) }
            }
            Description::Mapping(entries) => {
                Self::Map(entries.iter().map(|(key, value)| (key.clone(), Self::from(value))).collect())
            }
        }
    }
}

impl Serialize for Document {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Null => serializer.serialize_unit(),
            Self::Flag(value) => serializer.serialize_bool(*value),
            Self::Whole(value) => serializer.serialize_u64(*value),
            Self::Number(value) if value.is_finite() => serializer.serialize_f64(*value),
            Self::Number(_) => serializer.serialize_unit(),
            Self::Text(value) => serializer.serialize_str(value),
            Self::Row(items) => FlowSeq(items).serialize(serializer),
            Self::List(items) => {
                let mut list = serializer.serialize_seq(Some(items.len()))?;
                for item in items {
                    list.serialize_element(item)?;
                }
                list.end()
            }
            Self::Map(entries) => {
                let mut map = serializer.serialize_map(Some(entries.len()))?;
                for (key, value) in entries {
                    map.serialize_entry(key, value)?;
                }
                map.end()
            }
        }
    }
}
