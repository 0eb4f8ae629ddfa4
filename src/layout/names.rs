//! Checks that need the whole layout: names, mounts, cycles, tags that two targets claim.

use std::collections::HashMap;

use super::fields::Gathered;
use super::model::{Layout, Mount, PoseSpec};
use crate::complaint::nearest;
use crate::geometry::Pattern;

/// Everything that has a frame of its own, in the order of the file.
struct Thing<'a> {
    kind: &'static str,
    name: &'a str,
    /// The frame that hangs on the mount.
    frame: String,
    line: usize,
    mount: &'a Mount,
    pose: &'a PoseSpec,
}

fn things(layout: &Layout) -> Vec<Thing<'_>> {
    let mut all = Vec::new();
    for c in &layout.cameras {
        all.push(Thing {
            kind: "camera",
            name: &c.name,
            frame: c.name.clone(),
            line: c.line,
            mount: &c.mount,
            pose: &c.pose,
        });
    }
    for r in &layout.robots {
        let frame = format!("{}.base", r.name);
        all.push(Thing { kind: "robot", name: &r.name, frame, line: r.line, mount: &r.mount, pose: &r.pose });
    }
    for s in &layout.sensors {
        all.push(Thing {
            kind: "sensor",
            name: &s.name,
            frame: s.name.clone(),
            line: s.line,
            mount: &s.mount,
            pose: &s.pose,
        });
    }
    for t in &layout.targets {
        all.push(Thing {
            kind: "target",
            name: &t.name,
            frame: t.name.clone(),
            line: t.line,
            mount: &t.mount,
            pose: &t.pose,
        });
    }
    all
}

pub(super) fn check(to: &Gathered<'_>, layout: &Layout) {
    let things = things(layout);
    let mut seen: HashMap<&str, (&str, usize)> = HashMap::new();
    for thing in &things {
        if thing.name.is_empty() || thing.name.chars().any(|c| c.is_whitespace() || ".,/:".contains(c)) {
            to.complain::<()>(
                thing.line,
                format!("the name `{}` of a {} has a character that names cannot have", thing.name, thing.kind),
                "use letters, digits, `_` and `-`",
            );
        }
        if thing.name == "world" {
            to.complain::<()>(
                thing.line,
                format!("a {} is called `world`", thing.kind),
                "choose another name; `world: NAME` at the top says which frame is the world",
            );
        }
        if let Some((kind, line)) = seen.insert(thing.name, (thing.kind, thing.line)) {
            to.complain::<()>(
                thing.line,
                format!("the name `{}` is taken by the {kind} on line {line}", thing.name),
                "give everything in the cell its own name",
            );
        }
    }
    if things.is_empty() {
        to.complain::<()>(1, "the layout describes nothing", "add `cameras`, `robots` and `targets`");
        return;
    }
    check_mounts(to, layout, &things);
    check_tags(to, layout);
}

fn check_mounts(to: &Gathered<'_>, layout: &Layout, things: &[Thing<'_>]) {
    let mut frames: Vec<String> = vec!["world".to_owned(), layout.world.clone()];
    // Which thing a frame belongs to, to follow mounts upwards.
    let mut owner: HashMap<String, usize> = HashMap::new();
    for (index, thing) in things.iter().enumerate() {
        let own = match layout.robots.iter().position(|robot| thing.kind == "robot" && robot.name == thing.name) {
            Some(robot) => layout.robots[robot].frames(),
            None => vec![thing.name.to_owned()],
        };
        for frame in own {
            owner.insert(frame.clone(), index);
            frames.push(frame);
        }
    }
    check_world(to, layout, things, &owner);
    for thing in things {
        let parent = thing.mount.parent.as_str();
        if frames.iter().any(|frame| frame == parent) {
            continue;
        }
        let remedy = if let Some(robot) = layout.robots.iter().find(|robot| robot.name == parent) {
            format!("say which part of the robot: `{0}.flange` or `{0}.base`", robot.name)
        } else {
            match nearest(parent, frames.iter().map(String::as_str)) {
                Some(meant) => format!("did you mean `{meant}`?"),
                None => "mount it on `world`, a camera, a target, or a robot's `.base` or `.flange`".to_owned(),
            }
        };
        to.complain::<()>(
            thing.mount.line,
            format!("{} `{}` is mounted on `{parent}`, which does not exist", thing.kind, thing.name),
            remedy,
        );
    }
    for (start, thing) in things.iter().enumerate() {
        let (mut at, mut path) = (start, vec![thing.name]);
        while things[at].frame != layout.world
            && let Some(&above) = owner.get(&things[at].mount.parent)
        {
            if above == start {
                path.push(thing.name);
                to.complain::<()>(
                    thing.mount.line,
                    format!("the mounts go round in a circle: {}", path.join(" on ")),
                    "something in the circle must hang on `world`",
                );
                return;
            }
            if path.len() > things.len() {
                break;
            }
            at = above;
            path.push(things[at].name);
        }
    }
}

/// The world may be a free name or a frame that stands still; one that hangs on something else cannot be the root.
fn check_world(to: &Gathered<'_>, layout: &Layout, things: &[Thing<'_>], owner: &HashMap<String, usize>) {
    let Some(&index) = owner.get(&layout.world) else {
        if layout.robots.iter().any(|robot| robot.name == layout.world) {
            let name = &layout.world;
            to.complain::<()>(
                1,
                format!("the world is the robot `{name}`, which has several frames"),
                format!("write `world: {name}.base`"),
            );
        }
        return;
    };
    let thing = &things[index];
    if thing.frame != layout.world {
        to.complain::<()>(
            thing.line,
            format!("the world is `{}`, which moves", layout.world),
            format!("choose a frame that stands still, for example `world: {}`", thing.frame),
        );
    } else if thing.mount.parent != "world" && thing.mount.parent != layout.world {
        to.complain::<()>(
            thing.mount.line,
            format!("the world is `{}`, but that is mounted on `{}`", layout.world, thing.mount.parent),
            "leave its `mount` out, or choose another world",
        );
    } else if thing.pose.pose().is_some_and(|pose| pose.magnitude() != (0.0, 0.0)) {
        to.complain::<()>(
            thing.line,
            format!("the world is `{}`, but its pose is not the identity", layout.world),
            "the world's pose is the identity by definition: leave `pose` out",
        );
    }
}

/// Tags of one family (a smaller dictionary is the beginning of a larger one) must not stand on two targets.
fn check_tags(to: &Gathered<'_>, layout: &Layout) {
    let mut seen: HashMap<(&str, u32), &str> = HashMap::new();
    for target in &layout.targets {
        let Some(Pattern::Tags { dictionary, ids }) = &target.pattern else { continue };
        for &id in ids {
            if let Some(other) = seen.insert((dictionary.family(), id), &target.name) {
                to.complain::<()>(
                    target.line,
                    format!(
                        "tag {id} of `{}` is on target `{other}` and on target `{}`",
                        dictionary.name(),
                        target.name
                    ),
                    "print one of the two with another id",
                );
                break;
            }
        }
    }
}
