//! Every residual of a plan written out with its derivatives, one row a number: what the solver condenses, with nothing condensed.
#![allow(dead_code)]

use cellmap::frames::{FrameTree, Path, Step};
use cellmap::geometry::lens::{Brown, KannalaBrandt, Lens, MAX_PARAMETERS, Pinhole, Projection, Rational};
use cellmap::geometry::{LensModel, Pose, Twist, rotation};
use cellmap::layout::{Layout, Motion, PoseSigma, PoseSpec};
use cellmap::recording::{Recording, RobotMotion};
use cellmap::solve::kernels::pose_residuals;
use cellmap::solve::{Contact, Group, GroupKind, Loss, Plan, State, UnknownKind};
use nalgebra::{Matrix6, Matrix6xX, Vector3};

/// A whitened residual: its value and its derivative to every column, shared ones first, then six for each configuration and moving edge.
pub struct Row {
    pub value: f64,
    pub slopes: Vec<f64>,
}

/// Residuals that share one robust weight; a belief has none.
pub struct Rows {
    pub rows: Vec<Row>,
    pub robust: bool,
}

/// A cell at hand.
pub struct Explicit<'a> {
    pub layout: &'a Layout,
    pub tree: &'a FrameTree,
    pub recording: &'a Recording,
    pub plan: &'a Plan,
    /// Whether beliefs about shared unknowns are among the rows.
    pub priors: bool,
}

/// `J^T W J`, `J^T W r` and the cost.
pub struct Sums {
    pub hessian: nalgebra::DMatrix<f64>,
    pub gradient: nalgebra::DVector<f64>,
    pub cost: f64,
}

/// A factor of a path: its value, whether it is walked upwards, and the first of its columns with their twists.
type Factor = (Pose, bool, Option<(usize, Matrix6xX<f64>)>);

impl Explicit<'_> {
    /// All columns.
    pub fn columns(&self) -> usize {
        self.local(self.plan.configurations.len(), 0)
    }

    fn local(&self, configuration: usize, edge: usize) -> usize {
        self.plan.unknowns.count + 6 * (configuration * self.plan.moving_count() + edge)
    }

    /// The unit of each column.
    pub fn units(&self) -> Vec<f64> {
        let mut units = self.plan.unknowns.units();
        units.resize(self.columns(), 1e-3);
        units
    }

    /// The state moved along one column.
    pub fn moved(&self, state: &State, column: usize, by: f64) -> State {
        let mut next = state.clone();
        let mut d = Twist::zeros();
        let Some(block) = self.plan.unknowns.block_of(column) else {
            let local = column - self.plan.unknowns.count;
            let (place, moving) = (local / 6, self.plan.moving_count());
            d[local % 6] = by;
            let pose = &mut next.moving_poses[place % moving][place / moving];
            *pose = pose.retract(&d);
            return next;
        };
        let at = column - block.start;
        match &block.kind {
            UnknownKind::Edge(edge) => {
                d[at] = by;
                let pose = &mut next.static_poses[*edge];
                *pose = match self.tree.static_edges[*edge].freedom.count() {
                    3 => *pose * Pose::from_translation(d[0], d[1], d[2]),
                    _ => pose.retract(&d),
                };
            }
            UnknownKind::Links { robot, places, .. } => next.corrections[*robot][places[at]] += by,
            UnknownKind::Lens { camera, places } => next.lenses[*camera][places[at]] += by,
        }
        next
    }

    /// Every residual at a state.
    pub fn rows(&self, state: &State) -> Vec<Rows> {
        let mut all = Vec::new();
        for group in &self.plan.groups {
            for block in &group.blocks {
                let (pose, chain) = self.along(&group.path, block.configuration, state);
                let spread = |twist: [f64; 6]| {
                    chain.column_iter().map(|along| (0..6).map(|k| twist[k] * along[k]).sum()).collect()
                };
                for i in block.start..block.end {
                    self.measurement(group, i, &pose, state, &spread, &mut all);
                }
            }
        }
        self.stops(state, &mut all);
        if self.priors {
            self.beliefs(state, &mut all);
        }
        all
    }

    /// `sensor_from_target` and, column by column, its twist on the right.
    fn along(&self, path: &Path, configuration: usize, state: &State) -> (Pose, Matrix6xX<f64>) {
        let mut factors: Vec<Factor> = Vec::new();
        let (unknowns, six) = (&self.plan.unknowns, Matrix6xX::identity(6));
        for step in &path.steps {
            match *step {
                Step::Static { edge, inverse } => {
                    let own = unknowns.edge(edge).map(|block| &unknowns.blocks[block]);
                    let own = own.map(|block| (block.start, six.columns(0, block.count()).into_owned()));
                    factors.push((state.static_poses[edge], inverse, own));
                }
                Step::Moving { edge, inverse } => {
                    let own = Some((self.local(configuration, edge), six.clone()));
                    factors.push((state.moving_poses[edge][configuration], inverse, own));
                }
                Step::Robot { robot, from, to, inverse } => {
                    let (pose, links) = self.segment(robot, from, to, configuration, state);
                    let start = unknowns.blocks[unknowns.links(robot).unwrap()].start;
                    factors.push((pose, inverse, Some((start, links))));
                    let stop = self.plan.stops.iter().position(|stop| stop.robot == robot);
                    if let (true, Some(stop)) = (to + 1 == self.tree.robots[robot].len(), stop) {
                        let edge = self.plan.moving_edges + stop;
                        let own = Some((self.local(configuration, edge), six.clone()));
                        let twist = (state.moving_poses[edge][configuration], inverse, own);
                        factors.insert(factors.len() - usize::from(inverse), twist);
                    }
                }
            }
        }
        let mut chain = Matrix6xX::zeros(self.columns());
        let mut after = Pose::identity();
        for (value, inverse, own) in factors.into_iter().rev() {
            let with = if inverse { value.inverse() } else { value } * after;
            if let Some((first, own)) = own {
                let across = if inverse { -with.inverse().adjoint() } else { after.inverse().adjoint() };
                let mut columns = chain.columns_mut(first, own.ncols());
                columns += across * own;
            }
            after = with;
        }
        (after, chain)
    }

    /// A piece of a robot, and how its unknown links move it.
    fn segment(&self, robot: usize, from: usize, to: usize, at: usize, state: &State) -> (Pose, Matrix6xX<f64>) {
        let Motion::Joints { chain, .. } = &self.layout.robots[robot].motion else { panic!("a robot with joints") };
        let RobotMotion::Joints(joints) = &self.recording.motions[robot] else { panic!("joint values") };
        let block = &self.plan.unknowns.blocks[self.plan.unknowns.links(robot).unwrap()];
        let UnknownKind::Links { places, .. } = &block.kind else { panic!("links") };
        let joints = &joints[&self.plan.configurations[at]];
        chain.segment_with_parameters(joints, &state.corrections[robot], from, to, places)
    }

    /// Appends the residuals of one measurement; `spread` brings a derivative to the twist of `pose` to all columns.
    fn measurement(
        &self,
        group: &Group,
        i: usize,
        pose: &Pose,
        state: &State,
        spread: &dyn Fn([f64; 6]) -> Vec<f64>,
        all: &mut Vec<Rows>,
    ) {
        let (m, s) = (&self.plan.measurements, &self.plan.settings);
        let r = pose.rotation_matrix();
        // The derivative of `pose * place` along a direction.
        let towards = |direction: Vector3<f64>, place: &Vector3<f64>| {
            let own = r.transpose() * direction;
            let turn = place.cross(&own);
            [own.x, own.y, own.z, turn.x, turn.y, turn.z]
        };
        let axis = |k: usize| Vector3::from_fn(|i, _| f64::from(u8::from(i == k)));
        let mut put = |rows: Vec<Row>| all.push(Rows { rows, robust: true });
        match group.kind {
            GroupKind::Corners { camera } => {
                let place = Vector3::from(m.place(i));
                let lens = self.layout.cameras[camera].intrinsics.as_ref().unwrap();
                let at = project(lens.model(), &state.lenses[camera], &(*pose * place));
                let [a, b, c] = m.whitener(i);
                let off: [f64; 2] = std::array::from_fn(|k| at.pixel[k] - m.pixel(i)[k]);
                let plain: [Vec<f64>; 2] = std::array::from_fn(|k| {
                    let mut slopes = spread(towards(Vector3::from(at.by_point[k]), &place));
                    if let Some(block) = self.plan.unknowns.lens(camera) {
                        let block = &self.plan.unknowns.blocks[block];
                        let UnknownKind::Lens { places, .. } = &block.kind else { panic!("a lens") };
                        for (column, place) in places.iter().enumerate() {
                            slopes[block.start + column] += at.by_parameter[k][*place];
                        }
                    }
                    slopes
                });
                let mix = |x: f64, y: f64| plain[0].iter().zip(&plain[1]).map(|(u, v)| x * u + y * v).collect();
                put(vec![
                    Row { value: a * off[0], slopes: mix(a, 0.0) },
                    Row { value: b * off[0] + c * off[1], slopes: mix(b, c) },
                ]);
            }
            GroupKind::Poses => {
                let measured = m.poses[i].unwrap();
                let (translation, turn) = pose_residuals(&measured, pose, s.pose_sigma);
                let slope = rotation::right_jacobian_inverse(&(turn * s.pose_sigma[1])) / s.pose_sigma[1];
                let first = |k: usize| towards(axis(k) / s.pose_sigma[0], &Vector3::zeros());
                let second = |k: usize| [0.0, 0.0, 0.0, slope[(k, 0)], slope[(k, 1)], slope[(k, 2)]];
                put((0..3).map(|k| Row { value: translation[k], slopes: spread(first(k)) }).collect());
                put((0..3).map(|k| Row { value: turn[k], slopes: spread(second(k)) }).collect());
            }
            GroupKind::Points => {
                let (place, measured) = m.points[i].unwrap();
                let off = (*pose * place - measured) / s.point_sigma;
                let one = |k: usize| spread(towards(axis(k) / s.point_sigma, &place));
                put((0..3).map(|k| Row { value: off[k], slopes: one(k) }).collect());
            }
            GroupKind::Contacts => {
                let Contact { a, b, distance } = m.contacts[i].unwrap();
                let apart = *pose * b - a;
                let one = |direction: Vector3<f64>| spread(towards(direction / s.contact_sigma, &b));
                if distance == 0.0 {
                    put((0..3).map(|k| Row { value: apart[k] / s.contact_sigma, slopes: one(axis(k)) }).collect());
                } else {
                    let value = (apart.norm() - distance) / s.contact_sigma;
                    put(vec![Row { value, slopes: one(apart.normalize()) }]);
                }
            }
        }
    }

    /// What is believed of a pose: translation in the parent's axes, then the rotation vector of the difference.
    fn believed(&self, expected: &Pose, pose: &Pose, sigma: &PoseSigma, first: usize, all: &mut Vec<Rows>) {
        let translation = pose.translation - expected.translation;
        let turn = rotation::log(&(expected.rotation.inverse() * pose.rotation));
        let slope = rotation::right_jacobian_inverse(&turn);
        let mut by = Matrix6::zeros();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&pose.rotation_matrix());
        by.fixed_view_mut::<3, 3>(3, 3).copy_from(&slope);
        let sigmas = [sigma.translation, sigma.rotation].concat();
        let rows = (0..6).map(|k| {
            let value = if k < 3 { translation[k] } else { turn[k - 3] };
            let mut slopes = vec![0.0; self.columns()];
            (0..6).for_each(|c| slopes[first + c] = by[(k, c)] / sigmas[k]);
            Row { value: value / sigmas[k], slopes }
        });
        all.push(Rows { rows: rows.collect(), robust: false });
    }

    /// What is believed of where robots really stop, wherever something depends on it.
    fn stops(&self, state: &State, all: &mut Vec<Rows>) {
        for configuration in 0..self.plan.configurations.len() {
            for (number, stop) in self.plan.stops.iter().enumerate() {
                let edge = self.plan.moving_edges + number;
                let here = |group: &Group| {
                    group.compiled.moving.iter().any(|(_, moving)| *moving == edge)
                        && group.blocks.iter().any(|block| block.configuration == configuration)
                };
                if self.plan.groups.iter().any(here) {
                    let twist = &state.moving_poses[edge][configuration];
                    self.believed(&Pose::identity(), twist, &stop.sigma, self.local(configuration, edge), all);
                }
            }
        }
    }

    /// What the layout believes of poses and links.
    fn beliefs(&self, state: &State, all: &mut Vec<Rows>) {
        for block in &self.plan.unknowns.blocks {
            match &block.kind {
                UnknownKind::Edge(edge) => {
                    if let PoseSpec::Prior(expected, sigma) = self.tree.static_edges[*edge].spec {
                        self.believed(&expected, &state.static_poses[*edge], &sigma, block.start, all);
                    }
                }
                UnknownKind::Links { robot, places, sigmas } => {
                    for (i, (place, sigma)) in places.iter().zip(sigmas).enumerate() {
                        let sigma = sigma.unwrap();
                        let mut slopes = vec![0.0; self.columns()];
                        slopes[block.start + i] = 1.0 / sigma;
                        let value = state.corrections[*robot][*place] / sigma;
                        all.push(Rows { rows: vec![Row { value, slopes }], robust: false });
                    }
                }
                UnknownKind::Lens { .. } => {}
            }
        }
    }

    /// The equations, summed row by row.
    pub fn sums(&self, state: &State, loss: Loss) -> Sums {
        let n = self.columns();
        let mut sums =
            Sums { hessian: nalgebra::DMatrix::zeros(n, n), gradient: nalgebra::DVector::zeros(n), cost: 0.0 };
        for Rows { rows, robust } in self.rows(state) {
            let squared: f64 = rows.iter().map(|row| row.value * row.value).sum();
            let (rho, weight) = if robust { loss.evaluate(squared) } else { (squared, 1.0) };
            sums.cost += 0.5 * rho;
            for row in rows {
                let touched: Vec<usize> = (0..n).filter(|column| row.slopes[*column] != 0.0).collect();
                for &i in &touched {
                    sums.gradient[i] += weight * row.slopes[i] * row.value;
                    for &j in &touched {
                        sums.hessian[(i, j)] += weight * row.slopes[i] * row.slopes[j];
                    }
                }
            }
        }
        sums
    }
}

fn project(model: LensModel, lens: &[f64; MAX_PARAMETERS], point: &Vector3<f64>) -> Projection {
    let point: [f64; 3] = (*point).into();
    match model {
        LensModel::Pinhole => Pinhole::project_with_derivatives(lens, &point),
        LensModel::Brown => Brown::project_with_derivatives(lens, &point),
        LensModel::Rational => Rational::project_with_derivatives(lens, &point),
        LensModel::KannalaBrandt => KannalaBrandt::project_with_derivatives(lens, &point),
    }
    .unwrap_or_else(|| panic!("{model:?} cannot see {point:?}"))
}
