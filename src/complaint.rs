//! The one form in which input is refused: file, line, what is wrong, and how to mend it.

use std::fmt;
use std::path::{Path, PathBuf};

/// One thing wrong with one place of the input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Complaint {
    /// The file it stands in.
    pub file: PathBuf,
    /// The line, counted from one, where one can be named.
    pub line: Option<usize>,
    /// What is wrong, in one sentence without a full stop.
    pub what: String,
    /// What to do about it.
    pub remedy: String,
}

impl Complaint {
    /// A complaint about a line of a file.
    #[must_use]
    pub fn at(file: &Path, line: usize, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { file: file.to_owned(), line: Some(line), what: what.into(), remedy: remedy.into() }
    }

    /// A complaint about a file as a whole.
    #[must_use]
    pub fn of(file: &Path, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { file: file.to_owned(), line: None, what: what.into(), remedy: remedy.into() }
    }
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            Some(line) => write!(f, "{}:{line}: {}; {}", self.file.display(), self.what, self.remedy),
            None => write!(f, "{}: {}; {}", self.file.display(), self.what, self.remedy),
        }
    }
}

/// Input that cannot be used: at least one complaint, in the order of the input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputError(pub Vec<Complaint>);

impl From<Complaint> for InputError {
    fn from(complaint: Complaint) -> Self {
        Self(vec![complaint])
    }
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, complaint) in self.0.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{complaint}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Complaint {}

impl std::error::Error for InputError {}

/// `, did you mean ...` for a misspelt name: the nearest of `known`, if any is near enough to be meant.
#[must_use]
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    known
        .into_iter()
        .map(|candidate| (strsim::damerau_levenshtein(&name.to_lowercase(), &candidate.to_lowercase()), candidate))
        .filter(|(distance, candidate)| *distance <= 1 + candidate.len().min(name.len()) / 4)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// A list of names for a message: `a`, `b` or `c`.
#[must_use]
pub fn list<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let quoted: Vec<String> = names.into_iter().map(|name| format!("`{name}`")).collect();
    match quoted.split_last() {
        None => "nothing".to_owned(),
        Some((last, [])) => last.clone(),
        Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
    }
}
