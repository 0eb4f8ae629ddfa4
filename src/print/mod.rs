//! The targets of a layout as a PDF in true size.
//!
//! A target becomes [`plate`]s: flat pieces to cut out, each with its white margin, its name and the size to measure on the paper. A cube becomes a net with glue
//! flaps ([`net`]), a solid of tags one plate a face. [`arrange`] puts plates on pages, [`pdf`] writes them as vectors: nothing is
//! rasterised, so edges are as sharp as the printer.
//!
//! Everything here is in millimetres, x to the right and **y down** from the top left corner, as one thinks of a page.

mod arrange;
mod net;
mod pdf;
mod plate;
mod shapes;
mod tiles;

use thiserror::Error;

use crate::layout::Layout;

pub use plate::PrintedTag;

/// Paper to print on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paper {
    /// 210 x 297 mm.
    A4,
    /// 297 x 420 mm.
    A3,
    /// 420 x 594 mm.
    A2,
    /// 594 x 841 mm.
    A1,
    /// 841 x 1189 mm.
    A0,
    /// 8.5 x 11 in.
    Letter,
    /// 11 x 17 in.
    Tabloid,
    /// A page a tag, as large as it needs.
    Tag,
}

impl Paper {
    /// All of them, small ones first.
    pub const ALL: [Self; 8] =
        [Self::A4, Self::Letter, Self::A3, Self::Tabloid, Self::A2, Self::A1, Self::A0, Self::Tag];

    /// The word on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::A4 => "a4",
            Self::A3 => "a3",
            Self::A2 => "a2",
            Self::A1 => "a1",
            Self::A0 => "a0",
            Self::Letter => "letter",
            Self::Tabloid => "tabloid",
            Self::Tag => "tag",
        }
    }

    /// Width and height (mm), upright; none for a page that follows the tag.
    #[must_use]
    pub fn size(self) -> Option<[f64; 2]> {
        Some(match self {
            Self::A4 => [210.0, 297.0],
            Self::A3 => [297.0, 420.0],
            Self::A2 => [420.0, 594.0],
            Self::A1 => [594.0, 841.0],
            Self::A0 => [841.0, 1189.0],
            Self::Letter => [215.9, 279.4],
            Self::Tabloid => [279.4, 431.8],
            Self::Tag => return None,
        })
    }
}

/// What to print, and how.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PrintOptions {
    /// The paper.
    pub paper: Paper,
    /// Only these targets; empty for all.
    pub targets: Vec<String>,
    /// Whether a plate larger than the paper is spread over several pages.
    pub tile: bool,
}

/// Why nothing was printed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PrintError {
    /// A target that the layout does not have.
    #[error("the layout has no target `{0}`")]
    NoSuchTarget(String),
    /// No target can be printed.
    #[error("no target of the layout can be printed")]
    Nothing,
    /// A plate is larger than the paper.
    #[error("`{title}` is {width:.0} x {height:.0} mm with its margin and does not fit on {paper}")]
    TooLarge {
        /// The plate.
        title: String,
        /// mm, rounded up.
        width: u32,
        /// mm, rounded up.
        height: u32,
        /// The paper.
        paper: &'static str,
        /// The smallest paper that it fits on.
        fits: Option<&'static str>,
    },
}

/// A page as it was printed.
#[derive(Clone, Debug, PartialEq)]
pub struct PrintedPage {
    /// Width and height, mm.
    pub size: [f64; 2],
    /// Every tag on it, where it stands.
    pub tags: Vec<PrintedTag>,
    /// The names of the plates on it.
    pub plates: Vec<String>,
}

/// A PDF and what is on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Printed {
    /// The file's bytes.
    pub pdf: Vec<u8>,
    /// Its pages.
    pub pages: Vec<PrintedPage>,
    /// What was not printed, and other things worth knowing.
    pub notes: Vec<String>,
}

/// Prints the targets of a layout.
///
/// # Errors
/// A target that is not there, nothing to print, a plate larger than the paper while tiling is not allowed.
pub fn print(layout: &Layout, options: &PrintOptions) -> Result<Printed, PrintError> {
    if let Some(name) = options.targets.iter().find(|name| !layout.targets.iter().any(|t| t.name == **name)) {
        return Err(PrintError::NoSuchTarget(name.clone()));
    }
    let mut notes = Vec::new();
    let mut plates = Vec::new();
    for target in &layout.targets {
        if options.targets.is_empty() || options.targets.contains(&target.name) {
            plates.extend(plate::plates(target, layout, options, &mut notes));
        }
    }
    if plates.is_empty() {
        return Err(PrintError::Nothing);
    }
    let pages = arrange::arrange(plates, options)?;
    let pdf = pdf::write(&pages);
    let printed = |page: arrange::Page| PrintedPage { size: page.size, tags: page.tags, plates: page.plates };
    Ok(Printed { pdf, pages: pages.into_iter().map(printed).collect(), notes })
}
