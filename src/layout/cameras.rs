//! Reading cameras: entries of a layout and intrinsics files.

use super::fields::{Fields, Gathered, shown};
use super::images::ImagePattern;
use super::model::Camera;
use super::read::{Context, read_mount, read_text_file};
use super::yaml::{self, Node, Value};
use crate::complaint::{Complaint, list, nearest};
use crate::geometry::{Intrinsics, LensModel};

pub(super) fn read_camera(context: &Context<'_>, name: &str, node: &Node) -> Option<Camera> {
    let to = context.to;
    let fields = Fields::open(to, node, format!("camera `{name}`"))?;
    let images = fields.get("images").map(|node| {
        let text = fields.text(node, "`images`")?;
        match ImagePattern::parse(text) {
            Ok(_) => Some(text.to_owned()),
            Err(what) => to.complain(
                node.line,
                format!("`images` of camera `{name}` {what}"),
                "write a path such as `images/left/{configuration:04}_{shot:02}.png`",
            ),
        }
    });
    let intrinsics = fields.get("intrinsics").map(|node| match node.text() {
        Some(file) => {
            let path = context.resolve(file);
            let text = read_text_file(to, node.line, &path)?;
            match parse_intrinsics(&path, &text) {
                Ok(intrinsics) => Some(intrinsics),
                Err(complaints) => to.adopt(complaints),
            }
        }
        None => read_intrinsics(to, node, &format!("the intrinsics of camera `{name}`")),
    });
    let refine_node = fields.get("refine");
    let mount = read_mount(&fields);
    let pose = context.read_pose_of(&fields);
    let line = fields.line;
    fields.finish();
    let intrinsics = match intrinsics {
        None => None,
        Some(intrinsics) => Some(intrinsics?),
    };
    let refine = match (refine_node, &intrinsics) {
        (None, _) => Vec::new(),
        (Some(node), Some(intrinsics)) => read_refine(to, name, node, intrinsics.model())?,
        (Some(node), None) => {
            return to.complain(
                node.line,
                format!("camera `{name}` has lens parameters to refine but no `intrinsics`"),
                "give `intrinsics` as the starting value",
            );
        }
    };
    let images = match images {
        None => None,
        Some(images) => Some(images?),
    };
    if images.is_some() && intrinsics.is_none() {
        return to.complain(
            line,
            format!("camera `{name}` has pictures but no `intrinsics`"),
            "add `intrinsics: {model: pinhole, size: [W, H], focal: [F, F], centre: [CX, CY]}`; `refine: [focal, centre]` then improves a rough guess",
        );
    }
    Some(Camera { name: name.to_owned(), line, images, intrinsics, refine, mount: mount?, pose: pose? })
}

/// The words of `refine` for a list of parameters: the inverse of reading them.
pub(super) fn refined_groups(lens: &Intrinsics, refine: &[usize]) -> Vec<&'static str> {
    let has =
        |places: std::ops::Range<usize>| !places.is_empty() && places.clone().any(|place| refine.contains(&place));
    let groups = [("focal", 0..2), ("centre", 2..4), ("distortion", 4..lens.model().parameter_count())];
    groups.into_iter().filter(|(_, places)| has(places.clone())).map(|(name, _)| name).collect()
}

fn read_refine(to: &Gathered<'_>, name: &str, node: &Node, model: LensModel) -> Option<Vec<usize>> {
    let Value::Sequence(items) = &node.value else {
        return to.complain(
            node.line,
            format!("`refine` of camera `{name}` is {}", shown(node)),
            "write a list such as `[focal, centre]`",
        );
    };
    let mut wanted = Vec::new();
    for item in items {
        match item.text() {
            Some("focal") => wanted.extend([0, 1]),
            Some("centre") => wanted.extend([2, 3]),
            Some("distortion") if model.distortion_count() > 0 => wanted.extend(4..model.parameter_count()),
            Some("distortion") => {
                return to.complain(
                    item.line,
                    format!("camera `{name}` is to refine its distortion but its model `{}` has none", model.name()),
                    "use `model: brown` with `distortion: [0, 0, 0, 0, 0]`",
                );
            }
            _ => {
                return to.complain(
                    item.line,
                    format!("`refine` of camera `{name}` names {}", shown(item)),
                    "it may name `focal`, `centre` and `distortion`",
                );
            }
        }
    }
    wanted.sort_unstable();
    wanted.dedup();
    Some(wanted)
}

/// Parses an intrinsics file: the same keys as in a layout.
///
/// # Errors
/// Everything that is wrong with the file.
pub fn parse_intrinsics(file: &std::path::Path, text: &str) -> Result<Intrinsics, Vec<Complaint>> {
    let root = yaml::parse(text).map_err(|e| vec![Complaint::at(file, e.line, e.what, e.remedy)])?;
    let to = Gathered::new(file);
    let intrinsics = read_intrinsics(&to, &root, "the intrinsics");
    let complaints = to.complaints.into_inner();
    match intrinsics {
        Some(intrinsics) if complaints.is_empty() => Ok(intrinsics),
        _ => Err(complaints),
    }
}

fn read_intrinsics(to: &Gathered<'_>, node: &Node, what: &str) -> Option<Intrinsics> {
    let fields = Fields::open(to, node, what)?;
    let model = fields.require("model", "brown").and_then(|node| read_model(to, node));
    let size = fields.require("size", "[1280, 720]").and_then(|node| fields.counts::<2>(node, "`size`"));
    let focal = fields.require("focal", "[920, 920]").and_then(|node| {
        let focal = fields.numbers::<2>(node, "`focal`")?;
        if focal.iter().all(|f| *f > 0.0) {
            return Some(focal);
        }
        to.complain(node.line, format!("`focal` of {what} is not positive"), "give focal lengths in pixels")
    });
    let centre = fields.require("centre", "[639.5, 359.5]").and_then(|node| fields.numbers::<2>(node, "`centre`"));
    let distortion = fields.get("distortion").map(|node| (node.line, fields.list(node, "`distortion`")));
    let line = fields.line;
    fields.finish();
    let model = model?;
    let (line, distortion) = match distortion {
        None => (line, vec![0.0; model.distortion_count()]),
        Some((line, values)) => (line, values?),
    };
    match Intrinsics::new(model, size?, focal?, centre?, &distortion) {
        Ok(intrinsics) => Some(intrinsics),
        Err(error) => to.complain(line, format!("in {what}: {error}"), "check the model's name and its numbers"),
    }
}

fn read_model(to: &Gathered<'_>, node: &Node) -> Option<LensModel> {
    let names = LensModel::ALL.map(LensModel::name);
    let text = node.text().unwrap_or("");
    // `fisheye` is what OpenCV calls the Kannala-Brandt model.
    let text = if text == "fisheye" { "kannala_brandt" } else { text };
    LensModel::ALL.into_iter().find(|model| model.name() == text).or_else(|| {
        let remedy = match nearest(text, names) {
            Some(meant) => format!("did you mean `{meant}`?"),
            None => format!("it is one of {}", list(names)),
        };
        to.complain(node.line, format!("the lens model {} is unknown", shown(node)), remedy)
    })
}
