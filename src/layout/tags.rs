//! Reading tags: single ones, grids, cubes, and target files.

use super::fields::{Fields, Gathered};
use super::model::{PoseSpec, Units};
use super::poses::{read_pose_spec, read_units};
use super::read::{Context, read_text_file};
use super::targets::{Place, Shape};
use super::yaml::{self, Node, Value};
use crate::complaint::Complaint;
use crate::geometry::dictionary::Dictionary;
use crate::geometry::{Pattern, Pose, TagFace, TargetGeometry};

pub(super) fn read_dictionary(fields: &Fields<'_>) -> Option<Dictionary> {
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

pub(super) fn read_tags(
    context: &Context<'_>,
    name: &str,
    node: &Node,
    unknown: bool,
) -> Option<(Shape, Option<Pattern>)> {
    let (to, units) = (context.to, context.units);
    let fields = Fields::open(to, node, format!("`tags` of target `{name}`"))?;
    let dictionary = read_dictionary(&fields);
    let size = fields.get("size").map(|node| (node.line, fields.positive(node, "`size`")));
    let ids = fields.get("ids").map(|node| read_ids(&fields, node, dictionary));
    let (file, grid, cube, places) = (fields.get("file"), fields.get("grid"), fields.get("cube"), fields.get("places"));
    let geometry = match (file.or(places), grid, cube, ids) {
        (Some(node), None, None, None) if places.is_some() => read_places(to, node, units).map(TagPlaces::shape),
        (Some(node), None, None, None) => {
            let path = context.resolve(fields.text(node, "`file`")?);
            let text = read_text_file(to, node.line, &path)?;
            match parse_target(&path, &text, dictionary) {
                Ok(faces) => Some(faces.shape()),
                Err(complaints) => to.adopt(complaints),
            }
        }
        (None, Some(node), None, None) => read_grid(to, name, node, units).map(Shape::from),
        (None, None, Some(node), None) => read_cube(to, name, node, units, dictionary).map(Shape::from),
        (None, None, None, Some(ids)) => match size {
            Some((_, size)) => Some(single_tags(ids?, size? * units.length).into()),
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
    let (dictionary, mut shape) = (dictionary?, geometry?);
    let TargetGeometry::Tags(faces) = &mut shape.known else { return None };
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
    Some((shape, Some(Pattern::Tags { dictionary, ids })))
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

pub(super) fn read_april_grid(
    to: &Gathered<'_>,
    name: &str,
    node: &Node,
    units: Units,
) -> Option<(Shape, Option<Pattern>)> {
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
    Some((geometry.into(), Some(Pattern::Tags { dictionary, ids: (first..=last).collect() })))
}

/// The tags of a target file or of a layout's `places`.
#[derive(Clone, Debug, PartialEq)]
pub struct TagPlaces {
    /// As a solver is to know them.
    pub known: Vec<TagFace>,
    /// With the hidden places too.
    pub truth: Vec<TagFace>,
}

impl TagPlaces {
    fn shape(self) -> Shape {
        Shape { known: TargetGeometry::Tags(self.known), truth: TargetGeometry::Tags(self.truth) }
    }
}

/// Parses a target file: where each tag sits on a body.
///
/// # Errors
/// Everything that is wrong with the file.
pub fn parse_target(
    file: &std::path::Path,
    text: &str,
    expected: Option<Dictionary>,
) -> Result<TagPlaces, Vec<Complaint>> {
    let root = yaml::parse(text).map_err(|e| vec![Complaint::at(file, e.line, e.what, e.remedy)])?;
    let to = Gathered::new(file);
    let faces = parse_target_node(&to, &root, expected);
    let complaints = to.complaints.into_inner();
    match faces {
        Some(faces) if complaints.is_empty() => Ok(faces),
        _ => Err(complaints),
    }
}

fn parse_target_node(to: &Gathered<'_>, root: &Node, expected: Option<Dictionary>) -> Option<TagPlaces> {
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
fn read_places(to: &Gathered<'_>, node: &Node, units: Units) -> Option<TagPlaces> {
    let Value::Sequence(tags) = &node.value else {
        return to.complain(node.line, "the tags are no list", "write one `{id, size, pose}` a tag");
    };
    if tags.is_empty() {
        return to.complain(node.line, "the target has no tags", "write one `{id, size, pose}` a tag");
    }
    let faces: Vec<Option<(TagFace, TagFace)>> = tags
        .iter()
        .map(|node| {
            let fields = Fields::open(to, node, "a tag")?;
            let id = fields.require("id", "0").and_then(|node| fields.whole(node, "`id`", 0, 1_000_000));
            let size = fields.require("size", "70").and_then(|node| fields.positive(node, "`size`"));
            let place = fields
                .require("pose", "{xyz: [0, 0, 0], rpy: [0, 0, 0]}")
                .and_then(|node| read_tag_place(to, node, &format!("tag {}", id.unwrap_or(0)), units));
            fields.finish();
            let (id, size, place) = (id?, size? * units.length, place?);
            let face = |target_from_tag| TagFace { id, size, target_from_tag };
            Some((face(place.known), face(place.truth)))
        })
        .collect();
    let (known, truth) = faces.into_iter().collect::<Option<Vec<_>>>()?.into_iter().unzip();
    Some(TagPlaces { known, truth })
}

fn read_tag_place(to: &Gathered<'_>, node: &Node, what: &str, units: Units) -> Option<Place<Pose>> {
    match read_pose_spec(to, node, what, units)? {
        PoseSpec::Unknown => Some(Place { known: None, truth: None }),
        PoseSpec::Hidden(pose) => Some(Place { known: None, truth: Some(pose) }),
        PoseSpec::Fixed(pose) => Some(Place { known: Some(pose), truth: Some(pose) }),
        PoseSpec::Start(_) | PoseSpec::Prior(..) => to.complain(
            node.line,
            format!("the place of {what} on its target has `start` or `sigma`"),
            "a tag's place on its target is given exactly or is `unknown`",
        ),
    }
}
