//! What is drawn: filled areas, lines and words, in millimetres with y down.

/// A point, mm.
pub(super) type Point = [f64; 2];

/// One thing on a page.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    /// Areas filled in one go, so that no seam shows where two touch; `grey` is 0 for black.
    Fill { outlines: Vec<Vec<Point>>, grey: f64 },
    /// A line.
    Line { points: Vec<Point>, width: f64, grey: f64, dash: Option<f64> },
    /// Words whose base line starts at a point.
    Text { at: Point, size: f64, grey: f64, words: String },
    /// Shapes of which only what lies in a rectangle (corner, size) shows.
    Clipped { corner: Point, size: [f64; 2], shapes: Vec<Shape> },
}

/// A rectangle's outline.
pub(super) fn rectangle([x, y]: Point, [width, height]: [f64; 2]) -> Vec<Point> {
    vec![[x, y], [x + width, y], [x + width, y + height], [x, y + height]]
}

/// A thin line.
pub(super) fn line(from: Point, to: Point, width: f64, grey: f64) -> Shape {
    Shape::Line { points: vec![from, to], width, grey, dash: None }
}

/// Words.
pub(super) fn words(at: Point, size: f64, grey: f64, words: impl Into<String>) -> Shape {
    Shape::Text { at, size, grey, words: words.into() }
}

/// About how wide words in Helvetica are (mm): its letters are half as wide as high on average, digits a little more.
pub(super) fn width_of(text: &str, size: f64) -> f64 {
    0.55 * size * text.chars().count() as f64
}

/// Breaks words into lines no wider than `width`.
pub(super) fn wrap(text: &str, size: f64, width: f64) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let last = lines.len() - 1;
        let longer = if lines[last].is_empty() { word.to_owned() } else { format!("{} {word}", lines[last]) };
        if width_of(&longer, size) <= width || lines[last].is_empty() {
            lines[last] = longer;
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}

impl Shape {
    /// The same elsewhere.
    pub(super) fn moved(self, by: Point) -> Self {
        let shift = |[x, y]: Point| [x + by[0], y + by[1]];
        match self {
            Self::Fill { outlines, grey } => Self::Fill {
                outlines: outlines.into_iter().map(|o| o.into_iter().map(shift).collect()).collect(),
                grey,
            },
            Self::Line { points, width, grey, dash } => {
                Self::Line { points: points.into_iter().map(shift).collect(), width, grey, dash }
            }
            Self::Text { at, size, grey, words } => Self::Text { at: shift(at), size, grey, words },
            Self::Clipped { corner, size, shapes } => {
                let shapes = shapes.into_iter().map(|shape| shape.moved(by)).collect();
                Self::Clipped { corner: shift(corner), size, shapes }
            }
        }
    }
}
