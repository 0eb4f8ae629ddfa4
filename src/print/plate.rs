//! Plates: the flat pieces that a target is cut from.

use nalgebra::Vector3;

use super::net;
use super::shapes::{Point, Shape, rectangle, words};
use super::{Paper, PrintOptions};
use crate::geometry::dictionary::Dictionary;
use crate::geometry::{Pattern, Pose, TagFace, TargetGeometry};
use crate::layout::{Description, Layout, Target};

/// A tag on paper.
#[derive(Clone, Debug, PartialEq)]
pub struct PrintedTag {
    /// The target's name.
    pub target: String,
    /// Its dictionary.
    pub dictionary: Dictionary,
    /// Its id.
    pub id: u32,
    /// Top-left, top-right, bottom-right, bottom-left of the edge that `size` measures, mm from the top left of the page, y down.
    pub corners: [Point; 4],
}

/// A flat piece.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plate {
    /// What it is called.
    pub(super) title: String,
    /// Lines below it: what it is and what to measure.
    pub(super) caption: Vec<String>,
    /// Width and height with the white margin, mm.
    pub(super) size: [f64; 2],
    /// What is on it, from its top left corner.
    pub(super) shapes: Vec<Shape>,
    /// Its tags.
    pub(super) tags: Vec<PrintedTag>,
    /// Whether crop marks at its corners tell where to cut; a net has an outline of its own.
    pub(super) crop: bool,
    /// The directions of the target's axes on the paper, for the orientation mark.
    pub(super) axes: Vec<(String, Point)>,
}

/// Words beside a pattern are this high, mm.
const LABEL: f64 = 1.9;
/// Two faces are in one plane if their normals differ by less than this (rad) and their offsets by less than [`FLAT`].
const PARALLEL: f64 = 1e-4;
/// m.
const FLAT: f64 = 1e-5;

/// The plates of a target; what cannot be printed is noted.
pub(super) fn plates(target: &Target, layout: &Layout, options: &PrintOptions, notes: &mut Vec<String>) -> Vec<Plate> {
    match (&target.geometry, &target.pattern) {
        (TargetGeometry::Tags(faces), Some(Pattern::Tags { dictionary, .. })) => {
            tag_plates(target, faces, *dictionary, layout, options, notes)
        }
        (TargetGeometry::Board { square, .. }, Some(Pattern::Checkerboard { columns, rows })) => {
            vec![checkerboard(target, [columns + 1, rows + 1], square * 1e3)]
        }
        (_, Some(Pattern::Charuco { squares, square, marker, dictionary, first_id })) => {
            charuco(target, *squares, [square * 1e3, marker * 1e3], *dictionary, *first_id).into_iter().collect()
        }
        _ => {
            notes.push(format!("`{}` is not printed: it has no pattern", target.name));
            Vec::new()
        }
    }
}

fn tag_plates(
    target: &Target,
    faces: &[TagFace],
    dictionary: Dictionary,
    layout: &Layout,
    options: &PrintOptions,
    notes: &mut Vec<String>,
) -> Vec<Plate> {
    let single = |face: &TagFace| {
        flat(target, &[*face], dictionary, &Pose::identity(), format!("{} tag {}", target.name, face.id))
    };
    if options.paper == Paper::Tag {
        return faces
            .iter()
            .map(|face| single(&TagFace { target_from_tag: Some(Pose::identity()), ..*face }))
            .collect();
    }
    if let Some(edge) = cube_edge(&target.description) {
        let net = net::net(target, faces, dictionary, edge * layout.units.length * 1e3);
        if super::arrange::fits(&net, options.paper) {
            return vec![net];
        }
        notes.push(format!(
            "the net of `{}` is larger than {}: its faces are printed one by one, to be glued on a cube",
            target.name,
            options.paper.name()
        ));
    }
    let mut plates = Vec::new();
    for group in planes(faces) {
        let title = if group.len() == faces.len() && faces.len() > 1 {
            target.name.clone()
        } else {
            let ids: Vec<String> = group.iter().map(|face| face.id.to_string()).collect();
            format!("{} tag{} {}", target.name, if ids.len() == 1 { "" } else { "s" }, ids.join(" "))
        };
        let frame = frame_of(&group);
        plates.push(flat(target, &group, dictionary, &frame, title));
    }
    for face in faces.iter().filter(|face| face.target_from_tag.is_none()) {
        plates.push(single(&TagFace { target_from_tag: Some(Pose::identity()), ..*face }));
    }
    plates
}

/// The edge of a cube in the layout's own words and units.
fn cube_edge(description: &Description) -> Option<f64> {
    let get = |of: &Description, key: &str| match of {
        Description::Mapping(entries) => entries.iter().find(|(k, _)| k == key).map(|(_, value)| value.clone()),
        _ => None,
    };
    match get(&get(&get(description, "tags")?, "cube")?, "edge")? {
        Description::Scalar { text, .. } => text.parse().ok(),
        _ => None,
    }
}

/// The faces with a known place, by plane.
fn planes(faces: &[TagFace]) -> Vec<Vec<TagFace>> {
    let mut groups: Vec<(Vector3<f64>, f64, Vec<TagFace>)> = Vec::new();
    for face in faces {
        let Some(pose) = face.target_from_tag else { continue };
        let normal = pose.rotation * Vector3::z();
        let offset = normal.dot(&pose.translation);
        let same = groups.iter_mut().find(|(n, o, _)| n.angle(&normal) < PARALLEL && (o - offset).abs() < FLAT);
        match same {
            Some((_, _, group)) => group.push(*face),
            None => groups.push((normal, offset, vec![*face])),
        }
    }
    groups.into_iter().map(|(_, _, group)| group).collect()
}

/// The frame in whose x-y plane a group is drawn: the target's own if it faces that way, else the first tag's.
fn frame_of(group: &[TagFace]) -> Pose {
    let first = group.first().and_then(|face| face.target_from_tag).unwrap_or_default();
    let normal = first.rotation * Vector3::z();
    if normal.angle(&Vector3::z()) < PARALLEL {
        Pose { translation: first.translation, ..Pose::identity() }
    } else {
        first
    }
}

/// Tags in one plane, seen from `target_from_plane`.
fn flat(target: &Target, faces: &[TagFace], dictionary: Dictionary, target_from_plane: &Pose, title: String) -> Plate {
    let plane_from_target = target_from_plane.inverse();
    // mm, y down, before the margin is known.
    let corners: Vec<[Point; 4]> = faces
        .iter()
        .map(|face| {
            let pose = plane_from_target * face.target_from_tag.unwrap_or_default();
            crate::geometry::target::tag_corners(face.size).map(|corner| {
                let p = pose * corner;
                [p.x * 1e3, -p.y * 1e3]
            })
        })
        .collect();
    let whole = |face: &TagFace| whole_side(dictionary, face.size * 1e3);
    // A white margin of one cell beyond the outermost cell, which for most families is the black border.
    let margin = faces.iter().map(|face| {
        let cell = face.size * 1e3 / dictionary.edge_cells() as f64;
        0.5 * (whole(face) - face.size * 1e3) + cell
    });
    let margin = margin.fold(0.0, f64::max).max(2.0);
    let all = || corners.iter().flatten();
    let least = |axis: usize| all().map(|p| p[axis]).fold(f64::INFINITY, f64::min) - margin;
    let most = |axis: usize| all().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max) + margin;
    let (origin, size) = ([least(0), least(1)], [most(0) - least(0), most(1) - least(1)]);
    let mut shapes = Vec::new();
    let mut tags = Vec::new();
    for (face, corners) in faces.iter().zip(&corners) {
        let corners = corners.map(|[x, y]| [x - origin[0], y - origin[1]]);
        shapes.push(tag(dictionary, face.id, &corners));
        tags.push(PrintedTag { target: target.name.clone(), dictionary, id: face.id, corners });
    }
    id_labels(&tags, size, margin, &mut shapes);
    let mm = faces.first().map_or(0.0, |face| face.size * 1e3);
    let mut caption = vec![
        format!("{title}: {} of {}, id{}", counted(faces.len(), "tag"), dictionary.name(), ids(faces)),
        format!("measure after printing: each black square {mm:.2} mm"),
    ];
    if dictionary.data_around_border() {
        caption[1] = format!("measure after printing: each inner white square's outer edge {mm:.2} mm");
    }
    if let ([first, .., last], true) = (&tags[..], faces.len() > 1) {
        let far = distance(first.corners[0], last.corners[2]);
        caption.push(format!("top left of tag {} to bottom right of tag {}: {far:.2} mm", first.id, last.id));
    }
    let axes = vec![("x".to_owned(), [1.0, 0.0]), ("y".to_owned(), [0.0, -1.0])];
    Plate { title, caption, size, shapes, tags, crop: true, axes }
}

fn distance(a: Point, b: Point) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

pub(super) fn counted(count: usize, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}

/// `s 0 to 11`, or the list.
fn ids(faces: &[TagFace]) -> String {
    let ids: Vec<u32> = faces.iter().map(|face| face.id).collect();
    match ids[..] {
        [one] => format!(" {one}"),
        [first, .., last] if ids.windows(2).all(|pair| pair[1] == pair[0] + 1) => format!("s {first} to {last}"),
        _ => format!("s {}", ids.iter().map(u32::to_string).collect::<Vec<_>>().join(" ")),
    }
}

/// The side of everything printed of a tag, mm.
fn whole_side(dictionary: Dictionary, size: f64) -> f64 {
    size * dictionary.cells_per_side() as f64 / dictionary.edge_cells() as f64
}

/// A tag's black cells between the four corners of its edge, as one area.
pub(super) fn tag(dictionary: Dictionary, id: u32, corners: &[Point; 4]) -> Shape {
    let side = dictionary.cells_per_side();
    let edge = dictionary.edge_cells() as f64;
    let beyond = (side as f64 - edge) / 2.0;
    let [from, right, _, down] = *corners;
    let at = |column: f64, row: f64| -> Point {
        let (u, v) = ((column - beyond) / edge, (row - beyond) / edge);
        [0, 1].map(|i| from[i] + u * (right[i] - from[i]) + v * (down[i] - from[i]))
    };
    let cells = dictionary.cells(id).unwrap_or_default();
    let mut outlines = Vec::new();
    for (row, line) in cells.chunks(side).enumerate() {
        let mut column = 0;
        while column < side {
            let run = line[column..].iter().take_while(|white| !**white).count();
            if run > 0 {
                let (left, right, top) = (column as f64, (column + run) as f64, row as f64);
                outlines.push(vec![at(left, top), at(right, top), at(right, top + 1.0), at(left, top + 1.0)]);
            }
            column += run.max(1);
        }
    }
    Shape::Fill { outlines, grey: 0.0 }
}

/// Small numbers below tags, where there is room between them.
fn id_labels(tags: &[PrintedTag], size: [f64; 2], margin: f64, shapes: &mut Vec<Shape>) {
    for tag in tags {
        let left = tag.corners.iter().map(|p| p[0]).fold(f64::INFINITY, f64::min);
        let bottom = tag.corners.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
        let below = tags.iter().flat_map(|other| other.corners).filter(|p| p[1] > bottom + 1e-6);
        let room = below.map(|p| p[1] - bottom).fold(size[1] - bottom, f64::min);
        if room > 2.0 * LABEL + 1.0 && margin > LABEL + 1.0 {
            shapes.push(words(
                [left, bottom + 0.5 * room.min(2.0 * margin) + 0.35 * LABEL],
                LABEL,
                0.6,
                tag.id.to_string(),
            ));
        }
    }
}

fn board_axes() -> Vec<(String, Point)> {
    vec![("x".to_owned(), [1.0, 0.0]), ("y".to_owned(), [0.0, 1.0])]
}

/// The black squares of a board whose top left one is black.
fn squares(count: [usize; 2], square: f64, margin: f64) -> Shape {
    let mut outlines = Vec::new();
    for row in 0..count[1] {
        for column in (0..count[0]).filter(|column| (column + row) % 2 == 0) {
            let corner = [margin + column as f64 * square, margin + row as f64 * square];
            outlines.push(rectangle(corner, [square, square]));
        }
    }
    Shape::Fill { outlines, grey: 0.0 }
}

fn checkerboard(target: &Target, count: [usize; 2], square: f64) -> Plate {
    let margin = 0.5 * square;
    let across = (count[0] - 2) as f64 * square;
    let caption = vec![
        format!("{}: checkerboard, {} x {} inner corners", target.name, count[0] - 1, count[1] - 1),
        format!("measure after printing: a square {square:.2} mm, first to last inner corner along x {across:.2} mm"),
    ];
    board_plate(target, count, square, margin, caption, squares(count, square, margin), Vec::new())
}

fn board_plate(
    target: &Target,
    count: [usize; 2],
    square: f64,
    margin: f64,
    caption: Vec<String>,
    black: Shape,
    tags: Vec<PrintedTag>,
) -> Plate {
    let mut shapes = vec![black];
    shapes.extend(tags.iter().map(|one| tag(one.dictionary, one.id, &one.corners)));
    let size = count.map(|count| count as f64 * square + 2.0 * margin);
    Plate { title: target.name.clone(), caption, size, shapes, tags, crop: true, axes: board_axes() }
}

/// A ChArUco board as OpenCV from 4.7 on has it: the top left square is black, markers are numbered row by row.
fn charuco(
    target: &Target,
    count: [usize; 2],
    [square, marker]: [f64; 2],
    dictionary: Dictionary,
    first_id: u32,
) -> Option<Plate> {
    let margin = 0.5 * square;
    let inset = 0.5 * (square - marker);
    let mut tags = Vec::new();
    for row in 0..count[1] {
        for column in (0..count[0]).filter(|column| (column + row) % 2 == 1) {
            let (x, y) = (margin + column as f64 * square + inset, margin + row as f64 * square + inset);
            let corners = [[x, y], [x + marker, y], [x + marker, y + marker], [x, y + marker]];
            let id = first_id + tags.len() as u32;
            dictionary.cells(id)?;
            tags.push(PrintedTag { target: target.name.clone(), dictionary, id, corners });
        }
    }
    let across = (count[0] - 2) as f64 * square;
    let caption = vec![
        format!(
            "{}: ChArUco, {} x {} squares, {} of {}",
            target.name,
            count[0],
            count[1],
            counted(tags.len(), "marker"),
            dictionary.name()
        ),
        format!(
            "measure after printing: a square {square:.2} mm, first to last inner corner along x {across:.2} mm, a marker {marker:.2} mm"
        ),
    ];
    Some(board_plate(target, count, square, margin, caption, squares(count, square, margin), tags))
}
