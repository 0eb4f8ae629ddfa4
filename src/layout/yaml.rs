//! YAML as a tree in which every value knows its line.
//!
//! The events come from `saphyr-parser`; the tree is our own because serde loses the lines by the time a
//! sentence such as "this rotation has two keys" can be said. Aliases share their node, so a file that unfolds to a gigabyte
//! costs nothing here; its unfolded size is counted all the same and refused, since nothing honest is that large.

use saphyr_parser::{Event, Parser, ScalarStyle};
use std::collections::HashMap;
use std::rc::Rc;

/// The most values a file may have once its aliases are written out.
const MOST_VALUES: usize = 1_000_000;
/// The deepest nesting: a layout needs about seven levels.
const DEEPEST: usize = 64;

/// A value with the line it starts on.
#[derive(Debug)]
pub struct Node {
    /// Counted from one.
    pub line: usize,
    /// What stands there.
    pub value: Value,
    /// How many values it holds when aliases are written out.
    unfolded: usize,
}

/// What a node holds.
#[derive(Debug)]
pub enum Value {
    /// Text, and whether it was in quotes.
    Scalar {
        /// The text.
        text: String,
        /// In quotes, so never a number or a null.
        quoted: bool,
    },
    /// A list.
    Sequence(Vec<Rc<Node>>),
    /// Keys with their lines, and values, in order.
    Mapping(Vec<(String, usize, Rc<Node>)>),
}

/// Why a text is not a tree.
#[derive(Debug, PartialEq, Eq)]
pub struct YamlError {
    /// Where.
    pub line: usize,
    /// What is wrong.
    pub what: String,
    /// How to mend it.
    pub remedy: String,
}

impl Node {
    /// What kind of value it is, for messages.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match &self.value {
            Value::Scalar { .. } => "a single value",
            Value::Sequence(_) => "a list",
            Value::Mapping(_) => "a mapping",
        }
    }

    /// The text of a scalar.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Scalar { text, .. } => Some(text),
            _ => None,
        }
    }
}

/// A collection being filled.
struct Open {
    line: usize,
    anchor: usize,
    items: Vec<Rc<Node>>,
    keys: Option<Vec<(String, usize)>>,
    unfolded: usize,
}

fn error(line: usize, what: impl Into<String>, remedy: impl Into<String>) -> YamlError {
    YamlError { line, what: what.into(), remedy: remedy.into() }
}

/// Parses one YAML document.
///
/// # Errors
/// Broken syntax, a key given twice, nesting too deep, aliases that unfold to too much, no document or more than one.
pub fn parse(text: &str) -> Result<Rc<Node>, YamlError> {
    let mut stack: Vec<Open> = Vec::new();
    let mut anchors: HashMap<usize, Rc<Node>> = HashMap::new();
    let mut root: Option<Rc<Node>> = None;
    let mut documents = 0;
    for event in Parser::new_from_str(text) {
        let (event, span) = event.map_err(|e| {
            error(
                e.marker().line(),
                format!("this is not YAML: {}", e.info()),
                "check indentation, brackets and quotes here",
            )
        })?;
        let line = span.start.line();
        let (node, anchor) = match event {
            Event::DocumentStart(_) => {
                documents += 1;
                if documents > 1 {
                    return Err(error(line, "a second YAML document starts", "keep one document a file"));
                }
                continue;
            }
            Event::Scalar(text, style, anchor, _) => {
                let value = Value::Scalar { text: text.into_owned(), quoted: style != ScalarStyle::Plain };
                (Rc::new(Node { line, value, unfolded: 1 }), anchor)
            }
            Event::Alias(anchor) => match anchors.get(&anchor) {
                Some(node) => (Rc::clone(node), 0),
                None => return Err(error(line, "an alias refers to itself", "write the value out")),
            },
            Event::SequenceStart(anchor, _) | Event::MappingStart(anchor, _) => {
                if stack.len() >= DEEPEST {
                    let remedy = format!("nothing here needs more than {DEEPEST} levels");
                    return Err(error(line, "the nesting is too deep", remedy));
                }
                let keys = matches!(event, Event::MappingStart(..)).then(Vec::new);
                stack.push(Open { line, anchor, items: Vec::new(), keys, unfolded: 1 });
                continue;
            }
            Event::SequenceEnd | Event::MappingEnd => {
                let Some(open) = stack.pop() else { continue };
                let value = match open.keys {
                    None => Value::Sequence(open.items),
                    Some(keys) => {
                        Value::Mapping(keys.into_iter().zip(open.items).map(|((k, l), n)| (k, l, n)).collect())
                    }
                };
                (Rc::new(Node { line: open.line, value, unfolded: open.unfolded }), open.anchor)
            }
            _ => continue,
        };
        if anchor > 0 {
            anchors.insert(anchor, Rc::clone(&node));
        }
        match stack.last_mut() {
            None => root = Some(node),
            Some(open) => attach(open, node)?,
        }
    }
    root.ok_or_else(|| error(1, "the file is empty", "start from one of the files in `layouts/`"))
}

/// Puts a finished node into the collection around it, as a key or as a value.
fn attach(open: &mut Open, node: Rc<Node>) -> Result<(), YamlError> {
    open.unfolded += node.unfolded;
    if open.unfolded > MOST_VALUES {
        return Err(error(
            node.line,
            format!("aliases here unfold to more than {MOST_VALUES} values"),
            "write the values out; no cell needs that many",
        ));
    }
    match &mut open.keys {
        Some(keys) if keys.len() == open.items.len() => {
            let Some(key) = node.text() else {
                return Err(error(node.line, format!("a key is {}", node.kind()), "keys are single words"));
            };
            if let Some((_, first)) = keys.iter().find(|(known, _)| known == key) {
                return Err(error(
                    node.line,
                    format!("the key `{key}` is given twice, first on line {first}"),
                    "keep one of the two",
                ));
            }
            keys.push((key.to_owned(), node.line));
        }
        _ => open.items.push(node),
    }
    Ok(())
}
