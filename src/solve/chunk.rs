//! How corners lie in memory; [`super::pack`] lays them out.

use std::ops::Range;

/// Numbers of one observation's pixel: u, v (px).
pub(super) const PIXEL: usize = 2;
/// Numbers of one observation's weight `W^T W`: uu, uv, vv (1/px^2).
pub(super) const WEIGHT: usize = 3;

/// The corners of some neighbouring blocks. What is said of registers here has `lanes` numbers for each; a spare lane repeats a point and weighs nothing.
#[derive(Clone, Debug, Default)]
pub(super) struct Chunk {
    /// For each register of points: x, y, z (m).
    pub(super) points: Vec<f64>,
    /// For each register where its observations end, counted from the block's first.
    pub(super) ends: Vec<u32>,
    /// For each register how many corners stand behind each point; zero in a spare lane.
    pub(super) counts: Vec<f64>,
    /// For each register and each observation of it: [`WEIGHT`].
    pub(super) weights: Vec<f64>,
    /// The same: [`PIXEL`].
    pub(super) pixels: Vec<f64>,
}

/// How many numbers of each kind a chunk holds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Room {
    points: usize,
    registers: usize,
    counts: usize,
    weights: usize,
    pixels: usize,
}

impl Chunk {
    /// An empty one with the room that another took: neighbours are alike, so that it need not grow.
    pub(super) fn with_room(room: &Room) -> Self {
        Self {
            points: Vec::with_capacity(room.points),
            ends: Vec::with_capacity(room.registers),
            counts: Vec::with_capacity(room.counts),
            weights: Vec::with_capacity(room.weights),
            pixels: Vec::with_capacity(room.pixels),
        }
    }

    pub(super) fn room(&self) -> Room {
        Room {
            points: self.points.len(),
            registers: self.ends.len(),
            counts: self.counts.len(),
            weights: self.weights.len(),
            pixels: self.pixels.len(),
        }
    }
}

/// Where the corners of a block are.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    pub(super) chunk: u32,
    /// The first register of points, and how many there are.
    pub(super) first: u32,
    pub(super) registers: u32,
    /// The first observation's weight, its pixel, and how many observations there are.
    pub(super) weight: u32,
    pub(super) pixel: u32,
    pub(super) observations: u32,
    pub(super) constant: f64,
}

impl Place {
    /// The numbers of the points' registers.
    pub(super) fn registers(&self) -> Range<usize> {
        self.first as usize..self.first as usize + self.registers as usize
    }

    /// Where the weights of the observations begin, and where their pixels do.
    pub(super) fn weight(&self, lanes: usize) -> usize {
        self.weight as usize * WEIGHT * lanes
    }

    pub(super) fn pixel(&self, lanes: usize) -> usize {
        self.pixel as usize * PIXEL * lanes
    }
}

/// The corners of one block; see [`Chunk`] for the layout.
#[derive(Clone, Copy, Debug)]
pub(super) struct PackedBlock<'a> {
    pub(super) points: &'a [f64],
    pub(super) ends: &'a [u32],
    pub(super) counts: &'a [f64],
    pub(super) weights: &'a [f64],
    pub(super) pixels: &'a [f64],
    /// The cost that no state can lower: what the observations of one point disagree by.
    pub(super) constant: f64,
}
