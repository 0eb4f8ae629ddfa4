//! The shapes of targets: where each corner that a detector can report lies on the body.
//!
//! A tag's frame has its origin at the tag's centre, x right and y up as printed, z out of the face; its size is the outer edge
//! of the black border; its corners are top-left, top-right, bottom-right, bottom-left. A board's frame has its
//! origin at the first inner corner, x along columns, y along rows, z **into** the board, as in OpenCV.

use nalgebra::{Matrix3, Vector3};

use super::pose::Pose;
use super::rotation;

/// One square tag on a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TagFace {
    /// The tag's number in its dictionary.
    pub id: u32,
    /// Outer edge of the black border, metres.
    pub size: f64,
    /// The tag's place on the body; `None` where the layout leaves it unknown.
    pub target_from_tag: Option<Pose>,
}

/// What a detector can report of a target, and where that lies on the body (metres, target's frame).
#[derive(Clone, Debug, PartialEq)]
pub enum TargetGeometry {
    /// Known only through whole poses measured by others.
    None,
    /// Square tags, each with a place or with an unknown one.
    Tags(Vec<TagFace>),
    /// The inner corners of a checkerboard or ChArUco board: `columns * rows` of them, `square` metres apart.
    Board {
        /// Inner corners along x.
        columns: usize,
        /// Inner corners along y.
        rows: usize,
        /// Distance between neighbours, metres.
        square: f64,
        /// Whether the numbering is fixed by the pattern itself (ChArUco) rather than by its colours.
        numbered: bool,
    },
    /// Named single points; `None` where the coordinates are unknown.
    Points(Vec<(String, Option<Vector3<f64>>)>),
}

/// The name of one reportable feature: what stands in the columns `tag` and `corner` of a detection.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Feature {
    /// Corner 0-3 of a tag.
    TagCorner(u32, u8),
    /// An inner corner of a board, `row * columns + column`.
    BoardCorner(u32),
    /// A named point.
    Point(String),
}

/// The corners of a tag of the given size in its own frame, in the order of detection.
#[must_use]
pub fn tag_corners(size: f64) -> [Vector3<f64>; 4] {
    let h = 0.5 * size;
    [Vector3::new(-h, h, 0.0), Vector3::new(h, h, 0.0), Vector3::new(h, -h, 0.0), Vector3::new(-h, -h, 0.0)]
}

impl TargetGeometry {
    /// One tag whose frame is the target's.
    #[must_use]
    pub fn single_tag(id: u32, size: f64) -> Self {
        Self::Tags(vec![TagFace { id, size, target_from_tag: Some(Pose::identity()) }])
    }

    /// A flat grid of tags, `gap` metres between their borders, numbered row by row from the top left.
    /// Its frame is like a tag's: origin at the centre of the grid, x right, y up, z out.
    #[must_use]
    pub fn grid(columns: usize, rows: usize, size: f64, gap: f64, first_id: u32) -> Self {
        let pitch = size + gap;
        let mut faces = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            for column in 0..columns {
                let x = (column as f64 - 0.5 * (columns as f64 - 1.0)) * pitch;
                let y = (0.5 * (rows as f64 - 1.0) - row as f64) * pitch;
                faces.push(TagFace {
                    id: first_id + (row * columns + column) as u32,
                    size,
                    target_from_tag: Some(Pose::from_translation(x, y, 0.0)),
                });
            }
        }
        Self::Tags(faces)
    }

    /// Kalibr's AprilGrid: tags numbered from the bottom left, rightwards then upwards; `spacing` is the gap as a fraction of `size`.
    /// Frame as Kalibr's: origin at the bottom-left corner of the first tag, x right, y up, z out.
    #[must_use]
    pub fn april_grid(columns: usize, rows: usize, size: f64, spacing: f64, first_id: u32) -> Self {
        let pitch = size * (1.0 + spacing);
        let mut faces = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            for column in 0..columns {
                let centre = |index: usize| index as f64 * pitch + 0.5 * size;
                faces.push(TagFace {
                    id: first_id + (row * columns + column) as u32,
                    size,
                    target_from_tag: Some(Pose::from_translation(centre(column), centre(row), 0.0)),
                });
            }
        }
        Self::Tags(faces)
    }

    /// A cube with a tag on each of up to six faces, in the order +x, +y, -x, -y, +z, -z. The frame's origin is the centre of the
    /// cube of edge `edge`. The tags on the four sides have their top towards +z, the one on +z towards +y, the one on -z towards +y.
    #[must_use]
    pub fn cube(edge: f64, size: f64, ids: &[u32]) -> Self {
        // (outward normal, up as printed); x as printed = up x normal.
        let sides: [([f64; 3], [f64; 3]); 6] = [
            ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
            ([-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ([0.0, -1.0, 0.0], [0.0, 0.0, 1.0]),
            ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
            ([0.0, 0.0, -1.0], [0.0, 1.0, 0.0]),
        ];
        let faces = ids.iter().zip(sides).map(|(&id, (normal, up))| {
            let (z, y) = (Vector3::from(normal), Vector3::from(up));
            let matrix = Matrix3::from_columns(&[y.cross(&z), y, z]);
            TagFace { id, size, target_from_tag: Some(Pose::new(rotation::from_matrix(&matrix), z * (0.5 * edge))) }
        });
        Self::Tags(faces.collect())
    }

    /// Where a feature lies, or `None` if the target has no such feature or its place is unknown.
    #[must_use]
    pub fn place(&self, feature: &Feature) -> Option<Vector3<f64>> {
        match (self, feature) {
            (Self::Tags(faces), Feature::TagCorner(id, corner)) => {
                let face = faces.iter().find(|face| face.id == *id)?;
                let corner = tag_corners(face.size).get(usize::from(*corner)).copied()?;
                Some(face.target_from_tag? * corner)
            }
            (Self::Board { columns, rows, square, .. }, Feature::BoardCorner(index)) => {
                let index = *index as usize;
                (index < columns * rows)
                    .then(|| Vector3::new((index % columns) as f64 * square, (index / columns) as f64 * square, 0.0))
            }
            (Self::Points(points), Feature::Point(name)) => points.iter().find(|(n, _)| n == name)?.1,
            _ => None,
        }
    }

    /// Whether the target can report such a feature at all, its place known or not.
    #[must_use]
    pub fn has(&self, feature: &Feature) -> bool {
        match (self, feature) {
            (Self::Tags(faces), Feature::TagCorner(id, corner)) => {
                *corner < 4 && faces.iter().any(|face| face.id == *id)
            }
            (Self::Points(points), Feature::Point(name)) => points.iter().any(|(n, _)| n == name),
            _ => self.place(feature).is_some(),
        }
    }

    /// The rotations of the numbering that leave the pattern looking the same: each entry maps corner `i` of the identity numbering
    /// to another corner. A checkerboard with one even and one odd corner count has one; with both even or both odd it has two; a square
    /// even one has four, because a quarter turn keeps its colours too.
    #[must_use]
    pub fn symmetries(&self) -> Vec<Vec<u32>> {
        let Self::Board { columns, rows, numbered, .. } = *self else { return vec![] };
        let count = columns * rows;
        let mut turns: Vec<Vec<u32>> = vec![(0..count as u32).collect()];
        if numbered || (columns + rows) % 2 == 1 {
            return turns;
        }
        turns.push((0..count as u32).rev().collect());
        if columns == rows && columns.is_multiple_of(2) {
            let n = columns;
            let quarter: Vec<u32> = (0..count).map(|i| ((i % n) * n + (n - 1 - i / n)) as u32).collect();
            turns.push(quarter.clone());
            turns.push(quarter.into_iter().rev().collect());
        }
        turns
    }
}
