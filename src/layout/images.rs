//! Where pictures are: patterns such as `images/left/{configuration:04}_{shot:02}.png`, and the files that match.

use std::path::{Path, PathBuf};

/// A parsed picture path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImagePattern {
    components: Vec<Vec<Piece>>,
    absolute: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Piece {
    Text(String),
    /// A number padded with zeros to at least this width.
    Configuration(usize),
    Shot(usize),
}

/// A picture that is there.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct PictureFile {
    /// The configuration in its name.
    pub configuration: u64,
    /// The shot in its name; 0 where the pattern has none.
    pub shot: u64,
    /// Where it is.
    pub path: PathBuf,
}

impl ImagePattern {
    /// Parses a pattern; the error is the end of a sentence that starts with "`images` of camera X".
    ///
    /// # Errors
    /// Unknown or unbalanced braces, a missing `{configuration}`.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut components = Vec::new();
        let mut has_configuration = false;
        for component in text.split('/').filter(|c| !c.is_empty()) {
            let mut pieces = Vec::new();
            let mut rest = component;
            while !rest.is_empty() {
                let Some(open) = rest.find(['{', '}']) else {
                    pieces.push(Piece::Text(rest.to_owned()));
                    break;
                };
                if open > 0 {
                    pieces.push(Piece::Text(rest[..open].to_owned()));
                }
                let inside = rest[open..].strip_prefix('{').and_then(|r| r.split_once('}'));
                let Some((inside, after)) = inside else { return Err("has an unbalanced brace".to_owned()) };
                let (name, width) = match inside.split_once(':') {
                    None => (inside, 0),
                    Some((name, width)) => {
                        let width = width.parse().ok().filter(|w| *w <= 20);
                        (name, width.ok_or_else(|| format!("has the unknown width in `{{{inside}}}`"))?)
                    }
                };
                pieces.push(match name {
                    "configuration" => {
                        has_configuration = true;
                        Piece::Configuration(width)
                    }
                    "shot" => Piece::Shot(width),
                    _ => return Err(format!("has the unknown placeholder `{{{inside}}}`")),
                });
                rest = after;
            }
            components.push(pieces);
        }
        if !has_configuration {
            return Err("has no `{configuration}`".to_owned());
        }
        Ok(Self { components, absolute: text.starts_with('/') })
    }

    /// The path of one picture.
    #[must_use]
    pub fn path(&self, recording: &Path, configuration: u64, shot: u64) -> PathBuf {
        let mut path = self.start(recording);
        for component in &self.components {
            let name: String = component
                .iter()
                .map(|piece| match piece {
                    Piece::Text(text) => text.clone(),
                    Piece::Configuration(width) => format!("{configuration:0width$}"),
                    Piece::Shot(width) => format!("{shot:0width$}"),
                })
                .collect();
            path.push(name);
        }
        path
    }

    /// Every picture that is there, sorted by configuration and shot. A folder that cannot be listed holds none.
    #[must_use]
    pub fn find(&self, recording: &Path) -> Vec<PictureFile> {
        let mut found = Vec::new();
        self.search(&self.start(recording), 0, (None, None), &mut found);
        found.sort();
        found
    }

    fn start(&self, recording: &Path) -> PathBuf {
        if self.absolute { PathBuf::from("/") } else { recording.to_owned() }
    }

    fn search(&self, folder: &Path, depth: usize, known: (Option<u64>, Option<u64>), found: &mut Vec<PictureFile>) {
        let Some(component) = self.components.get(depth) else { return };
        let last = depth + 1 == self.components.len();
        // Most folders say what their entries are, so that files need not be asked one by one.
        let mut visit = |path: PathBuf, file: Option<bool>, (configuration, shot): (Option<u64>, Option<u64>)| {
            if !last {
                self.search(&path, depth + 1, (configuration, shot), found);
            } else if let Some(configuration) = configuration
                && file.unwrap_or_else(|| path.is_file())
            {
                found.push(PictureFile { configuration, shot: shot.unwrap_or(0), path });
            }
        };
        if let [Piece::Text(name)] = &component[..] {
            visit(folder.join(name), None, known);
            return;
        }
        let Ok(entries) = std::fs::read_dir(folder) else { return };
        for entry in entries.flatten() {
            if let Some(name) = entry.file_name().to_str()
                && let Some(numbers) = match_component(component, name, known)
            {
                let kind = entry.file_type().ok().filter(|kind| !kind.is_symlink());
                visit(entry.path(), kind.map(|kind| kind.is_file()), numbers);
            }
        }
    }
}

/// Matches a file name against one component and returns the numbers known so far; a number that appears twice must agree.
fn match_component(
    pieces: &[Piece],
    name: &str,
    known: (Option<u64>, Option<u64>),
) -> Option<(Option<u64>, Option<u64>)> {
    let (mut configuration, mut shot) = known;
    let mut rest = name;
    for piece in pieces {
        match piece {
            Piece::Text(text) => rest = rest.strip_prefix(text.as_str())?,
            Piece::Configuration(width) | Piece::Shot(width) => {
                let end = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
                let digits = &rest[..end];
                let value: u64 = digits.parse().ok()?;
                // Only the spelling that the pattern itself would give, so that no picture is found twice.
                if digits != format!("{value:0width$}") {
                    return None;
                }
                let slot = if matches!(piece, Piece::Configuration(_)) { &mut configuration } else { &mut shot };
                if slot.is_some_and(|before| before != value) {
                    return None;
                }
                *slot = Some(value);
                rest = &rest[end..];
            }
        }
    }
    rest.is_empty().then_some((configuration, shot))
}
