//! The bodies that carry tags and boards.
//!
//! Tags in one plane share a plate with a white margin; tags on the sides of a cube share a box; a board lies on a plate.

use nalgebra::{Matrix3, Vector3};

use super::coverage::{Grid, Planar};
use super::solid::{Shape, face_axes};
use super::texture::Finish;
use crate::geometry::dictionary::Dictionary;
use crate::geometry::{Pattern, Pose, TargetGeometry, rotation};
use crate::layout::{Description, Target};
use crate::simulate::bodies::PlacedCapsule;

/// Reflectance of paper and ink.
const PAPER: f32 = 0.86;
const INK: f32 = 0.085;
/// Reflectance of the bodies.
const BODY: f32 = 0.42;
/// Thickness of a plate, m.
pub const THICKNESS: f64 = 0.008;
/// Radius of the ball that stands for a single point, m.
const POINT: f64 = 0.006;

/// A rectangle of one reflectance: low corner, high corner.
struct Print(Planar, Planar, f32);

/// What is printed in one plane of a target.
struct Sheet {
    /// `target_from_sheet`: x right, y up, z out of the print.
    pose: Pose,
    prints: Vec<Print>,
    /// White around all prints, m.
    margin: f64,
}

/// The shapes of a target in its frame; empty for a target that nobody can see.
#[must_use]
pub fn target_shapes(target: &Target) -> Vec<Shape> {
    let sheets = match (&target.true_geometry, &target.pattern) {
        (TargetGeometry::Tags(_), Some(Pattern::Tags { dictionary, .. })) => tag_sheets(target, *dictionary),
        (TargetGeometry::Board { columns, rows, square, .. }, pattern) => {
            vec![board_sheet(*columns, *rows, *square, pattern.as_ref())]
        }
        (TargetGeometry::Points(points), _) => {
            let ball = |place: Vector3<f64>| Shape::Capsule {
                capsule: PlacedCapsule { ends: [place, place], radius: POINT },
                tone: 0.8,
                lid: 0.8,
            };
            return points.iter().filter_map(|(_, place)| *place).map(ball).collect();
        }
        _ => return Vec::new(),
    };
    if let Some(block) = box_of(&sheets) {
        return vec![block];
    }
    sheets.iter().map(Sheet::plate).collect()
}

/// The sheets of a target's tags.
fn tag_sheets(target: &Target, dictionary: Dictionary) -> Vec<Sheet> {
    let TargetGeometry::Tags(faces) = &target.true_geometry else { return Vec::new() };
    let whole = dictionary.cells_per_side() as f64 / dictionary.edge_cells() as f64;
    let spacing = april_spacing(&target.description);
    let placed: Vec<(Pose, f64)> =
        faces.iter().filter_map(|face| Some((face.target_from_tag?, face.size * whole))).collect();
    let mut sheets: Vec<Sheet> = Vec::new();
    for face in faces {
        let (Some(pose), Some(cells)) = (face.target_from_tag, dictionary.cells(face.id)) else { continue };
        let side = dictionary.cells_per_side();
        let cell = face.size * whole / side as f64;
        let mut prints = Vec::with_capacity(side * side);
        for (index, white) in cells.iter().enumerate() {
            let (column, row) = ((index % side) as f64, (index / side) as f64);
            let left = column * cell - 0.5 * face.size * whole;
            let top = 0.5 * face.size * whole - row * cell;
            prints.push(Print([left, top - cell], [left + cell, top], if *white { PAPER } else { INK }));
        }
        if let Some(spacing) = spacing {
            let (near, far) = (0.5 * face.size, (0.5 + spacing) * face.size);
            for (low, high) in [
                ([near, near], [far, far]),
                ([-far, near], [-near, far]),
                ([near, -far], [far, -near]),
                ([-far, -far], [-near, -near]),
            ] {
                prints.push(Print(low, high, INK));
            }
        }
        let margin = margin_of(&pose, face.size * whole, cell, &placed);
        let home = sheets.iter_mut().find_map(|sheet| {
            let sheet_from_tag = sheet.pose.inverse() * pose;
            in_plane(&sheet_from_tag).then_some((sheet, sheet_from_tag))
        });
        match home {
            Some((sheet, sheet_from_tag)) => {
                sheet.margin = sheet.margin.max(margin);
                sheet.prints.extend(prints.iter().map(|print| print.moved(&sheet_from_tag)));
            }
            None => sheets.push(Sheet { pose, prints, margin }),
        }
    }
    sheets
}

/// Whether a pose is a shift and a whole number of quarter turns within the plane.
fn in_plane(pose: &Pose) -> bool {
    let turn = pose.rotation_matrix();
    let whole = turn.iter().all(|v| (v - v.round()).abs() < 1e-7);
    whole && turn[(2, 2)] > 0.5 && pose.translation.z.abs() < 1e-7
}

/// White around a tag: one cell, or half of what lies between it and a neighbour that is nearly but not quite in its plane.
fn margin_of(own: &Pose, size: f64, cell: f64, all: &[(Pose, f64)]) -> f64 {
    let from_target = own.inverse();
    let gaps = all.iter().filter_map(|(other, other_size)| {
        let apart = from_target * *other;
        let parallel = (apart.rotation * Vector3::z()).z > 0.9;
        let away = apart.translation.x.abs().max(apart.translation.y.abs());
        (parallel && away > 1e-9 && !in_plane(&apart)).then_some(0.48 * (away - 0.5 * (size + other_size)))
    });
    gaps.fold(cell, f64::min).max(0.0)
}

/// Kalibr's AprilGrid has black squares between the corners of its tags: their size as a part of a tag's.
fn april_spacing(description: &Description) -> Option<f64> {
    let find = |description: &Description, key: &str| match description {
        Description::Mapping(entries) => entries.iter().find(|(name, _)| name == key).map(|(_, value)| value.clone()),
        _ => None,
    };
    match find(&find(description, "april_grid")?, "spacing")? {
        Description::Scalar { text, .. } => text.parse().ok(),
        _ => None,
    }
}

/// A checkerboard or ChArUco board; its frame looks into the board, the sheet's out of it.
fn board_sheet(columns: usize, rows: usize, square: f64, pattern: Option<&Pattern>) -> Sheet {
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let pose = Pose::new(rotation::from_matrix(&flip), Vector3::zeros());
    let mut prints = Vec::new();
    let mut next_id = match pattern {
        Some(Pattern::Charuco { first_id, .. }) => *first_id,
        _ => 0,
    };
    for row in 0..=rows {
        for column in 0..=columns {
            let (left, top) = ((column as f64 - 1.0) * square, (1.0 - row as f64) * square);
            let black = (row + column).is_multiple_of(2);
            prints.push(Print([left, top - square], [left + square, top], if black { INK } else { PAPER }));
            let Some(Pattern::Charuco { square: unit, marker, dictionary, .. }) = pattern else { continue };
            if black {
                continue;
            }
            let side = dictionary.cells_per_side();
            let cell = square * marker / unit / side as f64;
            let inset = 0.5 * (square - cell * side as f64);
            for (index, white) in dictionary.cells(next_id).unwrap_or_default().iter().enumerate() {
                let x = left + inset + (index % side) as f64 * cell;
                let y = top - inset - (index / side) as f64 * cell;
                prints.push(Print([x, y - cell], [x + cell, y], if *white { PAPER } else { INK }));
            }
            next_id += 1;
        }
    }
    Sheet { pose, prints, margin: 0.6 * square }
}

impl Print {
    fn moved(&self, pose: &Pose) -> Self {
        let place = |p: Planar| *pose * Vector3::new(p[0], p[1], 0.0);
        let (a, b) = (place(self.0), place(self.1));
        Self([a.x.min(b.x), a.y.min(b.y)], [a.x.max(b.x), a.y.max(b.y)], self.2)
    }
}

impl Sheet {
    /// Low and high corner of all prints.
    fn bounds(&self) -> (Planar, Planar) {
        let start = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        self.prints.iter().fold(start, |(low, high), print| {
            ([0, 1].map(|i| low[i].min(print.0[i])), [0, 1].map(|i| high[i].max(print.1[i])))
        })
    }

    /// The sheet on a plate of its own.
    fn plate(&self) -> Shape {
        let (low, high) = self.bounds();
        let centre = [0, 1].map(|i| 0.5 * (low[i] + high[i]));
        let half = [0, 1].map(|i| 0.5 * (high[i] - low[i]) + self.margin);
        let pose = self.pose * Pose::from_translation(centre[0], centre[1], -0.5 * THICKNESS);
        let shift = Pose::from_translation(-centre[0], -centre[1], 0.0);
        let prints: Vec<Print> = self.prints.iter().map(|print| print.moved(&shift)).collect();
        let mut faces = Box::new([const { None }; 6]);
        faces[4] = Some(grid_of(half, PAPER, &prints));
        let half = Vector3::new(half[0], half[1], 0.5 * THICKNESS);
        Shape::Block { pose, half, faces, tone: 0.6, finish: Finish::Plain }
    }
}

/// The cells between all edges of some prints on a rectangle of one reflectance; later prints cover earlier ones.
fn grid_of(half: Planar, ground: f32, prints: &[Print]) -> Grid {
    let lines = |axis: usize| {
        let inside = |v: &f64| v.abs() < half[axis] - 1e-9;
        let mut lines: Vec<f64> = prints.iter().flat_map(|p| [p.0[axis], p.1[axis]]).filter(inside).collect();
        lines.extend([-half[axis], half[axis]]);
        lines.sort_by(f64::total_cmp);
        lines.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        lines
    };
    let (xs, ys) = (lines(0), lines(1));
    let width = xs.len() - 1;
    let mut values = vec![ground; width * (ys.len() - 1)];
    for Print(low, high, tone) in prints {
        let range = |lines: &[f64], low: f64, high: f64| {
            lines.partition_point(|v| *v < low - 1e-9)..lines.partition_point(|v| *v < high - 1e-9)
        };
        for row in range(&ys, low[1], high[1]) {
            values[row * width..][range(&xs, low[0], high[0])].fill(*tone);
        }
    }
    Grid { xs, ys, values }
}

/// The box whose sides the sheets are, if they stand square to each other and face outwards.
fn box_of(sheets: &[Sheet]) -> Option<Shape> {
    if sheets.len() < 2 {
        return None;
    }
    let normal = |sheet: &Sheet| sheet.pose.rotation * Vector3::z();
    let middle = |sheet: &Sheet| {
        let (low, high) = sheet.bounds();
        sheet.pose * Vector3::new(0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.0)
    };
    for (i, a) in sheets.iter().enumerate() {
        for (j, b) in sheets.iter().enumerate().filter(|(j, _)| *j != i) {
            let lean = normal(a).dot(&normal(b));
            let square = lean.abs() < 1e-7 || lean < -1.0 + 1e-9;
            let behind = normal(a).dot(&(middle(b) - a.pose.translation)) < -1e-4;
            // Printed square to the box's edges too.
            let upright = (a.pose.inverse() * b.pose).rotation_matrix().iter().all(|v| (v - v.round()).abs() < 1e-7);
            if i == j || !square || !behind || !upright {
                return None;
            }
        }
    }
    let turn = sheets[0].pose.rotation;
    let into = |point: Vector3<f64>| turn.inverse() * point;
    let (mut low, mut high) = ([None; 3], [None; 3]);
    let mut reach = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
    let mut across: [Vec<f64>; 3] = Default::default();
    for sheet in sheets {
        let (n, place) = (into(normal(sheet)), into(sheet.pose.translation));
        let axis = n.iamax();
        if n[axis] > 0.0 {
            high[axis] = Some(place[axis])
        } else {
            low[axis] = Some(place[axis])
        }
        let (from, to) = sheet.bounds();
        for (x, y) in [(from[0] - sheet.margin, from[1] - sheet.margin), (to[0] + sheet.margin, to[1] + sheet.margin)] {
            let corner = into(sheet.pose * Vector3::new(x, y, 0.0));
            for i in 0..3 {
                reach[i] = [reach[i][0].min(corner[i]), reach[i][1].max(corner[i])];
            }
        }
        for i in (0..3).filter(|i| *i != axis) {
            across[i].push(into(middle(sheet))[i]);
        }
    }
    let (mut from, mut to) = (Vector3::zeros(), Vector3::zeros());
    for i in 0..3 {
        // A side without a tag is as far from the middle of the others' tags as the one opposite.
        let centre = across[i].iter().sum::<f64>() / across[i].len().max(1) as f64;
        let (l, h) = (low[i], high[i]);
        from[i] = l.unwrap_or_else(|| h.map_or(reach[i][0], |h| (2.0 * centre - h).min(reach[i][0])));
        to[i] = h.unwrap_or_else(|| l.map_or(reach[i][1], |l| (2.0 * centre - l).max(reach[i][1])));
    }
    let half = 0.5 * (to - from);
    let pose = Pose::new(turn, turn * (0.5 * (from + to)));
    let mut faces = Box::new([const { None }; 6]);
    for sheet in sheets {
        let box_from_sheet = pose.inverse() * sheet.pose;
        let n = box_from_sheet.rotation * Vector3::z();
        let face = (0..6).find(|face| face_axes(*face)[2].dot(&n) > 0.9)?;
        let [x, y, _] = face_axes(face);
        let size = [x.component_mul(&half).abs().sum(), y.component_mul(&half).abs().sum()];
        let flat = |p: Planar| {
            let place = box_from_sheet * Vector3::new(p[0], p[1], 0.0);
            [place.dot(&x), place.dot(&y)]
        };
        let laid = |low: Planar, high: Planar, tone: f32| {
            let (a, b) = (flat(low), flat(high));
            Print([a[0].min(b[0]), a[1].min(b[1])], [a[0].max(b[0]), a[1].max(b[1])], tone)
        };
        let (low, high) = sheet.bounds();
        let paper = laid(low.map(|v| v - sheet.margin), high.map(|v| v + sheet.margin), PAPER);
        let small = (0..2).any(|i| size[i] > 0.5 * (paper.1[i] - paper.0[i]) + 3.0 * sheet.margin);
        let mut prints = vec![paper];
        prints.extend(sheet.prints.iter().map(|print| laid(print.0, print.1, print.2)));
        faces[face] = Some(grid_of(size, if small { BODY } else { PAPER }, &prints));
    }
    Some(Shape::Block { pose, half, faces, tone: BODY, finish: Finish::Plain })
}
