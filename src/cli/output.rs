//! How the program speaks: errors, tables, JSON, progress.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::path::Path;

use cellmap::complaint::{Complaint, InputError};
use cellmap::export::Document;

/// Prints a line on stdout. A reader that has gone away (`cellmap check | head`) is no fault of ours: what it does not read is dropped.
macro_rules! say {
    ($($words:tt)*) => { $crate::cli::output::line(format_args!($($words)*)) };
}
pub(super) use say;

/// What [`say`] does.
pub(super) fn line(words: std::fmt::Arguments<'_>) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_fmt(words).and_then(|()| out.write_all(b"\n"));
}

/// Columns that running text keeps to.
const WIDTH: usize = 80;

/// Prints running text in lines of at most 80 columns: the first begins with `label`, the others are indented by `indent`. A word longer than
/// a line stands alone.
pub(super) fn say_wrapped(label: &str, indent: usize, text: &str) {
    for line in wrapped(label, indent, text) {
        say!("{line}");
    }
}

fn wrapped(label: &str, indent: usize, text: &str) -> Vec<String> {
    let mut lines = Vec::new();
    let mut current = label.to_owned();
    let mut empty = label.is_empty();
    for word in text.split_whitespace() {
        let gap = usize::from(!empty && !current.ends_with(' '));
        if !empty && current.chars().count() + gap + word.chars().count() > WIDTH {
            lines.push(std::mem::replace(&mut current, " ".repeat(indent)));
        } else if gap == 1 {
            current.push(' ');
        }
        current.push_str(word);
        empty = false;
    }
    lines.push(current);
    lines
}

/// Shows an error: each complaint with its line and its remedy on stderr, or as one JSON object on stdout.
pub(super) fn show_error(error: &InputError, json: bool) {
    for complaint in &error.0 {
        show_complaint(complaint);
    }
    if json {
        let one = |c: &Complaint| {
            Document::map([
                ("file", Document::text(c.file.display().to_string())),
                ("line", c.line.map_or(Document::Null, |line| Document::Whole(line as u64))),
                ("what", Document::text(&c.what)),
                ("remedy", Document::text(&c.remedy)),
            ])
        };
        print_json(&Document::map([("errors", Document::List(error.0.iter().map(one).collect()))]));
    }
}

/// A path as a person would write it.
pub(super) fn shown(path: &Path) -> std::path::Display<'_> {
    path.strip_prefix(".").ok().filter(|inside| inside.components().next().is_some()).unwrap_or(path).display()
}

fn show_complaint(complaint: &Complaint) {
    eprintln!("error: {}", complaint.what);
    match complaint.line {
        Some(line) => {
            eprintln!("  --> {}:{line}", shown(&complaint.file));
            let text = std::fs::read_to_string(&complaint.file).unwrap_or_default();
            if let Some(source) = text.lines().nth(line - 1).filter(|source| !source.trim().is_empty()) {
                let shown: String = source.trim_end().chars().take(100).collect();
                eprintln!("{line:5} | {shown}");
            }
        }
        None => eprintln!("  --> {}", shown(&complaint.file)),
    }
    eprintln!("  help: {}", complaint.remedy);
}

/// Prints one JSON object.
pub(super) fn print_json(document: &Document) {
    match document.to_json() {
        Ok(text) => say!("{text}"),
        Err(error) => eprintln!("error: {error}"),
    }
}

/// A table of text: the first column to the left, the others to the right.
pub(super) fn print_table(header: &[&str], rows: &[Vec<String>]) {
    let columns = header.len();
    let mut widths: Vec<usize> = header.iter().map(|text| text.chars().count()).collect();
    for row in rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = (*width).max(cell.chars().count());
        }
    }
    let line = |cells: Vec<&str>| {
        let mut text = String::new();
        for (i, cell) in cells.iter().enumerate().take(columns) {
            let gap = " ".repeat(widths[i].saturating_sub(cell.chars().count()));
            if i == 0 {
                text.push_str(&format!("{cell}{gap}"));
            } else {
                text.push_str(&format!("  {gap}{cell}"));
            }
        }
        say!("{}", text.trim_end());
    };
    line(header.to_vec());
    for row in rows {
        line(row.iter().map(String::as_str).collect());
    }
}

/// A progress bar on stderr with the time left; silent unless stderr is a terminal.
pub(super) fn progress_bar(what: &str) -> ProgressBar {
    let target =
        if std::io::stderr().is_terminal() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(None, target);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {per_sec} {eta} left") {
        bar.set_style(style);
    }
    bar.set_message(what.to_owned());
    bar
}

/// Makes Ctrl-C wait for a file that is just being put in place, then end the program. `detect` installs its own wish to stop on top, see
/// [`stop_requested`].
pub(super) fn exit_cleanly_on_interrupt() {
    // A second handler cannot be installed; without one the default (end at once) applies, and files are whole then too.
    let _ = ctrlc::set_handler(|| {
        if GENTLE.load(std::sync::atomic::Ordering::Relaxed) && !STOP.swap(true, std::sync::atomic::Ordering::Relaxed) {
            return;
        }
        cellmap::recording::atomic::wait_for_writers();
        std::process::exit(130);
    });
}

static GENTLE: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);
static STOP: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

/// From here on the first Ctrl-C only sets the flag that is returned; the second ends the program.
pub(super) fn stop_requested() -> &'static std::sync::atomic::AtomicBool {
    GENTLE.store(true, std::sync::atomic::Ordering::Relaxed);
    &STOP
}

#[cfg(test)]
mod tests {
    use super::wrapped;

    #[test]
    fn running_text_keeps_to_eighty_columns() {
        let text = "a word and another one ".repeat(20);
        let lines = wrapped("warning: ", 4, &text);
        assert!(lines.len() > 4 && lines.iter().all(|line| line.chars().count() <= 80), "{lines:?}");
        assert!(
            lines[0].starts_with("warning: a word") && lines[1].starts_with("    ") && !lines[1].starts_with("     ")
        );
        let joined: Vec<&str> = lines.iter().flat_map(|line| line.split_whitespace()).skip(1).collect();
        assert_eq!(joined, text.split_whitespace().collect::<Vec<_>>(), "no word is lost");
        assert_eq!(wrapped("", 2, "short"), ["short"]);
    }
}
