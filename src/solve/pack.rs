//! Corners laid out for the kernels: one array for each coordinate, a register's worth of points side by side.
//!
//! Within a block, the pictures taken at one configuration show the same points from the same place, so a point is projected once however many
//! pictures show it, and its pictures follow as *observations*. Under plain least squares all observations of a point are worth exactly one: their
//! weighted mean with the sum of their weights, and a constant cost.
//!
//! Most pictures of a target show the same points with the same weights as the one before, so points and weights are kept once for a run of such
//! blocks: two numbers a corner remain to be read.

use rayon::prelude::*;

use super::chunk::{Chunk, PIXEL, PackedBlock, Place, Room, WEIGHT};
use super::mean::Mean;
use super::measurements::Measurements;
use super::plan::{Block, GroupKind, Plan};

/// Blocks whose corners lie in one piece of memory.
const CHUNK: usize = 64;

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
    /// Packs the corners of a plan for registers of `lanes` numbers, on this thread alone if that is enough.
    pub(super) fn new(plan: &Plan, lanes: usize, folded: bool, alone: bool) -> Self {
        let corners = plan.groups.iter().filter(|group| matches!(group.kind, GroupKind::Corners { .. }));
        let blocks = plan.groups.iter().flat_map(|group| &group.blocks);
        let mut places = vec![Place::default(); blocks.map(|block| block.place + 1).max().unwrap_or(0)];
        let (mut rest, mut passed, mut runs) = (&mut places[..], 0, Vec::new());
        for run in corners.flat_map(|group| group.blocks.chunks(CHUNK)) {
            // Places ascend through all groups. Some are of no block any more.
            let end = run[run.len() - 1].place + 1;
            let (own, after) = std::mem::take(&mut rest).split_at_mut(end - passed);
            runs.push((run, &mut own[run[0].place - passed..]));
            (rest, passed) = (after, end);
        }
        let pack = |order: &mut Order, (number, (run, places)): (usize, (&[Block], &mut [Place]))| {
            let mut chunk = Chunk::with_room(&order.room);
            order.known.clear();
            order.points.clear();
            order.before = None;
            let mut last: Option<Place> = None;
            for block in run {
                let place = order.pack(&plan.measurements, block, lanes, folded, last.as_ref(), &mut chunk);
                places[block.place - run[0].place] = Place { chunk: number as u32, ..place };
                last = Some(place);
            }
            order.room = chunk.room();
            chunk
        };
        let chunks = if alone {
            let mut order = Order::default();
            runs.into_iter().enumerate().map(|run| pack(&mut order, run)).collect()
        } else {
            runs.into_par_iter().enumerate().map_init(Order::default, pack).collect()
        };
        Self { chunks, places, lanes, folded: Some(folded) }
    }

    /// The corners of a block.
    #[inline]
    pub(super) fn block(&self, block: &Block) -> PackedBlock<'_> {
        let place = self.places[block.place];
        let (chunk, lanes) = (&self.chunks[place.chunk as usize], self.lanes);
        let registers = place.registers();
        let part = |start: usize, size: usize| start..start + place.observations as usize * size * lanes;
        PackedBlock {
            points: &chunk.points[registers.start * 3 * lanes..registers.end * 3 * lanes],
            ends: &chunk.ends[registers.clone()],
            counts: &chunk.counts[registers.start * lanes..registers.end * lanes],
            weights: &chunk.weights[part(place.weight(lanes), WEIGHT)],
            pixels: &chunk.pixels[part(place.pixel(lanes), PIXEL)],
            constant: place.constant,
        }
    }
}

/// A point that the block has not shown yet.
const ABSENT: u32 = u32::MAX;

/// Buffers for sorting the corners of a block by their points.
#[derive(Default)]
struct Order {
    /// Every point that the run's blocks have shown, and its place among the present block's points.
    known: Vec<([f64; 3], u32)>,
    /// For each point of the block its place among the known, and the same of the block before.
    points: Vec<u32>,
    points_before: Vec<u32>,
    /// For each corner its point.
    point_of: Vec<u32>,
    /// For each point how many corners show it, and how many of them have been dealt with.
    counts: Vec<[u32; 2]>,
    counts_before: Vec<[u32; 2]>,
    means: Vec<Mean>,
    /// What the chunk before took.
    room: Room,
    /// The block that was sorted last.
    before: Option<Block>,
}

impl Order {
    /// Sorts a block. Tells whether it shows what the last one does, corner by corner, so that all stays as it is, and whether with the same weights.
    fn sort_again(&mut self, m: &Measurements, block: &Block) -> [bool; 2] {
        let [points, weights] = self.before.replace(*block).map_or([false; 2], |before| {
            let (a, b) = (before.start..before.end, block.start..block.end);
            let points = m.show_alike(a.clone(), b.clone());
            let weights = points && a.zip(b).fold(true, |all, (i, j)| all & is_same(&m.whitener(i), &m.whitener(j)));
            [points, weights]
        });
        if points {
            self.counts.iter_mut().for_each(|count| count[1] = 0);
        } else {
            self.sort(m, block);
        }
        [points, weights]
    }

    /// Finds the different points of a block, in the order in which they appear. Pictures list their corners in the same order, so the next point is nearly
    /// always the one after the last.
    fn sort(&mut self, m: &Measurements, block: &Block) {
        std::mem::swap(&mut self.points, &mut self.points_before);
        std::mem::swap(&mut self.counts, &mut self.counts_before);
        self.points.clear();
        self.point_of.clear();
        self.counts.clear();
        self.known.iter_mut().for_each(|(_, place)| *place = ABSENT);
        let mut next = 0;
        for i in (block.start..block.end).filter(|i| m.is_kept(*i)) {
            let point = m.place(i);
            let same = |known: &([f64; 3], u32)| is_same(&known.0, &point);
            let (before, after) = self.known.split_at(next.min(self.known.len()));
            let ahead = after.iter().position(same).map(|place| before.len() + place);
            let found = ahead.or_else(|| before.iter().position(same)).unwrap_or_else(|| {
                self.known.push((point, ABSENT));
                self.known.len() - 1
            });
            next = found + 1;
            let place = &mut self.known[found].1;
            if *place == ABSENT {
                *place = self.points.len() as u32;
                self.points.push(found as u32);
                self.counts.push([0; 2]);
            }
            self.point_of.push(*place);
            self.counts[*place as usize][0] += 1;
        }
    }

    /// Appends a block to a chunk; `last` is the block before it.
    fn pack(
        &mut self,
        m: &Measurements,
        block: &Block,
        lanes: usize,
        folded: bool,
        last: Option<&Place>,
        out: &mut Chunk,
    ) -> Place {
        let [again, weighed] = self.sort_again(m, block);
        let like = last.filter(|_| again || (self.points == self.points_before && self.shown_as_often()));
        let mut place = Place {
            first: like.map_or(out.ends.len() as u32, |last| last.first),
            registers: self.points.len().div_ceil(lanes) as u32,
            weight: (out.weights.len() / (WEIGHT * lanes)) as u32,
            pixel: (out.pixels.len() / (PIXEL * lanes)) as u32,
            ..Place::default()
        };
        match like {
            Some(last) => place.observations = last.observations,
            None => place.observations = self.pack_points(lanes, folded, out),
        }
        let observations = place.observations as usize;
        match last.filter(|_| weighed) {
            Some(last) => place.weight = last.weight,
            None => out.weights.resize(out.weights.len() + observations * WEIGHT * lanes, 0.0),
        }
        out.pixels.resize(out.pixels.len() + observations * PIXEL * lanes, 0.0);
        if self.point_of.len() == self.points.len() && self.points.len() == block.end - block.start {
            put_all(out, &place, lanes, m, block, !weighed);
        } else if folded {
            place.constant = self.fold(m, block);
            for (point, mean) in self.means.iter().enumerate() {
                let at = (point / lanes, point % lanes);
                put(out, &place, lanes, at, mean.pixel(), (!weighed).then_some(mean.weight));
            }
        } else {
            let corners = (block.start..block.end).filter(|i| m.is_kept(*i));
            for (i, &point) in corners.zip(&self.point_of) {
                let (register, lane) = (point as usize / lanes, point as usize % lanes);
                let before = if register == 0 { 0 } else { out.ends[place.first as usize + register - 1] };
                let done = &mut self.counts[point as usize][1];
                let observation = (before + *done) as usize;
                *done += 1;
                let weight = (!weighed).then(|| weight(m.whitener(i)));
                put(out, &place, lanes, (observation, lane), m.pixel(i), weight);
            }
        }
        if let Some(last) = like.filter(|_| !weighed) {
            share_weights(out, lanes, last, &mut place);
        }
        place
    }

    /// Whether each point was shown as often as in the block before.
    fn shown_as_often(&self) -> bool {
        self.counts.iter().map(|count| count[0]).eq(self.counts_before.iter().map(|count| count[0]))
    }

    /// Appends the points; returns the number of observations.
    fn pack_points(&self, lanes: usize, folded: bool, out: &mut Chunk) -> u32 {
        let mut observations = 0;
        for start in (0..self.points.len()).step_by(lanes) {
            let points = start..self.points.len().min(start + lanes);
            observations += if folded { 1 } else { points.clone().map(|i| self.counts[i][0]).max().unwrap_or(0) };
            out.ends.push(observations);
            for axis in 0..3 {
                // A spare lane repeats the last point: it projects like any other.
                let of = |i: usize| self.known[self.points[i.min(points.end - 1)] as usize].0[axis];
                out.points.extend((start..start + lanes).map(of));
            }
            out.counts.extend(points.clone().map(|i| f64::from(self.counts[i][0])));
            out.counts.resize(out.ends.len() * lanes, 0.0);
        }
        observations
    }

    /// Makes all corners of a point one; returns the constant cost.
    fn fold(&mut self, m: &Measurements, block: &Block) -> f64 {
        self.means.clear();
        self.means.resize(self.points.len(), Mean::default());
        let corners = || (block.start..block.end).filter(|i| m.is_kept(*i)).zip(&self.point_of);
        for (i, &point) in corners() {
            self.means[point as usize].add(m.pixel(i), weight(m.whitener(i)));
        }
        if self.point_of.len() == self.points.len() {
            return 0.0;
        }
        let mut constant = 0.0;
        for mean in &mut self.means {
            mean.close();
        }
        for (i, &point) in corners() {
            let ([u, v], [a, b, c], mean) = (m.pixel(i), m.whitener(i), self.means[point as usize].pixel());
            let (du, dv) = (u - mean[0], v - mean[1]);
            let (ru, rv) = (a * du, b * du + c * dv);
            constant += ru * ru + rv * rv;
        }
        0.5 * constant
    }
}

/// Whether two places are one, bit by bit. Number by number: arrays of bits are first put together in memory, which takes as long as all the rest.
fn is_same(a: &[f64; 3], b: &[f64; 3]) -> bool {
    a[0].to_bits() == b[0].to_bits() && a[1].to_bits() == b[1].to_bits() && a[2].to_bits() == b[2].to_bits()
}

/// Whether all pairs are alike. Looks at all of them, which is quicker than to ask after each whether it is time to stop.
fn all_alike<T>(a: &[T], b: &[T], alike: impl Fn(&T, &T) -> bool) -> bool {
    a.iter().zip(b).fold(true, |all, (a, b)| all & alike(a, b))
}

/// `W^T W` of a whitener `[a, 0; b, c]`.
fn weight([a, b, c]: [f64; 3]) -> [f64; WEIGHT] {
    [a * a + b * b, b * c, c * c]
}

/// Writes an observation of a block; without a weight, the block before has the same.
fn put(
    out: &mut Chunk,
    place: &Place,
    lanes: usize,
    (observation, lane): (usize, usize),
    pixel: [f64; PIXEL],
    weight: Option<[f64; WEIGHT]>,
) {
    let to = &mut out.pixels[place.pixel(lanes) + observation * PIXEL * lanes..];
    (to[lane], to[lanes + lane]) = (pixel[0], pixel[1]);
    if let Some(weight) = weight {
        let to = &mut out.weights[place.weight(lanes) + observation * WEIGHT * lanes..];
        (to[lane], to[lanes + lane], to[2 * lanes + lane]) = (weight[0], weight[1], weight[2]);
    }
}

/// Writes the observations of a block that shows each of its points once, so that they come in the order of its corners.
fn put_all(out: &mut Chunk, place: &Place, lanes: usize, m: &Measurements, block: &Block, weights: bool) {
    let pixels = &mut out.pixels[place.pixel(lanes)..];
    for (first, to) in (block.start..block.end).step_by(lanes).zip(pixels.chunks_exact_mut(PIXEL * lanes)) {
        let (u, v) = to.split_at_mut(lanes);
        for ((i, u), v) in (first..block.end).zip(u).zip(v) {
            [*u, *v] = m.pixel(i);
        }
    }
    if weights {
        let to = &mut out.weights[place.weight(lanes)..];
        for (first, to) in (block.start..block.end).step_by(lanes).zip(to.chunks_exact_mut(WEIGHT * lanes)) {
            for (lane, i) in (first..block.end.min(first + lanes)).enumerate() {
                let [uu, uv, vv] = weight(m.whitener(i));
                (to[lane], to[lanes + lane], to[2 * lanes + lane]) = (uu, uv, vv);
            }
        }
    }
}

/// Drops the weights of the newest block if they are those of the one before it, which shows the same points.
fn share_weights(out: &mut Chunk, lanes: usize, last: &Place, place: &mut Place) {
    let (before, newest) = out.weights.split_at(place.weight(lanes));
    let before = &before[last.weight(lanes)..][..newest.len()];
    if all_alike(before, newest, |a, b| a.to_bits() == b.to_bits()) {
        out.weights.truncate(place.weight(lanes));
        place.weight = last.weight;
    }
}
