//! The normal equations taken apart: what each configuration, and each corner that never moves, says of the shared unknowns.
//!
//! A cluster-robust covariance needs one gradient for each group of measurements that may share an error. All that is measured at one configuration
//! shares where the robots stopped, and the shots share their light. But a camera that stands still before a target that stands still sees
//! the same corner on the same pixels again and again, whatever the robots do: there the error is the corner's, not the configuration's. So such
//! pairs are split by corner and everything else by configuration.

use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;
use std::collections::BTreeMap;

use super::assemble::{Assembler, Scratch, Shape};
use super::chain::pose_and_jacobian;
use super::local::LocalUnit;
use super::plan::{CompiledPath, CompiledStep, Group, GroupKind};
use super::state::State;
use crate::frames::FrameId;
use crate::geometry::Pose;
use crate::geometry::lens::{Lens, with_lens};

/// What one group of measurements says of the shared unknowns, with what is unknown at its configuration alone already eliminated.
#[derive(Clone, Debug, PartialEq)]
pub struct Term {
    /// The shared columns that it touches, ascending.
    pub columns: Vec<usize>,
    /// Its share of `J^T W J` over these columns.
    pub information: DMatrix<f64>,
    /// Its share of `J^T W r`.
    pub gradient: DVector<f64>,
    /// How often the same thing was measured: for a corner that never moves, its pictures.
    pub repeats: usize,
    /// Which corner that is.
    pub corner: Option<StillCorner>,
}

/// A corner of a still target in a still camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct StillCorner {
    /// The camera's place in the layout.
    pub camera: usize,
    /// The frame that the corner stands in.
    pub frame: FrameId,
    /// The bits of its place there.
    pub place: [u64; 3],
}

/// All measurements, taken apart; the sum of all terms is the problem's information and gradient.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Terms {
    /// One a configuration: everything whose path moves, and what a still camera measures other than corners.
    pub configurations: Vec<Term>,
    /// One a corner of a still target in a still camera.
    pub corners: Vec<Term>,
    /// The sum of the squared whitened twists of robots that stop inexactly.
    pub stops: f64,
}

impl Terms {
    /// The information of all measurements, `columns x columns`, row-major.
    #[must_use]
    pub fn information(&self, columns: usize) -> Vec<f64> {
        let mut sum = vec![0.0; columns * columns];
        for term in self.configurations.iter().chain(&self.corners) {
            for (i, &a) in term.columns.iter().enumerate() {
                for (j, &b) in term.columns.iter().enumerate() {
                    sum[a * columns + b] += term.information[(i, j)];
                }
            }
        }
        sum
    }
}

/// The unknowns of one configuration alone, as they follow from the shared ones.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalGain {
    /// The moving edges in the order of their columns, six each.
    pub edges: Vec<usize>,
    /// The shared columns that the gain speaks of.
    pub shared: Vec<usize>,
    /// `d local = -gain * d shared`.
    pub gain: DMatrix<f64>,
    /// The covariance of the local unknowns if the shared ones were known, at the layout's noise.
    pub covariance: DMatrix<f64>,
}

/// Whether a camera sees the same corners on the same pixels at every configuration.
fn is_still(group: &Group) -> bool {
    matches!(group.kind, GroupKind::Corners { .. })
        && group.compiled.steps.iter().all(|step| matches!(step, CompiledStep::Static { .. }))
}

impl Assembler<'_> {
    /// Takes the equations of least squares at `state` apart. Costs about one linearisation.
    pub fn terms(&mut self, state: &State) -> Terms {
        let mut configurations = Vec::new();
        let rest = self.terms_in_batches(state, usize::MAX, |batch| configurations = batch);
        Terms { configurations, ..rest }
    }

    /// As [`Assembler::terms`], but those of configurations are handed on, of so many at once, and not kept.
    pub fn terms_in_batches(&mut self, state: &State, most: usize, mut hand_on: impl FnMut(Vec<Term>)) -> Terms {
        self.linearise_locally(state);
        let mut members: Vec<Vec<(usize, usize)>> = vec![Vec::new(); self.plan.configurations.len()];
        let mut still = Vec::new();
        for (index, group) in self.plan.groups.iter().enumerate() {
            if is_still(group) {
                still.push((group, &self.shapes[index]));
                continue;
            }
            for (place, block) in group.blocks.iter().enumerate() {
                members[block.configuration].push((index, place));
            }
        }
        let mut local = vec![None; members.len()];
        for unit in self.local_units() {
            local[unit.configuration] = Some(unit);
        }
        let this: &Self = self;
        let kept = |term: &Term| !term.columns.is_empty();
        for (members, local) in members.chunks(most.max(1)).zip(local.chunks(most.max(1))) {
            let terms = members.par_iter().zip(local).map_init(Scratch::default, |scratch, (members, local)| {
                this.configuration(members, *local, state, scratch)
            });
            let terms: Vec<Term> = terms.collect();
            hand_on(terms.into_iter().filter(kept).collect());
        }
        let corners: Vec<Vec<Term>> =
            still.par_iter().map(|(group, shape)| this.still_corners(group, shape, state)).collect();
        Terms {
            configurations: Vec::new(),
            corners: corners.into_iter().flatten().filter(kept).collect(),
            stops: this.stops(state),
        }
    }

    /// Bytes that the terms of all configurations take at most.
    #[must_use]
    pub fn term_bytes(&self) -> usize {
        let mut columns = vec![0; self.plan.configurations.len()];
        for (group, shape) in self.plan.groups.iter().zip(&self.shapes).filter(|(group, _)| !is_still(group)) {
            let own: usize = shape.shared.iter().map(|(_, _, count)| count).sum();
            group.blocks.iter().for_each(|block| columns[block.configuration] += own);
        }
        let most = self.plan.unknowns.count;
        columns.into_iter().map(|own: usize| 8 * own.min(most).pow(2)).sum()
    }

    /// The sum of the squared whitened twists of robots that stop inexactly.
    #[must_use]
    pub fn stops(&self, state: &State) -> f64 {
        self.local_units().map(|unit| 2.0 * unit.belief_cost(self.plan, state)).sum()
    }

    /// Everything at one configuration but still corners.
    fn configuration(
        &self,
        members: &[(usize, usize)],
        local: Option<&LocalUnit>,
        state: &State,
        scratch: &mut Scratch,
    ) -> Term {
        let mut matrices = Vec::with_capacity(members.len());
        let mut columns: Vec<usize> = local.map_or(Vec::new(), |unit| unit.shared().to_vec());
        for &(index, block) in members {
            let (group, shape) = (&self.plan.groups[index], &self.shapes[index]);
            let mut matrix = vec![0.0; shape.width * shape.width];
            self.expand(group, shape, &group.blocks[block], state, &self.segments, scratch, &mut matrix);
            let places = places(shape);
            columns.extend(places.iter().flatten());
            matrices.push((matrix, places));
        }
        let mut term = Term::empty(columns, 1);
        for (matrix, places) in &matrices {
            term.add_compact(matrix, places);
        }
        if let Some(unit) = local {
            let (information, gradient) = unit.marginal();
            let places: Vec<usize> =
                unit.shared().iter().map(|column| term.columns.binary_search(column).unwrap_or(0)).collect();
            for (i, &a) in places.iter().enumerate() {
                term.gradient[a] -= gradient[i];
                for (j, &b) in places.iter().enumerate() {
                    term.information[(a, b)] -= information[(i, j)];
                }
            }
        }
        term
    }

    /// One term for each corner that a still camera sees of a still target.
    fn still_corners(&self, group: &Group, shape: &Shape, state: &State) -> Vec<Term> {
        let (GroupKind::Corners { camera }, Some(first)) = (group.kind, group.blocks.first()) else {
            return Vec::new();
        };
        let m = &self.plan.measurements;
        // Two corners of one frame are the same if they have the same place in it; positive bits sort like numbers, and any order will do that is
        // always the same.
        let mut by_corner: BTreeMap<[u64; 3], Vec<usize>> = BTreeMap::new();
        for i in group.blocks.iter().flat_map(|block| block.start..block.end) {
            if m.is_kept(i) {
                by_corner.entry(m.place(i).map(f64::to_bits)).or_default().push(i);
            }
        }
        let path = &group.compiled;
        let mut jacobian = vec![[0.0; 6]; path.columns];
        let pose = pose_and_jacobian(path, first.configuration, state, &self.segments, &mut jacobian);
        let (turn, lens, model) = (pose.rotation_matrix().transpose(), &state.lenses[camera], self.lens_models[camera]);
        let columns: Vec<usize> = places(shape).into_iter().flatten().collect();
        let one = |(place, indices): ([u64; 3], Vec<usize>)| {
            let mut term = Term::empty(columns.clone(), indices.len());
            term.corner = Some(StillCorner { camera, frame: group.path.to, place });
            let at: Vec<Option<usize>> =
                places(shape).iter().map(|place| term.columns.binary_search(&(*place)?).ok()).collect();
            let place = Vector3::from(m.place(indices[0]));
            let point: [f64; 3] = (pose * place).into();
            // Corners that cannot be seen from where the camera is were set aside.
            let Some(seen) = with_lens!(model, L => L::project_with_derivatives(lens, &point)) else { return term };
            let derivative = |axis: usize| -> Vec<f64> {
                let along = turn * Vector3::from(seen.by_point[axis]);
                let about = place.cross(&along);
                let twist = [along.x, along.y, along.z, about.x, about.y, about.z];
                let path = jacobian.iter().map(|b| b.iter().zip(twist).map(|(b, t)| b * t).sum());
                path.chain(shape.lens.iter().map(|place| seen.by_parameter[axis][*place])).collect()
            };
            let (by_u, by_v) = (derivative(0), derivative(1));
            for i in indices {
                let ([a, b, c], pixel) = (m.whitener(i), m.pixel(i));
                let (du, dv) = (seen.pixel[0] - pixel[0], seen.pixel[1] - pixel[1]);
                for (residual, weights) in [(a * du, [a, 0.0]), (b * du + c * dv, [b, c])] {
                    let row: Vec<f64> = by_u.iter().zip(&by_v).map(|(u, v)| weights[0] * u + weights[1] * v).collect();
                    term.add_row(&row, residual, &at);
                }
            }
            term
        };
        by_corner.into_iter().map(one).collect()
    }

    /// The pose along a path and its derivative to the path's own columns, one a column.
    pub fn along(&mut self, path: &CompiledPath, configuration: usize, state: &State) -> (Pose, DMatrix<f64>) {
        let segments = self.take_segments(state, true);
        let mut jacobian = vec![[0.0; 6]; path.columns];
        let pose = pose_and_jacobian(path, configuration, state, &segments, &mut jacobian);
        self.segments = segments;
        (pose, DMatrix::from_fn(6, path.columns, |i, j| jacobian[j][i]))
    }

    /// How the moving targets and inexact stops of a configuration follow from the shared unknowns; `None` where nothing of the kind was measured.
    pub fn local_gain(&mut self, configuration: usize, state: &State) -> Option<LocalGain> {
        self.linearise_locally(state);
        let unit = self.local_units().find(|unit| unit.configuration == configuration)?;
        let shared = unit.shared().to_vec();
        let gain = unit.gain().columns(0, shared.len()).into_owned();
        Some(LocalGain { edges: unit.form.edges.clone(), shared, gain, covariance: unit.local_covariance() })
    }
}

impl Term {
    fn empty(mut columns: Vec<usize>, repeats: usize) -> Self {
        columns.sort_unstable();
        columns.dedup();
        let k = columns.len();
        Self { columns, information: DMatrix::zeros(k, k), gradient: DVector::zeros(k), repeats, corner: None }
    }

    /// Takes in what other measurements of the same group say.
    pub fn include(&mut self, more: &Self) {
        self.information += &more.information;
        self.gradient += &more.gradient;
        self.repeats += more.repeats;
    }

    /// Adds one whitened residual with its derivative to compact columns that stand at `at`.
    fn add_row(&mut self, row: &[f64], residual: f64, at: &[Option<usize>]) {
        for (x, a) in row.iter().zip(at).filter_map(|(x, a)| Some((x, (*a)?))) {
            self.gradient[a] += x * residual;
            for (y, b) in row.iter().zip(at).filter_map(|(y, b)| Some((y, (*b)?))) {
                self.information[(a, b)] += x * y;
            }
        }
    }

    /// Adds a compact matrix (upper triangle, residual last), whose columns are the shared ones `places`.
    fn add_compact(&mut self, matrix: &[f64], places: &[Option<usize>]) {
        let width = places.len() + 1;
        let at: Vec<Option<usize>> =
            places.iter().map(|place| place.and_then(|column| self.columns.binary_search(&column).ok())).collect();
        for (i, a) in at.iter().enumerate() {
            let Some(a) = *a else { continue };
            self.gradient[a] += matrix[i * width + width - 1];
            for (j, b) in at.iter().enumerate().skip(i) {
                let Some(b) = *b else { continue };
                self.information[(a, b)] += matrix[i * width + j];
                if i != j {
                    self.information[(b, a)] += matrix[i * width + j];
                }
            }
        }
    }
}

/// The shared column behind each compact one, the residual's left out; none for a moving edge's.
fn places(shape: &Shape) -> Vec<Option<usize>> {
    let mut places = vec![None; shape.width - 1];
    for &(compact, shared, count) in &shape.shared {
        for i in 0..count {
            places[compact + i] = Some(shared + i);
        }
    }
    places
}
