//! A CSV file with a header: named columns, checked cells, line numbers in every complaint.

use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use crate::complaint::{Complaint, InputError, list, nearest};
use crate::layout::plain;

/// A CSV file being read.
pub struct Table {
    file: PathBuf,
    reader: csv::Reader<Box<dyn Read>>,
    /// Lines of the file between the header and what is read.
    passed_over: usize,
    record: csv::ByteRecord,
    columns: usize,
    header: Vec<String>,
}

impl std::fmt::Debug for Table {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Table").field("file", &self.file).field("header", &self.header).finish_non_exhaustive()
    }
}

/// One line of a table.
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    table: &'a Table,
    /// Counted from one.
    pub line: usize,
}

impl Table {
    /// Opens a CSV file and checks its header: every one of `required` must be there.
    ///
    /// # Errors
    /// A missing or unreadable file, a missing column.
    pub fn open(path: &Path, required: &[&str]) -> Result<Self, InputError> {
        let file = std::fs::File::open(path).map_err(|e| {
            Complaint::of(
                path,
                format!("the file cannot be read: {}", plain(&e)),
                "paths are relative to the recording's folder, by default the layout's own",
            )
        })?;
        Self::over(path, Box::new(file), 0, required)
    }

    /// As [`Table::open`], of a part of a file that is in memory already: its header, and then the lines after the first `passed_over` ones below it.
    pub(super) fn part(path: &Path, text: Vec<u8>, passed_over: usize, required: &[&str]) -> Result<Self, InputError> {
        Self::over(path, Box::new(Cursor::new(text)), passed_over, required)
    }

    fn over(path: &Path, from: Box<dyn Read>, passed_over: usize, required: &[&str]) -> Result<Self, InputError> {
        let mut reader =
            csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).buffer_capacity(1 << 16).from_reader(from);
        let header: Vec<String> = match reader.headers() {
            Ok(header) => header.iter().map(|name| name.trim_start_matches('\u{feff}').to_owned()).collect(),
            Err(e) => {
                return Err(Complaint::at(
                    path,
                    1,
                    format!("the header cannot be read: {e}"),
                    "save the file as UTF-8 text",
                )
                .into());
            }
        };
        for name in required {
            if !header.iter().any(|known| known == name) {
                let remedy = match nearest(name, header.iter().map(String::as_str)) {
                    Some(meant) => format!("rename the column `{meant}`"),
                    None => format!("the header needs {}", required.join(",")),
                };
                return Err(Complaint::at(path, 1, format!("the column `{name}` is missing"), remedy).into());
            }
        }
        let (file, record, columns) = (path.to_owned(), csv::ByteRecord::new(), header.len());
        Ok(Self { file, reader, passed_over, record, columns, header })
    }

    /// The place of a column, if the file has it.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|known| known == name)
    }

    /// The places of several columns that [`Table::open`] has required.
    #[must_use]
    pub fn columns<const N: usize>(&self, names: [&str; N]) -> [usize; N] {
        names.map(|name| self.column(name).unwrap_or(usize::MAX))
    }

    /// The path of the file.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The next line, or `None` at the end.
    ///
    /// # Errors
    /// A line that is no CSV or has another number of cells than the header.
    pub fn next_row(&mut self) -> Result<Option<Row<'_>>, InputError> {
        loop {
            let more = self.reader.read_byte_record(&mut self.record).map_err(|e| {
                let line = e.position().map_or(1, |p| p.line() as usize) + self.passed_over;
                Complaint::at(&self.file, line, format!("the line cannot be read: {e}"), "check quotes and encoding")
            })?;
            if !more {
                return Ok(None);
            }
            let line = self.record.position().map_or(1, |p| p.line() as usize) + self.passed_over;
            if self.record.len() == 1 && self.record.get(0).is_some_and(<[u8]>::is_empty) {
                continue;
            }
            if self.record.len() != self.columns {
                let what = format!("the line has {} cells, the header {}", self.record.len(), self.columns);
                return Err(Complaint::at(&self.file, line, what, "give every line as many cells as the header").into());
            }
            return Ok(Some(Row { table: self, line }));
        }
    }
}

impl<'a> Row<'a> {
    /// A complaint about this line.
    pub fn complaint(&self, what: impl Into<String>, remedy: impl Into<String>) -> InputError {
        Complaint::at(&self.table.file, self.line, what, remedy).into()
    }

    /// The text of a cell, trimmed; empty if there is none.
    pub fn text(&self, column: usize) -> Result<&'a str, InputError> {
        let bytes = self.table.record.get(column).unwrap_or_default();
        std::str::from_utf8(bytes).map(str::trim).map_err(|_| {
            self.complaint(format!("the {} is not text", self.name(column)), "save the file as UTF-8 text")
        })
    }

    /// A finite number.
    pub fn number(&self, column: usize) -> Result<f64, InputError> {
        let text = self.text(column)?;
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => Err(self.complaint(
                format!("{} is {text}", self.name(column)),
                "every number must be finite: leave the line out if the value is not known",
            )),
            Err(_) => Err(self.complaint(format!("{} is `{text}`", self.name(column)), "it must be a number")),
        }
    }

    /// Several finite numbers.
    pub fn numbers<const N: usize>(&self, columns: [usize; N]) -> Result<[f64; N], InputError> {
        let mut values = [0.0; N];
        for (value, column) in values.iter_mut().zip(columns) {
            *value = self.number(column)?;
        }
        Ok(values)
    }

    /// A whole number of at least zero.
    pub fn whole(&self, column: usize) -> Result<u64, InputError> {
        let text = self.text(column)?;
        text.parse::<u64>().map_err(|_| {
            self.complaint(format!("{} is `{text}`", self.name(column)), "it must be a whole number of at least 0")
        })
    }

    /// The place of a cell's text among `names`.
    pub fn one_of(&self, column: usize, kind: &str, names: &[&str]) -> Result<usize, InputError> {
        let text = self.text(column)?;
        names.iter().position(|name| *name == text).ok_or_else(|| {
            let remedy = match nearest(text, names.iter().copied()) {
                Some(meant) => format!("did you mean `{meant}`?"),
                None => format!("the layout has {}", list(names.iter().copied())),
            };
            self.complaint(format!("the layout has no {kind} `{text}`"), remedy)
        })
    }

    fn name(&self, column: usize) -> String {
        format!("`{}`", self.table.header.get(column).map_or("?", String::as_str))
    }
}
