//! Reading targets: the entries of a layout.

use nalgebra::Vector3;

use super::fields::{Fields, Gathered, shown};
use super::model::{Description, PoseSpec, Target, Units};
use super::read::{Context, read_mount};
use super::tags::{read_april_grid, read_dictionary, read_tags};
use super::yaml::{Node, Value};
use crate::geometry::{Pattern, TargetGeometry};

/// The kinds of geometry, of which a target has at most one.
const KINDS: [&str; 5] = ["tags", "checkerboard", "charuco", "april_grid", "points"];

/// Inner corners of a board at most.
const MOST_CORNERS: usize = 1_000_000;

pub(super) fn read_target(context: &Context<'_>, name: &str, node: &Node) -> Option<Target> {
    let to = context.to;
    let fields = Fields::open(to, node, format!("target `{name}`"))?;
    let given: Vec<(&'static str, &Node)> =
        KINDS.iter().filter_map(|kind| fields.get(kind).map(|node| (*kind, node))).collect();
    let unknown = fields.get("geometry").map(|node| match node.text() {
        Some("unknown") => Some(()),
        _ => to.complain(
            node.line,
            format!("`geometry` of target `{name}` is {}", shown(node)),
            "the only value is `unknown`: every tag's place is then found",
        ),
    });
    let mount = read_mount(&fields);
    let moves = fields.get("moves").map_or(Some(false), |node| fields.flag(node, "`moves`"));
    let pose = context.read_pose_of(&fields);
    let line = fields.line;
    let shape = match given[..] {
        [] => Some((TargetGeometry::None.into(), None)),
        [("tags", node)] => read_tags(context, name, node, unknown.is_some()),
        [("checkerboard", node)] => read_checkerboard(to, name, node, context.units),
        [("charuco", node)] => read_charuco(to, name, node, context.units),
        [("april_grid", node)] => read_april_grid(to, name, node, context.units),
        [(_, node)] => read_points(to, name, node, context.units),
        [(first, _), (second, node), ..] => to.complain(
            node.line,
            format!("target `{name}` has both `{first}` and `{second}`"),
            "a target carries one kind; describe the other as a second target mounted on it",
        ),
    };
    let described = |key: &str| fields.names().iter().find(|(k, _, _)| k == key).map(|(_, _, node)| describe(node));
    let description = Description::Mapping(
        KINDS.iter().chain(["geometry"].iter()).filter_map(|key| Some(((*key).to_owned(), described(key)?))).collect(),
    );
    fields.finish();
    let (moves, pose) = (moves?, pose?);
    if moves && !matches!(pose, PoseSpec::Unknown) {
        return to.complain(
            line,
            format!("target `{name}` moves but has a pose"),
            "a target that moves has a new unknown pose at each configuration: leave `pose` out",
        );
    }
    let (Shape { known: geometry, truth: true_geometry }, pattern) = shape?;
    let name = name.to_owned();
    Some(Target { name, line, geometry, true_geometry, pattern, mount: mount?, pose, moves, description })
}

/// A geometry as a solver is to know it and as a simulation is.
pub(super) struct Shape {
    pub(super) known: TargetGeometry,
    pub(super) truth: TargetGeometry,
}

impl From<TargetGeometry> for Shape {
    fn from(known: TargetGeometry) -> Self {
        Self { truth: known.clone(), known }
    }
}

/// A place that may be hidden: as a solver is to know it and as a simulation is.
pub(super) struct Place<T> {
    pub(super) known: Option<T>,
    pub(super) truth: Option<T>,
}

/// A node as plain data.
pub(super) fn describe(node: &Node) -> Description {
    match &node.value {
        Value::Scalar { text, quoted } => Description::Scalar { text: text.clone(), quoted: *quoted },
        Value::Sequence(items) => Description::List(items.iter().map(|item| describe(item)).collect()),
        Value::Mapping(entries) => {
            Description::Mapping(entries.iter().map(|(key, _, node)| (key.clone(), describe(node))).collect())
        }
    }
}

fn read_checkerboard(to: &Gathered<'_>, name: &str, node: &Node, units: Units) -> Option<(Shape, Option<Pattern>)> {
    let fields = Fields::open(to, node, format!("`checkerboard` of target `{name}`"))?;
    let corners = fields.require("corners", "[8, 5]").and_then(|node| fields.counts::<2>(node, "`corners`"));
    let square = fields.require("square", "30").and_then(|node| fields.positive(node, "`square`"));
    let line = fields.line;
    fields.finish();
    let ([columns, rows], square) = (corners?.map(|count| count as usize), square?);
    if columns.min(rows) < 2 {
        return to.complain(
            line,
            format!("the checkerboard `{name}` has fewer than 2 x 2 inner corners"),
            "count the corners between squares, not the squares",
        );
    }
    not_too_many(to, line, name, [columns, rows])?;
    let geometry = TargetGeometry::Board { columns, rows, square: square * units.length, numbered: false };
    Some((geometry.into(), Some(Pattern::Checkerboard { columns, rows })))
}

/// A board is held corner by corner, so a slip of the keyboard must not fill the memory.
fn not_too_many(to: &Gathered<'_>, line: usize, name: &str, [columns, rows]: [usize; 2]) -> Option<()> {
    if columns * rows <= MOST_CORNERS {
        return Some(());
    }
    to.complain(
        line,
        format!("the board `{name}` has {columns} x {rows} inner corners"),
        format!("no board has more than {MOST_CORNERS}: check the counts"),
    )
}

fn read_charuco(to: &Gathered<'_>, name: &str, node: &Node, units: Units) -> Option<(Shape, Option<Pattern>)> {
    let fields = Fields::open(to, node, format!("`charuco` of target `{name}`"))?;
    let squares = fields.require("squares", "[5, 7]").and_then(|node| fields.counts::<2>(node, "`squares`"));
    let square = fields.require("square", "30").and_then(|node| fields.positive(node, "`square`"));
    let marker = fields.require("marker", "22").and_then(|node| fields.positive(node, "`marker`"));
    let dictionary = read_dictionary(&fields);
    let line = fields.line;
    fields.finish();
    let (squares, square, marker, dictionary) = (squares?, square?, marker?, dictionary?);
    if squares[0].min(squares[1]) < 2 {
        return to.complain(
            line,
            format!("the ChArUco board `{name}` has fewer than 2 x 2 squares"),
            "count squares, not corners",
        );
    }
    if marker >= square {
        return to.complain(
            line,
            format!("the markers of `{name}` are not smaller than its squares"),
            "`marker` must be less than `square`",
        );
    }
    let squares = squares.map(|count| count as usize);
    let square = square * units.length;
    let [columns, rows] = squares.map(|count| count - 1);
    not_too_many(to, line, name, [columns, rows])?;
    let geometry = TargetGeometry::Board { columns, rows, square, numbered: true };
    let marker = marker * units.length;
    Some((geometry.into(), Some(Pattern::Charuco { squares, square, marker, dictionary, first_id: 0 })))
}

fn read_points(to: &Gathered<'_>, name: &str, node: &Node, units: Units) -> Option<(Shape, Option<Pattern>)> {
    let fields = Fields::open(to, node, format!("`points` of target `{name}`"))?;
    let points: Option<Vec<(String, Place<Vector3<f64>>)>> = fields
        .names()
        .iter()
        .map(|(point, _, node)| Some((point.clone(), read_point(&fields, point, node, units)?)))
        .collect();
    let points = points?;
    if points.is_empty() {
        return to.complain(
            node.line,
            format!("target `{name}` has no points"),
            "write `{tip: [0, 0, 10]}` or `{tip: unknown}`",
        );
    }
    let known = points.iter().map(|(name, place)| (name.clone(), place.known)).collect();
    let truth = points.iter().map(|(name, place)| (name.clone(), place.truth)).collect();
    Some((Shape { known: TargetGeometry::Points(known), truth: TargetGeometry::Points(truth) }, None))
}

/// `[x, y, z]`, `unknown`, or `{xyz: [x, y, z], unknown: true}`.
fn read_point(fields: &Fields<'_>, point: &str, node: &Node, units: Units) -> Option<Place<Vector3<f64>>> {
    if node.text() == Some("unknown") {
        return Some(Place { known: None, truth: None });
    }
    let what = format!("point `{point}`");
    if let Value::Mapping(_) = &node.value {
        let inner = Fields::open(fields.to, node, format!("{what} of {}", fields.what))?;
        let xyz = inner.require("xyz", "[0, 0, 0]").and_then(|node| inner.numbers::<3>(node, "`xyz`"));
        let unknown = inner.get("unknown").map_or(Some(false), |node| inner.flag(node, "unknown"));
        inner.finish();
        let place = Vector3::from(xyz?) * units.length;
        return Some(Place { known: (!unknown?).then_some(place), truth: Some(place) });
    }
    let place = Vector3::from(fields.numbers::<3>(node, &what)?) * units.length;
    Some(Place { known: Some(place), truth: Some(place) })
}
