//! The tiles in which a picture is worked through.

use nalgebra::Vector3;

use super::rays::RayTable;

/// Edge of a tile, px.
pub(super) const TILE: usize = 16;

/// A tile's pixels and the cone around their rays.
pub(super) struct Tile {
    pub(super) columns: std::ops::Range<usize>,
    pub(super) rows: std::ops::Range<usize>,
    pub(super) axis: Vector3<f64>,
    pub(super) tangent: f64,
}

impl Tile {
    /// Row and column of every pixel, row by row.
    pub(super) fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.rows.clone().flat_map(|row| self.columns.clone().map(move |column| (row, column)))
    }

    /// Column and row of sixteen pixels spread over the tile.
    pub(super) fn lattice(&self, index: usize) -> [usize; 2] {
        let place = |range: &std::ops::Range<usize>, i: usize| range.start + i * (range.len() - 1) / 3;
        [place(&self.columns, index % 4), place(&self.rows, index / 4)]
    }
}

/// A ball around the surface on which a lattice of points lies.
pub(super) fn ball(points: &[Vector3<f64>; 16]) -> (Vector3<f64>, f64) {
    let middle = points.iter().sum::<Vector3<f64>>() / 16.0;
    let radius = points.iter().map(|point| (point - middle).norm()).fold(0.0, f64::max);
    (middle, 1.1 * radius + 0.002)
}

impl RayTable {
    /// The tiles of the picture that the lens shows anything in.
    pub(super) fn tiles(&self) -> impl Iterator<Item = Tile> + '_ {
        let [width, height] = self.size;
        let starts = (0..height).step_by(TILE).flat_map(move |row| (0..width).step_by(TILE).map(move |c| (c, row)));
        starts.map(move |(column, row)| {
            let (columns, rows) = (column..(column + TILE).min(width), row..(row + TILE).min(height));
            let rim = || {
                let along = columns.clone().flat_map(|c| [(c, rows.start), (c, rows.end - 1)]);
                along.chain(rows.clone().flat_map(|r| [(columns.start, r), (columns.end - 1, r)]))
            };
            let seen = || rim().filter_map(|(c, r)| self.direction(c, r));
            let axis = seen().sum::<Vector3<f64>>().try_normalize(1e-9).unwrap_or_else(Vector3::z);
            let cosine = seen().map(|ray| ray.dot(&axis)).fold(1.0f64, f64::min).clamp(0.05, 1.0);
            // A pixel more, for the areas of the pixels at the rim.
            let tangent = (1.0 - cosine * cosine).sqrt() / cosine * (1.0 + 2.0 / TILE as f64) + 1e-6;
            Tile { columns, rows, axis, tangent }
        })
    }
}
