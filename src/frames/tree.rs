//! The tree of frames that a layout describes.

use nalgebra::Vector3;
use std::collections::HashMap;

use crate::geometry::target::tag_corners;
use crate::geometry::{Feature, Pose, TargetGeometry};
use crate::layout::{Layout, Mount, PoseSpec};

/// The place of a frame in [`FrameTree::frames`]; the root is 0.
pub type FrameId = usize;

/// One frame.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Its name; the root is called `world` whatever frame the layout chose.
    pub name: String,
    /// The frame it hangs on; none for the root.
    pub parent: Option<FrameId>,
    /// How it hangs there.
    pub edge: Edge,
    /// Edges to the root.
    pub depth: usize,
}

/// How a frame hangs on its parent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Edge {
    /// It is the root.
    Root,
    /// By a pose that never changes: an index into [`FrameTree::static_edges`].
    Static(usize),
    /// By a pose of its own at each configuration: an index into [`FrameTree::moving_edges`].
    Moving(usize),
    /// By what lies between `place` and `place + 1` of a robot.
    Link {
        /// The robot's place in the layout.
        robot: usize,
        /// Counted from the base.
        place: usize,
    },
}

/// What of a static edge is to be found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    /// Nothing.
    Fixed,
    /// Its translation: a point whose place is unknown.
    Translation,
    /// All six.
    Pose,
}

impl Freedom {
    /// The number of unknowns.
    #[must_use]
    pub fn count(self) -> usize {
        match self {
            Self::Fixed => 0,
            Self::Translation => 3,
            Self::Pose => 6,
        }
    }
}

/// An edge whose pose never changes.
#[derive(Clone, Debug)]
pub struct StaticEdge {
    /// The child.
    pub frame: FrameId,
    /// `parent_from_child` in the words of the layout.
    pub key: String,
    /// What the layout says of it.
    pub spec: PoseSpec,
    /// What is to be found.
    pub freedom: Freedom,
}

/// An edge with a pose of its own at each configuration.
#[derive(Clone, Debug)]
pub struct MovingEdge {
    /// The child.
    pub frame: FrameId,
    /// `parent_from_child`.
    pub key: String,
}

/// All frames of a cell.
#[derive(Clone, Debug)]
pub struct FrameTree {
    /// Parents before children.
    pub frames: Vec<Frame>,
    /// Static edges in the order of the layout.
    pub static_edges: Vec<StaticEdge>,
    /// Moving edges in the order of the layout.
    pub moving_edges: Vec<MovingEdge>,
    /// The frame of each camera.
    pub cameras: Vec<FrameId>,
    /// The frame of each sensor.
    pub sensors: Vec<FrameId>,
    /// The frame of each target.
    pub targets: Vec<FrameId>,
    /// The frames of each robot: base, links, flange.
    pub robots: Vec<Vec<FrameId>>,
    /// Tags and points whose place on their target is unknown.
    parts: HashMap<(usize, Feature), FrameId>,
}

/// A thing of the layout waiting for its parent to be placed.
#[derive(Clone, Copy)]
enum Waiting {
    Camera(usize),
    Robot(usize),
    Sensor(usize),
    Target(usize),
}

impl FrameTree {
    /// The tree of a checked layout.
    #[must_use]
    pub fn new(layout: &Layout) -> Self {
        let root = Frame { name: "world".to_owned(), parent: None, edge: Edge::Root, depth: 0 };
        let mut tree = Self {
            frames: vec![root],
            static_edges: Vec::new(),
            moving_edges: Vec::new(),
            cameras: vec![0; layout.cameras.len()],
            sensors: vec![0; layout.sensors.len()],
            targets: vec![0; layout.targets.len()],
            robots: vec![Vec::new(); layout.robots.len()],
            parts: HashMap::new(),
        };
        let mut names: HashMap<String, FrameId> = HashMap::from([("world".to_owned(), 0), (layout.world.clone(), 0)]);
        let mut waiting: Vec<Waiting> = (0..layout.cameras.len()).map(Waiting::Camera).collect();
        waiting.extend((0..layout.robots.len()).map(Waiting::Robot));
        waiting.extend((0..layout.sensors.len()).map(Waiting::Sensor));
        waiting.extend((0..layout.targets.len()).map(Waiting::Target));
        // Mounts form a tree (the layout has been checked), so every round places at least one thing.
        for _ in 0..=waiting.len() {
            waiting.retain(|&item| !tree.place(layout, item, &mut names));
        }
        tree
    }

    /// Places one thing if its parent stands; says whether it did.
    fn place(&mut self, layout: &Layout, item: Waiting, names: &mut HashMap<String, FrameId>) -> bool {
        let (mount, own, spec): (&Mount, String, PoseSpec) = match item {
            Waiting::Camera(i) => (&layout.cameras[i].mount, layout.cameras[i].name.clone(), layout.cameras[i].pose),
            Waiting::Robot(i) => {
                (&layout.robots[i].mount, format!("{}.base", layout.robots[i].name), layout.robots[i].pose)
            }
            Waiting::Sensor(i) => (&layout.sensors[i].mount, layout.sensors[i].name.clone(), layout.sensors[i].pose),
            Waiting::Target(i) => (&layout.targets[i].mount, layout.targets[i].name.clone(), layout.targets[i].pose),
        };
        let is_world = own == layout.world;
        let Some(parent) = (if is_world { Some(0) } else { names.get(&mount.parent).copied() }) else { return false };
        let moves = matches!(item, Waiting::Target(i) if layout.targets[i].moves) && !is_world;
        let frame = if moves {
            let key = format!("{}_from_{own}", self.frames[parent].name);
            let edge = Edge::Moving(self.moving_edges.len());
            self.moving_edges.push(MovingEdge { frame: self.frames.len(), key });
            self.add(own.clone(), parent, edge)
        } else {
            let spec = if is_world { PoseSpec::Fixed(Pose::identity()) } else { spec };
            self.add_static(own.clone(), parent, spec, Freedom::Pose)
        };
        names.insert(own, frame);
        match item {
            Waiting::Camera(i) => self.cameras[i] = frame,
            Waiting::Sensor(i) => self.sensors[i] = frame,
            Waiting::Robot(i) => self.add_links(layout, i, frame, names),
            Waiting::Target(i) => {
                self.targets[i] = frame;
                self.add_parts(layout, i, frame);
            }
        }
        true
    }

    fn add_links(&mut self, layout: &Layout, robot: usize, base: FrameId, names: &mut HashMap<String, FrameId>) {
        let mut at = base;
        self.robots[robot].push(base);
        for (place, name) in layout.robots[robot].frames().into_iter().skip(1).enumerate() {
            at = self.add(name.clone(), at, Edge::Link { robot, place });
            names.insert(name, at);
            self.robots[robot].push(at);
        }
    }

    /// Tags and points without a known place get frames of their own, so that finding them is finding a pose.
    fn add_parts(&mut self, layout: &Layout, target: usize, frame: FrameId) {
        let name = layout.targets[target].name.clone();
        match &layout.targets[target].geometry {
            TargetGeometry::Tags(faces) => {
                for face in faces.iter().filter(|face| face.target_from_tag.is_none()) {
                    let part =
                        self.add_static(format!("{name}.tag{}", face.id), frame, PoseSpec::Unknown, Freedom::Pose);
                    for corner in 0..4 {
                        self.parts.insert((target, Feature::TagCorner(face.id, corner)), part);
                    }
                }
            }
            TargetGeometry::Points(points) => {
                for (point, _) in points.iter().filter(|(_, place)| place.is_none()) {
                    let part =
                        self.add_static(format!("{name}.{point}"), frame, PoseSpec::Unknown, Freedom::Translation);
                    self.parts.insert((target, Feature::Point(point.clone())), part);
                }
            }
            TargetGeometry::None | TargetGeometry::Board { .. } => {}
        }
    }

    fn add_static(&mut self, name: String, parent: FrameId, spec: PoseSpec, freedom: Freedom) -> FrameId {
        let freedom = if matches!(spec, PoseSpec::Fixed(_)) { Freedom::Fixed } else { freedom };
        let key = format!("{}_from_{name}", self.frames[parent].name);
        let edge = Edge::Static(self.static_edges.len());
        self.static_edges.push(StaticEdge { frame: self.frames.len(), key, spec, freedom });
        self.add(name, parent, edge)
    }

    fn add(&mut self, name: String, parent: FrameId, edge: Edge) -> FrameId {
        let depth = self.frames[parent].depth + 1;
        self.frames.push(Frame { name, parent: Some(parent), edge, depth });
        self.frames.len() - 1
    }

    /// The frame in which a feature of a target has known coordinates, and those coordinates (m): the target's own frame, or
    /// the frame of the tag or point if its place is unknown.
    #[must_use]
    pub fn locate(&self, layout: &Layout, target: usize, feature: &Feature) -> Option<(FrameId, Vector3<f64>)> {
        let geometry = &layout.targets[target].geometry;
        if let Some(place) = geometry.place(feature) {
            return Some((self.targets[target], place));
        }
        let part = *self.parts.get(&(target, feature.clone()))?;
        match (feature, geometry) {
            (Feature::TagCorner(id, corner), TargetGeometry::Tags(faces)) => {
                let size = faces.iter().find(|face| face.id == *id)?.size;
                Some((part, *tag_corners(size).get(usize::from(*corner))?))
            }
            _ => Some((part, Vector3::zeros())),
        }
    }

    /// The rigid body a frame belongs to: the nearest frame above it (or itself) that moves against its parent, else the root.
    #[must_use]
    pub fn body(&self, mut frame: FrameId) -> FrameId {
        while let Frame { edge: Edge::Static(_), parent: Some(parent), .. } = self.frames[frame] {
            frame = parent;
        }
        frame
    }
}
