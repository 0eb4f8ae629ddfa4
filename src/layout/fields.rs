//! Reading a YAML mapping key by key, and complaining about all that is wrong in it at once.
//!
//! A [`Fields`] remembers which keys were asked for, so the list of allowed keys, the "unknown key" complaint and its
//! suggestion always agree with what the program reads.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::yaml::{Node, Value};
use crate::complaint::{Complaint, list, nearest};

/// Where complaints about one file are gathered.
#[derive(Debug)]
pub struct Gathered<'a> {
    /// The file.
    pub file: &'a Path,
    /// What was found wrong so far.
    pub complaints: RefCell<Vec<Complaint>>,
    /// Other files that were read on the way.
    pub read: RefCell<Vec<PathBuf>>,
}

impl<'a> Gathered<'a> {
    /// Nothing wrong so far.
    #[must_use]
    pub fn new(file: &'a Path) -> Self {
        Self { file, complaints: RefCell::default(), read: RefCell::default() }
    }

    /// Adds a complaint about a line and returns `None`, for use as a function's value.
    pub fn complain<T>(&self, line: usize, what: impl Into<String>, remedy: impl Into<String>) -> Option<T> {
        self.complaints.borrow_mut().push(Complaint::at(self.file, line, what, remedy));
        None
    }

    /// Takes over what another file was found to have wrong, and returns `None`.
    pub fn adopt<T>(&self, complaints: Vec<Complaint>) -> Option<T> {
        self.complaints.borrow_mut().extend(complaints);
        None
    }
}

/// A mapping being read.
#[derive(Debug)]
pub struct Fields<'a> {
    /// Where to complain.
    pub to: &'a Gathered<'a>,
    /// What the mapping describes, for messages: ``camera `left` ``.
    pub what: String,
    /// The line the mapping starts on.
    pub line: usize,
    entries: &'a [(String, usize, Rc<Node>)],
    asked: RefCell<Vec<&'static str>>,
}

impl<'a> Fields<'a> {
    /// Opens a node as a mapping; complains and returns `None` if it is something else.
    pub fn open(to: &'a Gathered<'a>, node: &'a Node, what: impl Into<String>) -> Option<Self> {
        let what = what.into();
        match &node.value {
            Value::Mapping(entries) => Some(Self { to, what, line: node.line, entries, asked: RefCell::default() }),
            // `left:` with nothing behind it is a thing of which nothing is said.
            Value::Scalar { text, quoted: false } if ["", "~", "null"].contains(&text.as_str()) => {
                Some(Self { to, what, line: node.line, entries: &[], asked: RefCell::default() })
            }
            _ => {
                let found = node.kind();
                to.complain(node.line, format!("{what} is {found}"), "write it as `{key: value, ...}`")
            }
        }
    }

    /// The value of an optional key.
    pub fn get(&self, key: &'static str) -> Option<&'a Node> {
        self.asked.borrow_mut().push(key);
        self.entries.iter().find(|(k, _, _)| k == key).map(|(_, _, node)| &**node)
    }

    /// The value of a key that must be there; complains if it is not.
    pub fn require(&self, key: &'static str, example: &str) -> Option<&'a Node> {
        let found = self.get(key);
        if found.is_none() {
            self.to.complain::<()>(
                self.line,
                format!("{} has no `{key}`", self.what),
                format!("add for example `{key}: {example}`"),
            );
        }
        found
    }

    /// All entries, for mappings whose keys are names.
    #[must_use]
    pub fn names(&self) -> &'a [(String, usize, Rc<Node>)] {
        self.entries
    }

    /// Complains about every key that was not asked for.
    pub fn finish(self) {
        let asked = self.asked.borrow();
        for (key, line, _) in self.entries {
            if asked.contains(&key.as_str()) {
                continue;
            }
            let remedy = match nearest(key, asked.iter().copied()) {
                Some(meant) => format!("did you mean `{meant}`?"),
                None => format!("known here: {}", list(asked.iter().copied())),
            };
            self.to.complain::<()>(*line, format!("unknown key `{key}` in {}", self.what), remedy);
        }
    }

    /// A finite number.
    pub fn number(&self, node: &Node, what: &str) -> Option<f64> {
        number(self.to, node, &format!("{what} of {}", self.what))
    }

    /// A positive finite number.
    pub fn positive(&self, node: &Node, what: &str) -> Option<f64> {
        let value = self.number(node, what)?;
        if value > 0.0 {
            return Some(value);
        }
        self.to.complain(node.line, format!("{what} of {} is {value}", self.what), "it must be greater than zero")
    }

    /// A list of exactly `N` finite numbers.
    pub fn numbers<const N: usize>(&self, node: &Node, what: &str) -> Option<[f64; N]> {
        let values = self.list(node, what)?;
        let count = values.len();
        values.try_into().ok().or_else(|| {
            self.to.complain(node.line, format!("{what} of {} has {count} numbers", self.what), format!("it takes {N}"))
        })
    }

    /// A list of finite numbers.
    pub fn list(&self, node: &Node, what: &str) -> Option<Vec<f64>> {
        number_list(self.to, node, &format!("{what} of {}", self.what))
    }

    /// A whole number between `least` and `most`.
    pub fn whole(&self, node: &Node, what: &str, least: u32, most: u32) -> Option<u32> {
        let value = node.text().and_then(|text| text.parse::<i64>().ok());
        match value.and_then(|value| u32::try_from(value).ok()) {
            Some(value) if (least..=most).contains(&value) => Some(value),
            _ => self.to.complain(
                node.line,
                format!("{what} of {} is {}", self.what, shown(node)),
                format!("it must be a whole number from {least} to {most}"),
            ),
        }
    }

    /// A list of exactly `N` whole numbers of at least one.
    pub fn counts<const N: usize>(&self, node: &Node, what: &str) -> Option<[u32; N]> {
        let Value::Sequence(items) = &node.value else {
            return self.to.complain(
                node.line,
                format!("{what} of {} is {}", self.what, node.kind()),
                format!("write a list of {N} whole numbers"),
            );
        };
        let values: Option<Vec<u32>> = items.iter().map(|item| self.whole(item, what, 1, 1_000_000)).collect();
        values?.try_into().ok().or_else(|| {
            self.to.complain(
                node.line,
                format!("{what} of {} has {} numbers", self.what, items.len()),
                format!("it takes {N}"),
            )
        })
    }

    /// A single piece of text.
    pub fn text(&self, node: &'a Node, what: &str) -> Option<&'a str> {
        node.text().or_else(|| {
            self.to.complain(node.line, format!("{what} of {} is {}", self.what, node.kind()), "write a single name")
        })
    }

    /// `true` or `false`.
    pub fn flag(&self, node: &Node, what: &str) -> Option<bool> {
        match node.text() {
            Some("true") => Some(true),
            Some("false") => Some(false),
            _ => self.to.complain(
                node.line,
                format!("{what} of {} is {}", self.what, shown(node)),
                "write `true` or `false`",
            ),
        }
    }
}

/// A node as it looks in a message.
#[must_use]
pub fn shown(node: &Node) -> String {
    node.text().map_or_else(|| node.kind().to_owned(), |text| format!("`{text}`"))
}

/// A list of finite numbers.
pub(super) fn number_list(to: &Gathered<'_>, node: &Node, what: &str) -> Option<Vec<f64>> {
    match &node.value {
        Value::Sequence(items) => items.iter().map(|item| number(to, item, what)).collect(),
        _ => to.complain(node.line, format!("{what} is {}", node.kind()), "write a list such as `[1, 2, 3]`"),
    }
}

fn number(to: &Gathered<'_>, node: &Node, what: &str) -> Option<f64> {
    let value = match &node.value {
        Value::Scalar { text, quoted: false } => text.parse::<f64>().ok(),
        _ => None,
    };
    match value {
        Some(value) if value.is_finite() => Some(value),
        Some(_) => to.complain(node.line, format!("{what} is {}", shown(node)), "it must be a finite number"),
        None => to.complain(node.line, format!("{what} is {}", shown(node)), "it must be a number"),
    }
}
