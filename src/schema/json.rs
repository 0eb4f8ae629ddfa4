//! The table as JSON Schema (draft 2020-12).

use serde_json::{Map, Value, json};

use super::File;
use super::keys::{Kind, SECTIONS, Section};
use crate::geometry::dictionary::Dictionary;

/// The schema of a kind of file.
#[must_use]
pub fn json_schema(file: File) -> Value {
    let definitions: Map<String, Value> =
        SECTIONS.iter().map(|section| (section.name.to_owned(), mapping(section))).collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": format!("cellmap {}", file.name().replace('_', " ")),
        "$ref": format!("#/$defs/{}", file.name()),
        "$defs": definitions,
    })
}

fn mapping(section: &Section) -> Value {
    let mut properties = Map::new();
    let mut required = Vec::new();
    for key in section.keys {
        let mut value = schema(key.kind);
        let unit = if key.unit.is_empty() { String::new() } else { format!(" [{}]", key.unit) };
        let default = if key.default.is_empty() { String::new() } else { format!(" Default: {}.", key.default) };
        if let Value::Object(map) = &mut value {
            map.insert("description".to_owned(), json!(format!("{}{unit}.{default}", key.words)));
        }
        properties.insert(key.name.to_owned(), value);
        if key.default.is_empty() {
            required.push(key.name);
        }
    }
    let mut all = json!({
        "type": if section.keys.iter().all(|key| !key.default.is_empty()) { json!(["object", "null"]) } else { json!("object") },
        "description": section.words,
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    });
    if section.one_of.is_empty() {
        return all;
    }
    // Exactly one set of keys: all of its keys, and none of another set's.
    let every: Vec<&str> = section.one_of.iter().flat_map(|set| set.iter().copied()).collect();
    let mut choices: Vec<Value> = section
        .one_of
        .iter()
        .map(|set| {
            let others = every.iter().filter(|name| !set.contains(name)).map(|name| json!({"required": [name]}));
            json!({"required": set, "not": {"anyOf": others.collect::<Vec<_>>()}})
        })
        .collect();
    if section.or_none {
        choices
            .push(json!({"not": {"anyOf": every.iter().map(|name| json!({"required": [name]})).collect::<Vec<_>>()}}));
    }
    if let Value::Object(map) = &mut all {
        map.insert("oneOf".to_owned(), Value::Array(choices));
        if section.name == "pose" {
            let pairs = [("sigma", "start"), ("sigma", "unknown"), ("start", "unknown")];
            let pairs: Vec<Value> = pairs.iter().map(|(a, b)| json!({"required": [a, b]})).collect();
            map.insert("not".to_owned(), json!({"anyOf": pairs}));
        }
    }
    all
}

fn list(items: Value, count: usize) -> Value {
    json!({"type": "array", "items": items, "minItems": count, "maxItems": count})
}

fn schema(kind: Kind) -> Value {
    match kind {
        Kind::Whole(least, most) => json!({"type": "integer", "minimum": least, "maximum": most}),
        Kind::Number => json!({"type": "number"}),
        Kind::Positive => json!({"type": "number", "exclusiveMinimum": 0}),
        Kind::NotNegative => json!({"type": "number", "minimum": 0}),
        Kind::Share => json!({"type": "number", "minimum": 0, "maximum": 1}),
        Kind::Flag => json!({"type": "boolean"}),
        Kind::Text => json!({"type": ["string", "number"]}),
        Kind::Choice(words) => json!({"enum": words}),
        Kind::Numbers(count) => list(json!({"type": "number"}), count),
        Kind::List => json!({"type": "array", "items": {"type": "number"}}),
        Kind::Counts(count) => list(json!({"type": "integer", "minimum": 1, "maximum": 1_000_000}), count),
        Kind::Ids => json!({"type": "array", "items": {"type": "integer", "minimum": 0}, "minItems": 1}),
        Kind::Rows(count) => json!({"type": "array", "items": list(json!({"type": "number"}), count)}),
        Kind::Words([]) => json!({"type": "array", "items": {"type": "string"}}),
        Kind::Words(words) => json!({"type": "array", "items": {"enum": words}}),
        Kind::Section(name) => json!({"$ref": format!("#/$defs/{name}")}),
        Kind::Named(inner) => json!({
            "type": ["object", "null"],
            "propertyNames": {"pattern": "^[^\\s.,/:]+$", "not": {"const": "world"}},
            "additionalProperties": schema(*inner),
        }),
        Kind::ListOf(name) => json!({"type": "array", "items": {"$ref": format!("#/$defs/{name}")}, "minItems": 1}),
        Kind::Either(kinds) => json!({"anyOf": kinds.iter().map(|kind| schema(*kind)).collect::<Vec<_>>()}),
        Kind::Dictionary => {
            // Any spelling that the program reads: with or without DICT_, short names, either case.
            let names: Vec<&str> = Dictionary::all().map(Dictionary::name).collect();
            let short = |name: &str| {
                let bare = name.trim_start_matches("aruco_").trim_start_matches("apriltag_").to_owned();
                let shorter = bare.trim_start_matches("mip_").trim_start_matches("standard").to_owned();
                [name.to_owned(), bare, shorter]
            };
            let mut all: Vec<String> = names.iter().flat_map(|name| short(name)).collect();
            all.sort();
            all.dedup();
            let any_case = |name: &String| -> String {
                name.chars()
                    .map(|c| {
                        if c.is_ascii_alphabetic() {
                            format!("[{}{}]", c.to_ascii_lowercase(), c.to_ascii_uppercase())
                        } else {
                            c.to_string()
                        }
                    })
                    .collect()
            };
            let pattern = all.iter().map(any_case).collect::<Vec<_>>().join("|");
            json!({"type": "string", "pattern": format!("^([Dd][Ii][Cc][Tt]_)?({pattern})$"), "examples": names})
        }
        Kind::Anything => json!({}),
    }
}
