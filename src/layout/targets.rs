//! Reading targets: entries of a layout and target files.

use nalgebra::Vector3;

use super::fields::{Fields, Gathered, shown};
use super::model::{Description, PoseSpec, Target, Units};
use super::poses::{read_pose, read_units};
use super::read::{Context, read_mount, read_text_file};
use super::yaml::{self, Node, Value};
use crate::complaint::Complaint;
use crate::geometry::dictionary::Dictionary;
use crate::geometry::{Pattern, Pose, TagFace, TargetGeometry};

/// The kinds of geometry, of which a target has at most one.
const KINDS: [&str; 5] = ["tags", "checkerboard", "charuco", "april_grid", "points"];

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
        [] => Some((TargetGeometry::None, None)),
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
    let (geometry, pattern) = shape?;
    Some(Target { name: name.to_owned(), line, geometry, pattern, mount: mount?, pose, moves, description })
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

fn read_dictionary(fields: &Fields<'_>) -> Option<Dictionary> {
    let node = fields.require("dictionary", "6x6_250")?;
    let text = fields.text(node, "`dictionary`")?;
    Dictionary::parse(text).or_else(|| {
        let names: Vec<&str> = Dictionary::all().map(Dictionary::name).collect();
        let remedy = match crate::complaint::nearest(text, names.iter().copied()) {
            Some(meant) => format!("did you mean `{meant}`?"),
            None => format!("known are {}", crate::complaint::list(names)),
        };
        fields.to.complain(node.line, format!("the dictionary `{text}` of {} is unknown", fields.what), remedy)
    })
}

fn read_ids(fields: &Fields<'_>, node: &Node, dictionary: Option<Dictionary>) -> Option<Vec<u32>> {
    let Value::Sequence(items) = &node.value else {
        return fields.to.complain(
            node.line,
            format!("`ids` of {} is {}", fields.what, node.kind()),
            "write a list such as `[40, 41]`",
        );
    };
    if items.is_empty() {
        return fields.to.complain(node.line, format!("`ids` of {} is empty", fields.what), "name at least one tag");
    }
    let most = dictionary.map_or(u32::MAX, |dictionary| dictionary.tag_count() - 1);
    items.iter().map(|item| fields.whole(item, "a tag id", 0, most)).collect()
}

fn read_tags(
    context: &Context<'_>,
    name: &str,
    node: &Node,
    unknown: bool,
) -> Option<(TargetGeometry, Option<Pattern>)> {
    let (to, units) = (context.to, context.units);
    let fields = Fields::open(to, node, format!("`tags` of target `{name}`"))?;
    let dictionary = read_dictionary(&fields);
    let size = fields.get("size").map(|node| (node.line, fields.positive(node, "`size`")));
    let ids = fields.get("ids").map(|node| read_ids(&fields, node, dictionary));
    let (file, grid, cube, places) = (fields.get("file"), fields.get("grid"), fields.get("cube"), fields.get("places"));
    let geometry = match (file.or(places), grid, cube, ids) {
        (Some(node), None, None, None) if places.is_some() => read_places(to, node, units).map(TargetGeometry::Tags),
        (Some(node), None, None, None) => {
            let path = context.resolve(fields.text(node, "`file`")?);
            let text = read_text_file(to, node.line, &path)?;
            match parse_target(&path, &text, dictionary) {
                Ok(faces) => Some(TargetGeometry::Tags(faces)),
                Err(complaints) => to.adopt(complaints),
            }
        }
        (None, Some(node), None, None) => read_grid(to, name, node, units),
        (None, None, Some(node), None) => read_cube(to, name, node, units, dictionary),
        (None, None, None, Some(ids)) => match size {
            Some((_, size)) => Some(single_tags(ids?, size? * units.length)),
            None => to.complain(
                fields.line,
                format!("the tags of target `{name}` have no `size`"),
                "add the outer edge of the black border, for example `size: 50`",
            ),
        },
        _ => to.complain(
            fields.line,
            format!("the tags of target `{name}` have no clear place"),
            "give exactly one of `file`, `places`, `grid`, `cube`, or `size` with `ids`",
        ),
    };
    fields.finish();
    let (dictionary, mut geometry) = (dictionary?, geometry?);
    let TargetGeometry::Tags(faces) = &mut geometry else { return None };
    if unknown {
        // One tag keeps its place: it ties the target's frame down.
        faces.iter_mut().skip(1).for_each(|face| face.target_from_tag = None);
    }
    let ids: Vec<u32> = faces.iter().map(|face| face.id).collect();
    if let Some(id) = ids.iter().find(|id| **id >= dictionary.tag_count()) {
        return to.complain(
            node.line,
            format!("target `{name}` has tag {id}, which `{}` does not have", dictionary.name()),
            format!("its ids go from 0 to {}", dictionary.tag_count() - 1),
        );
    }
    let mut seen = ids.clone();
    seen.sort_unstable();
    if let Some(pair) = seen.windows(2).find(|pair| pair[0] == pair[1]) {
        return to.complain(
            node.line,
            format!("target `{name}` has tag {} twice", pair[0]),
            "give every tag its own id",
        );
    }
    Some((geometry, Some(Pattern::Tags { dictionary, ids })))
}

/// A single tag is the target; of several without a file the first is, and the places of the others are unknown.
fn single_tags(ids: Vec<u32>, size: f64) -> TargetGeometry {
    let place = |index: usize| (index == 0).then(Pose::identity);
    let faces = ids.into_iter().enumerate().map(|(i, id)| TagFace { id, size, target_from_tag: place(i) });
    TargetGeometry::Tags(faces.collect())
}

fn read_grid(to: &Gathered<'_>, name: &str, node: &Node, units: Units) -> Option<TargetGeometry> {
    let fields = Fields::open(to, node, format!("`grid` of target `{name}`"))?;
    let count = |key: &'static str| fields.require(key, "3").and_then(|node| fields.whole(node, key, 1, 1000));
    let (columns, rows) = (count("columns"), count("rows"));
    let size = fields.require("size", "70").and_then(|node| fields.positive(node, "`size`"));
    let gap = fields.require("gap", "10").and_then(|node| fields.positive(node, "`gap`"));
    let first = fields.get("first_id").map_or(Some(0), |node| fields.whole(node, "`first_id`", 0, 1_000_000));
    fields.finish();
    Some(TargetGeometry::grid(columns? as usize, rows? as usize, size? * units.length, gap? * units.length, first?))
}

fn read_cube(
    to: &Gathered<'_>,
    name: &str,
    node: &Node,
    units: Units,
    dictionary: Option<Dictionary>,
) -> Option<TargetGeometry> {
    let fields = Fields::open(to, node, format!("`cube` of target `{name}`"))?;
    let edge = fields.require("edge", "80").and_then(|node| fields.positive(node, "`edge`"));
    let size = fields.require("size", "60").and_then(|node| fields.positive(node, "`size`"));
    let ids = fields.require("ids", "[0, 1, 2, 3, 4]").and_then(|node| read_ids(&fields, node, dictionary));
    let line = fields.line;
    fields.finish();
    let (edge, size, ids) = (edge?, size?, ids?);
    if ids.len() > 6 {
        return to.complain(
            line,
            format!("the cube of target `{name}` has {} tags", ids.len()),
            "a cube has six faces",
        );
    }
    if size > edge {
        return to.complain(
            line,
            format!("the tags of cube `{name}` are larger than its faces"),
            "`size` must not exceed `edge`",
        );
    }
    Some(TargetGeometry::cube(edge * units.length, size * units.length, &ids))
}

fn read_checkerboard(
    to: &Gathered<'_>,
    name: &str,
    node: &Node,
    units: Units,
) -> Option<(TargetGeometry, Option<Pattern>)> {
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
    let geometry = TargetGeometry::Board { columns, rows, square: square * units.length, numbered: false };
    Some((geometry, Some(Pattern::Checkerboard { columns, rows })))
}

fn read_charuco(to: &Gathered<'_>, name: &str, node: &Node, units: Units) -> Option<(TargetGeometry, Option<Pattern>)> {
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
    let geometry = TargetGeometry::Board { columns: squares[0] - 1, rows: squares[1] - 1, square, numbered: true };
    let marker = marker * units.length;
    Some((geometry, Some(Pattern::Charuco { squares, square, marker, dictionary, first_id: 0 })))
}

fn read_april_grid(
    to: &Gathered<'_>,
    name: &str,
    node: &Node,
    units: Units,
) -> Option<(TargetGeometry, Option<Pattern>)> {
    let fields = Fields::open(to, node, format!("`april_grid` of target `{name}`"))?;
    let count = |key: &'static str| fields.require(key, "6").and_then(|node| fields.whole(node, key, 1, 100));
    let (columns, rows) = (count("columns"), count("rows"));
    let size = fields.require("size", "88").and_then(|node| fields.positive(node, "`size`"));
    let spacing = fields.require("spacing", "0.3").and_then(|node| fields.positive(node, "`spacing`"));
    let first = fields.get("first_id").map_or(Some(0), |node| fields.whole(node, "`first_id`", 0, 1_000_000));
    let dictionary = match fields.get("dictionary") {
        None => Dictionary::parse("apriltag_36h11"),
        Some(_) => read_dictionary(&fields),
    };
    let line = fields.line;
    fields.finish();
    let (columns, rows, first, dictionary) = (columns? as usize, rows? as usize, first?, dictionary?);
    let last = first + (columns * rows) as u32 - 1;
    if last >= dictionary.tag_count() {
        return to.complain(
            line,
            format!("the AprilGrid `{name}` needs tag {last}, which `{}` does not have", dictionary.name()),
            "use a smaller grid or another `first_id`",
        );
    }
    let geometry = TargetGeometry::april_grid(columns, rows, size? * units.length, spacing?, first);
    Some((geometry, Some(Pattern::Tags { dictionary, ids: (first..=last).collect() })))
}

fn read_points(to: &Gathered<'_>, name: &str, node: &Node, units: Units) -> Option<(TargetGeometry, Option<Pattern>)> {
    let fields = Fields::open(to, node, format!("`points` of target `{name}`"))?;
    let points: Option<Vec<_>> = fields
        .names()
        .iter()
        .map(|(point, _, node)| {
            let place = if node.text() == Some("unknown") {
                None
            } else {
                let xyz = fields.numbers::<3>(node, &format!("point `{point}`"))?;
                Some(Vector3::from(xyz) * units.length)
            };
            Some((point.clone(), place))
        })
        .collect();
    let points = points?;
    if points.is_empty() {
        return to.complain(
            node.line,
            format!("target `{name}` has no points"),
            "write `{tip: [0, 0, 10]}` or `{tip: unknown}`",
        );
    }
    Some((TargetGeometry::Points(points), None))
}

/// Parses a target file: where each tag sits on a body.
///
/// # Errors
/// Everything that is wrong with the file.
pub fn parse_target(
    file: &std::path::Path,
    text: &str,
    expected: Option<Dictionary>,
) -> Result<Vec<TagFace>, Vec<Complaint>> {
    let root = yaml::parse(text).map_err(|e| vec![Complaint::at(file, e.line, e.what, e.remedy)])?;
    let to = Gathered::new(file);
    let faces = parse_target_node(&to, &root, expected);
    let complaints = to.complaints.into_inner();
    match faces {
        Some(faces) if complaints.is_empty() => Ok(faces),
        _ => Err(complaints),
    }
}

fn parse_target_node(to: &Gathered<'_>, root: &Node, expected: Option<Dictionary>) -> Option<Vec<TagFace>> {
    let fields = Fields::open(to, root, "the target file")?;
    let version = fields.require("cellmap_target", "1").and_then(|node| fields.whole(node, "`cellmap_target`", 1, 1));
    let units = read_units(&fields);
    let dictionary = read_dictionary(&fields);
    let tags = fields.require("tags", "[{id: 0, size: 70, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}]");
    let line = fields.line;
    fields.finish();
    let (_, units, tags) = (version?, units?, tags?);
    if let (Some(expected), Some(found)) = (expected, dictionary)
        && expected.family() != found.family()
    {
        return to.complain(
            line,
            format!("the tags here are of `{}` but the layout says `{}`", found.name(), expected.name()),
            "make the two agree",
        );
    }
    read_places(to, tags, units)
}

/// A list of `{id, size, pose}`.
fn read_places(to: &Gathered<'_>, node: &Node, units: Units) -> Option<Vec<TagFace>> {
    let Value::Sequence(tags) = &node.value else {
        return to.complain(node.line, "the tags are no list", "write one `{id, size, pose}` a tag");
    };
    if tags.is_empty() {
        return to.complain(node.line, "the target has no tags", "write one `{id, size, pose}` a tag");
    }
    let faces: Vec<Option<TagFace>> = tags
        .iter()
        .map(|node| {
            let fields = Fields::open(to, node, "a tag")?;
            let id = fields.require("id", "0").and_then(|node| fields.whole(node, "`id`", 0, 1_000_000));
            let size = fields.require("size", "70").and_then(|node| fields.positive(node, "`size`"));
            let pose = fields.require("pose", "{xyz: [0, 0, 0], rpy: [0, 0, 0]}").and_then(|node| match node.text() {
                Some("unknown") => Some(None),
                _ => read_pose(to, node, &format!("the pose of tag {}", id.unwrap_or(0)), units).map(Some),
            });
            fields.finish();
            Some(TagFace { id: id?, size: size? * units.length, target_from_tag: pose? })
        })
        .collect();
    faces.into_iter().collect()
}
