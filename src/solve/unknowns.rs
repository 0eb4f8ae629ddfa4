//! The shared unknowns in the order of their columns.

use crate::frames::{FrameTree, Freedom};
use crate::geometry::Intrinsics;
use crate::layout::{Layout, LinkParameters, Motion};
use crate::robot::{PARAMETERS_PER_LINK, ParameterKind};

/// One block of neighbouring columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    /// What it is.
    pub kind: UnknownKind,
    /// Its first column.
    pub start: usize,
    /// A name for reports: a pose's key, `ur3 links`, `left lens`.
    pub name: String,
    /// For each column, the step that counts as one unit: 1 mm, 1 mrad, or what moves a pixel at the picture's edge by 1 px.
    pub units: Vec<f64>,
}

/// What a block of unknowns belongs to.
#[derive(Clone, Debug, PartialEq)]
pub enum UnknownKind {
    /// A static edge: its twist, or its translation alone.
    Edge(usize),
    /// Link corrections of a robot: which ones (places in the chain's correction vector), and the standard deviation of each one's prior.
    Links {
        /// The robot's place in the layout.
        robot: usize,
        /// Places in the correction vector.
        places: Vec<usize>,
        /// Standard deviations; none for no prior.
        sigmas: Vec<Option<f64>>,
    },
    /// Lens parameters of a camera: which ones.
    Lens {
        /// The camera's place in the layout.
        camera: usize,
        /// Places in the lens model's order.
        places: Vec<usize>,
    },
}

impl Unknown {
    /// The number of columns.
    #[must_use]
    pub fn count(&self) -> usize {
        self.units.len()
    }
}

/// All shared unknowns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unknowns {
    /// In the order of columns.
    pub blocks: Vec<Unknown>,
    /// The number of columns.
    pub count: usize,
}

impl Unknowns {
    /// The unknowns of a cell: static edges except those in `absent` (never measured), then links, then lenses that some picture sees.
    #[must_use]
    pub fn new(
        layout: &Layout,
        tree: &FrameTree,
        seen_edges: &[bool],
        seen_robots: &[bool],
        seen_lenses: &[bool],
    ) -> Self {
        let mut all = Self::default();
        for (index, edge) in tree.static_edges.iter().enumerate() {
            if edge.freedom == Freedom::Fixed || !seen_edges[index] {
                continue;
            }
            all.push(UnknownKind::Edge(index), edge.key.clone(), vec![1e-3; edge.freedom.count()]);
        }
        for (index, robot) in layout.robots.iter().enumerate() {
            if let Motion::Joints { chain, .. } = &robot.motion
                && seen_robots[index]
                && !robot.identify.is_empty()
            {
                let (mut places, mut sigmas) = (Vec::new(), Vec::new());
                for link in 0..chain.joint_count() {
                    for LinkParameters { kind, sigma } in &robot.identify {
                        let offset = ParameterKind::ALL.iter().position(|known| known == kind).unwrap_or(0);
                        let angle = kind.is_angle(chain.links[link].joint);
                        let scale = if angle { layout.units.angle } else { layout.units.length };
                        places.push(link * PARAMETERS_PER_LINK + offset);
                        sigmas.push(sigma.map(|sigma| sigma * scale));
                    }
                }
                let units = vec![1e-3; places.len()];
                all.push(UnknownKind::Links { robot: index, places, sigmas }, format!("{} links", robot.name), units);
            }
        }
        for (index, camera) in layout.cameras.iter().enumerate() {
            if let Some(intrinsics) = &camera.intrinsics
                && !camera.refine.is_empty()
                && seen_lenses[index]
            {
                let units = camera.refine.iter().map(|&place| lens_unit(intrinsics, place)).collect();
                let kind = UnknownKind::Lens { camera: index, places: camera.refine.clone() };
                all.push(kind, format!("{} lens", camera.name), units);
            }
        }
        all
    }

    fn push(&mut self, kind: UnknownKind, name: String, units: Vec<f64>) {
        let start = self.count;
        self.count += units.len();
        self.blocks.push(Unknown { kind, start, name, units });
    }

    /// The place among the blocks of a static edge.
    #[must_use]
    pub fn edge(&self, edge: usize) -> Option<usize> {
        self.blocks.iter().position(|block| block.kind == UnknownKind::Edge(edge))
    }

    /// The place among the blocks of a robot's links.
    #[must_use]
    pub fn links(&self, wanted: usize) -> Option<usize> {
        self.blocks.iter().position(|block| matches!(block.kind, UnknownKind::Links { robot, .. } if robot == wanted))
    }

    /// The place among the blocks of a camera's lens.
    #[must_use]
    pub fn lens(&self, wanted: usize) -> Option<usize> {
        self.blocks.iter().position(|block| matches!(block.kind, UnknownKind::Lens { camera, .. } if camera == wanted))
    }

    /// One unit of each column.
    #[must_use]
    pub fn units(&self) -> Vec<f64> {
        self.blocks.iter().flat_map(|block| block.units.iter().copied()).collect()
    }

    /// The block that holds a column.
    #[must_use]
    pub fn block_of(&self, column: usize) -> Option<&Unknown> {
        self.blocks.iter().find(|block| (block.start..block.start + block.count()).contains(&column))
    }
}

/// The change of a lens parameter that moves a corner at the edge of the picture by about one pixel.
fn lens_unit(intrinsics: &Intrinsics, place: usize) -> f64 {
    if place < 4 {
        return 1.0;
    }
    let (size, focal) = (intrinsics.size(), intrinsics.focal());
    let radius = (0.5 * f64::from(size[0].max(size[1])) / focal[0]).max(0.05);
    // k1 k2 p1 p2 k3 k4 k5 k6 for the Brown family; k1..k4 in odd powers of the angle for a fisheye.
    let power = match intrinsics.model() {
        crate::geometry::LensModel::KannalaBrandt => 3 + 2 * (place as i32 - 4),
        _ => match place {
            4 | 9 => 3,
            5 | 10 => 5,
            6 | 7 => 2,
            _ => 7,
        },
    };
    1.0 / (focal[0] * radius.powi(power))
}
