//! Corners laid out for the kernels: one array for each coordinate, a register's worth of points side by side.
//!
//! Within a block, the pictures taken at one configuration show the same points from the same place, so a point is projected once however many
//! pictures show it, and its pictures follow as *observations*. Under plain least squares all observations of a point are worth exactly one: their
//! weighted mean with the sum of their weights, and a constant cost.

use rayon::prelude::*;

use super::plan::{Block, GroupKind, Measurements, Plan};

/// Numbers of one observation: u, v (px), and the whitener `[a, b, c]`.
pub(super) const OBSERVATION: usize = 5;

/// Blocks whose corners lie in one piece of memory.
const CHUNK: usize = 64;

/// The corners of some neighbouring blocks.
#[derive(Clone, Debug, Default)]
struct Chunk {
    /// For each register of points: x, y, z (m), each `lanes` numbers. Spare lanes repeat a point.
    points: Vec<f64>,
    /// For each register of points and each observation of them: [`OBSERVATION`] times `lanes` numbers. Spare lanes are zero.
    observations: Vec<f64>,
    /// Where each register's observations end, counted in observations.
    ends: Vec<u32>,
    /// How many corners stand behind each point; empty if every observation is a corner.
    counts: Vec<f64>,
}

/// Where the corners of a block are.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    chunk: usize,
    first: usize,
    end: usize,
    constant: f64,
}

/// The corners of one block; see [`Chunk`] for the layout.
#[derive(Clone, Copy, Debug)]
pub(super) struct PackedBlock<'a> {
    pub(super) points: &'a [f64],
    /// Of the whole chunk.
    pub(super) observations: &'a [f64],
    /// The first observation.
    pub(super) first: usize,
    pub(super) ends: &'a [u32],
    pub(super) counts: &'a [f64],
    /// The cost that no state can lower: what the observations of one point disagree by.
    pub(super) constant: f64,
}

/// All corners of a plan.
#[derive(Clone, Debug, Default)]
pub(super) struct Packed {
    chunks: Vec<Chunk>,
    /// By [`Block::place`].
    places: Vec<Place>,
    lanes: usize,
    /// Whether the observations of a point were made one; none if nothing is packed yet.
    pub(super) folded: Option<bool>,
}

impl Packed {
    /// Packs the corners of a plan for registers of `lanes` numbers.
    pub(super) fn new(plan: &Plan, lanes: usize, folded: bool) -> Self {
        let corners = plan.groups.iter().filter(|group| matches!(group.kind, GroupKind::Corners { .. }));
        let runs: Vec<&[Block]> = corners.flat_map(|group| group.blocks.chunks(CHUNK)).collect();
        let pack = |order: &mut Order, run: &&[Block]| {
            let mut chunk = Chunk::default();
            let places: Vec<Place> =
                run.iter().map(|block| order.pack(&plan.measurements, block, lanes, folded, &mut chunk)).collect();
            (chunk, places)
        };
        let packed: Vec<(Chunk, Vec<Place>)> = runs.par_iter().map_init(Order::default, pack).collect();
        let blocks = plan.groups.iter().flat_map(|group| &group.blocks);
        let mut all = Self {
            chunks: Vec::with_capacity(packed.len()),
            places: vec![Place::default(); blocks.map(|block| block.place + 1).max().unwrap_or(0)],
            lanes,
            folded: Some(folded),
        };
        for (run, (chunk, places)) in runs.into_iter().zip(packed) {
            for (block, place) in run.iter().zip(places) {
                all.places[block.place] = Place { chunk: all.chunks.len(), ..place };
            }
            all.chunks.push(chunk);
        }
        all
    }

    /// The corners of a block.
    #[inline]
    pub(super) fn block(&self, block: &Block) -> PackedBlock<'_> {
        let Place { chunk, first, end, constant } = self.places[block.place];
        let (chunk, lanes) = (&self.chunks[chunk], self.lanes);
        PackedBlock {
            points: &chunk.points[first * 3 * lanes..end * 3 * lanes],
            observations: &chunk.observations,
            first: if first == 0 { 0 } else { chunk.ends[first - 1] as usize },
            ends: &chunk.ends[first..end],
            counts: if chunk.counts.is_empty() { &[] } else { &chunk.counts[first * lanes..end * lanes] },
            constant,
        }
    }
}

/// Buffers for sorting the corners of a block by their points.
#[derive(Default)]
struct Order {
    points: Vec<[f64; 3]>,
    /// For each corner its point.
    point_of: Vec<usize>,
    /// Corners by point: where each point's begin.
    starts: Vec<usize>,
    sorted: Vec<usize>,
    /// Where the next corner of each point goes.
    next: Vec<usize>,
}

impl Order {
    /// Finds the different points of a block. Pictures list their corners in the same order, so the next point is nearly always the one after the last.
    fn sort(&mut self, m: &Measurements, block: &Block) {
        self.points.clear();
        self.point_of.clear();
        let mut next = 0;
        for i in (block.start..block.end).filter(|i| m.corner_whiteners[*i][0] != 0.0) {
            let point = m.corner_points[i];
            let same = |known: &[f64; 3]| known.map(f64::to_bits) == point.map(f64::to_bits);
            let found = match self.points.get(next) {
                Some(known) if same(known) => Some(next),
                _ => self.points.iter().position(same),
            };
            let place = found.unwrap_or_else(|| {
                self.points.push(point);
                self.points.len() - 1
            });
            self.point_of.push(place);
            next = place + 1;
        }
        self.starts.clear();
        self.starts.resize(self.points.len() + 1, 0);
        self.point_of.iter().for_each(|place| self.starts[place + 1] += 1);
        for i in 0..self.points.len() {
            self.starts[i + 1] += self.starts[i];
        }
        self.sorted.clear();
        self.sorted.resize(self.point_of.len(), 0);
        self.next.clone_from(&self.starts);
        let corners = (block.start..block.end).filter(|i| m.corner_whiteners[*i][0] != 0.0);
        for (i, place) in corners.zip(&self.point_of) {
            self.sorted[self.next[*place]] = i;
            self.next[*place] += 1;
        }
    }

    /// Appends a block to a chunk.
    fn pack(&mut self, m: &Measurements, block: &Block, lanes: usize, folded: bool, out: &mut Chunk) -> Place {
        self.sort(m, block);
        let registers = self.points.len().div_ceil(lanes);
        let start = out.ends.len();
        let mut first = out.ends.last().map_or(0, |end| *end as usize);
        out.points.resize((start + registers) * 3 * lanes, 0.0);
        if folded {
            out.counts.resize((start + registers) * lanes, 0.0);
        }
        let mut constant = 0.0;
        for register in 0..registers {
            let points = register * lanes..self.points.len().min((register + 1) * lanes);
            let corners_of = |place: usize| self.starts[place]..self.starts[place + 1];
            let depth = if folded { 1 } else { points.clone().map(|i| corners_of(i).len()).max().unwrap_or(0) };
            out.observations.resize((first + depth) * OBSERVATION * lanes, 0.0);
            for lane in 0..lanes {
                let place = points.start + lane;
                // A spare lane repeats the last point: it projects like any other and weighs nothing.
                let point = self.points[place.min(self.points.len() - 1)];
                for (axis, x) in point.into_iter().enumerate() {
                    out.points[((start + register) * 3 + axis) * lanes + lane] = x;
                }
                if place >= points.end {
                    continue;
                }
                let corners = &self.sorted[corners_of(place)];
                let mut put = |observation: usize, values: [f64; OBSERVATION]| {
                    let to = &mut out.observations[(first + observation) * OBSERVATION * lanes..];
                    values.into_iter().enumerate().for_each(|(i, value)| to[i * lanes + lane] = value);
                };
                if folded {
                    let (mean, [a, b, c], scatter) = fold(m, corners);
                    put(0, [mean[0], mean[1], a, b, c]);
                    out.counts[(start + register) * lanes + lane] = corners.len() as f64;
                    constant += scatter;
                } else {
                    for (observation, &i) in corners.iter().enumerate() {
                        let ([u, v], [a, b, c]) = (m.corner_pixels[i], m.corner_whiteners[i]);
                        put(observation, [u, v, a, b, c]);
                    }
                }
            }
            first += depth;
            out.ends.push(first as u32);
        }
        Place { chunk: 0, first: start, end: start + registers, constant }
    }
}

/// The one observation that stands for several under least squares: the weighted mean, the whitener of the summed weights, and half the weighted sum of
/// squares about the mean. `sum |W_i (x - x_i)|^2 = |W (x - mean)|^2 + 2 constant` for every `x`.
fn fold(m: &Measurements, corners: &[usize]) -> ([f64; 2], [f64; 3], f64) {
    if let [only] = corners {
        return (m.corner_pixels[*only], m.corner_whiteners[*only], 0.0);
    }
    let weight = |i: usize| {
        let [a, b, c] = m.corner_whiteners[i];
        [a * a + b * b, b * c, c * c]
    };
    let (mut sum, mut right) = ([0.0; 3], [0.0; 2]);
    // Counted from the first corner, so that nothing is lost to the size of a pixel coordinate.
    let origin = m.corner_pixels[corners[0]];
    for &i in corners {
        let (w, pixel) = (weight(i), m.corner_pixels[i]);
        let d = [pixel[0] - origin[0], pixel[1] - origin[1]];
        (0..3).for_each(|k| sum[k] += w[k]);
        right[0] += w[0] * d[0] + w[1] * d[1];
        right[1] += w[1] * d[0] + w[2] * d[1];
    }
    let determinant = sum[0] * sum[2] - sum[1] * sum[1];
    let offset =
        [(sum[2] * right[0] - sum[1] * right[1]) / determinant, (sum[0] * right[1] - sum[1] * right[0]) / determinant];
    let mean = [origin[0] + offset[0], origin[1] + offset[1]];
    let c = sum[2].sqrt();
    let b = sum[1] / c;
    let a = (determinant / sum[2]).sqrt();
    let mut scatter = 0.0;
    for &i in corners {
        let (pixel, [a, b, c]) = (m.corner_pixels[i], m.corner_whiteners[i]);
        let (du, dv) = (pixel[0] - mean[0], pixel[1] - mean[1]);
        let (ru, rv) = (a * du, b * du + c * dv);
        scatter += ru * ru + rv * rv;
    }
    (mean, [a, b, c], 0.5 * scatter)
}
