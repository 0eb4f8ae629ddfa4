//! What a solution file says of itself.

use serde_json::{Map, Value as Json};
use std::path::Path;

use crate::complaint::{Complaint, InputError};
use crate::layout::plain;
use crate::layout::yaml::{self, Node, Value};

/// The section `solution` of a file.
///
/// # Errors
/// A file that cannot be read or has no such section.
pub(super) fn findings(file: &Path) -> Result<Json, InputError> {
    let text = std::fs::read_to_string(file)
        .map_err(|e| Complaint::of(file, format!("the solution cannot be read: {}", plain(&e)), "check the path"))?;
    let root = yaml::parse(&text).map_err(|e| Complaint::at(file, e.line, e.what, e.remedy))?;
    match as_json(&root).get("solution") {
        Some(found @ Json::Object(_)) => Ok(found.clone()),
        _ => Err(Complaint::of(
            file,
            "this layout is no solution: it has no section `solution`",
            "give the file that `cellmap solve` wrote, or use `cellmap solve LAYOUT --report FILE`",
        )
        .into()),
    }
}

fn as_json(node: &Node) -> Json {
    match &node.value {
        Value::Scalar { text, quoted: true } => Json::String(text.clone()),
        Value::Scalar { text, .. } => match text.as_str() {
            "null" | "~" | "" => Json::Null,
            "true" => Json::Bool(true),
            "false" => Json::Bool(false),
            _ => text
                .parse::<u64>()
                .map(Json::from)
                .or_else(|_| text.parse::<f64>().map(Json::from))
                .unwrap_or(Json::String(text.clone())),
        },
        Value::Sequence(items) => Json::Array(items.iter().map(|item| as_json(item)).collect()),
        Value::Mapping(entries) => {
            Json::Object(entries.iter().map(|(key, _, value)| (key.clone(), as_json(value))).collect::<Map<_, _>>())
        }
    }
}
