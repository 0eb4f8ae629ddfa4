//! The pixels on a tag, ready for wide registers: eight neighbours together, each with its place without the lens.

use super::edge_lines::Weakness;
use super::lens::Bender;
use super::picture::GreyPicture;
use super::wide::{LANES, Lanes};

/// Pixels that are looked at, at most: of a larger tag every second or third row and column.
const MOST_PIXELS: f64 = 2500.0;
/// Columns and rows of a block, whose pixels are neighbours and see the same cells.
const BLOCK: [usize; 2] = [4, 2];
/// Places along each axis at which the lens is asked; between them its answer is a cubic.
const NODES: usize = 4;

/// Eight pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    /// Ideal places from the tag's middle, px.
    pub x: Lanes,
    pub y: Lanes,
    pub value: Lanes,
    /// 1, or 0 where there is no pixel.
    pub filled: Lanes,
}

/// The pixels of a tag.
#[derive(Debug, Clone, Default)]
pub(super) struct Pixels {
    pub groups: Vec<Group>,
    /// How many they are; the last group may not be full.
    pub count: usize,
    /// Column and row of each on the grid of those that are looked at.
    places: Vec<[u16; 2]>,
    columns: usize,
    rows: usize,
    /// The grid's first column and row in the picture, and how many of the picture's one of the grid's is.
    first: [usize; 2],
    every: usize,
}

/// A rectangle of the picture around a tag.
pub(super) struct Frame {
    /// Extremes of its corners' coordinates, px.
    pub low: [f64; 2],
    pub high: [f64; 2],
    /// The origin of places, ideal px.
    pub middle: [f64; 2],
}

impl Pixels {
    /// The pixels of a frame whose place `within` lets in.
    pub fn gather(
        picture: &GreyPicture,
        bender: &Bender<'_>,
        frame: &Frame,
        within: impl Fn([f64; 2]) -> bool,
    ) -> Result<Self, Weakness> {
        let Frame { low, high, middle } = frame;
        let extent = [picture.width(), picture.height()];
        let every = (((high[0] - low[0]) * (high[1] - low[1]) / MOST_PIXELS).sqrt().ceil() as usize).max(1);
        // Conversion to integers cuts towards zero and saturates.
        let [columns, rows] = [0, 1].map(|axis: usize| {
            let all = low[axis].max(0.0) as usize..(high[axis] as usize).saturating_add(1).min(extent[axis]);
            all.step_by(every).collect::<Vec<usize>>()
        });
        let mut pixels = Self { columns: columns.len(), rows: rows.len(), every, ..Self::default() };
        let (Some(first), Some(last)) = (columns.first().zip(rows.first()), columns.last().zip(rows.last())) else {
            return Ok(pixels);
        };
        pixels.first = [*first.0, *first.1];
        let ideal = Ideal::over(bender, [*first.0, *first.1], [*last.0, *last.1])?;
        let across: Vec<[f64; NODES]> = columns.iter().map(|column| ideal.weights(0, *column)).collect();
        for (block, band) in rows.chunks(BLOCK[1]).enumerate() {
            let lines: Vec<_> = band.iter().map(|row| ideal.line(*row)).collect();
            for first in (0..columns.len()).step_by(BLOCK[0]) {
                for (k, (row, line)) in band.iter().zip(&lines).enumerate() {
                    for column in first..(first + BLOCK[0]).min(columns.len()) {
                        let [x, y] = Ideal::at(line, &across[column]);
                        let place = [x - middle[0], y - middle[1]];
                        if within(place)
                            && let Some(value) = picture.pixel(columns[column], *row)
                        {
                            pixels.push(place, value, [column as u16, (block * BLOCK[1] + k) as u16]);
                        }
                    }
                }
            }
        }
        Ok(pixels)
    }

    /// The values of the same pixels in another picture; `None` if it is too small. Lanes that stay empty are 0.
    pub fn values_in(&self, picture: &GreyPicture) -> Option<Vec<Lanes>> {
        let mut values = vec![[0.0; LANES]; self.groups.len()];
        for (values, places) in values.iter_mut().zip(self.places.chunks(LANES)) {
            for (value, place) in values.iter_mut().zip(places) {
                let [column, row] = [0, 1].map(|axis: usize| self.first[axis] + self.every * usize::from(place[axis]));
                *value = f32::from(picture.pixel(column, row)?);
            }
        }
        Some(values)
    }

    /// The values, eight by eight.
    pub fn values(&self) -> Vec<Lanes> {
        self.groups.iter().map(|group| group.value).collect()
    }

    fn push(&mut self, place: [f64; 2], value: u8, on_grid: [u16; 2]) {
        let lane = self.count % LANES;
        if lane == 0 {
            // Lanes that stay empty lie where the first one does, so that nothing is out of bounds.
            let (x, y) = (place[0] as f32, place[1] as f32);
            self.groups.push(Group { x: [x; LANES], y: [y; LANES], value: [0.0; LANES], filled: [0.0; LANES] });
        }
        if let Some(group) = self.groups.last_mut() {
            (group.x[lane], group.y[lane]) = (place[0] as f32, place[1] as f32);
            (group.value[lane], group.filled[lane]) = (f32::from(value), 1.0);
        }
        self.count += 1;
        self.places.push(on_grid);
    }

    /// Which pixels lie beside each other, and which below each other.
    pub fn neighbours(&self) -> Neighbours {
        const NONE: u32 = u32::MAX;
        // With a column and a row that stay empty.
        let wide = self.columns + 1;
        let mut grid = vec![NONE; wide * (self.rows + 1)];
        let place = |[column, row]: [u16; 2]| usize::from(row) * wide + usize::from(column);
        for (k, at) in (0..).zip(&self.places) {
            grid[place(*at)] = k;
        }
        Neighbours([1, wide].map(|step: usize| {
            let pairs = (0..).zip(&self.places).map(|(k, at)| [k, grid[place(*at) + step]]);
            pairs.filter(|pair| pair[1] != NONE).collect()
        }))
    }
}

/// Pairs of pixels beside each other and below each other.
#[derive(Debug, Clone)]
pub(super) struct Neighbours([Vec<[u32; 2]>; 2]);

impl Neighbours {
    /// Mean products of their residuals, which are in order.
    pub fn alike(&self, residuals: &[f64]) -> [f64; 2] {
        let at = |k: u32| residuals.get(k as usize).copied().unwrap_or(0.0);
        [0, 1].map(|which: usize| {
            let pairs = &self.0[which];
            pairs.iter().map(|[a, b]| at(*a) * at(*b)).sum::<f64>() / f64::max(pairs.len() as f64, 1.0)
        })
    }
}

/// What a lens makes of a small rectangle. A lens may take a microsecond a pixel to undo; over a tag it is smooth, so that it is asked at four
/// by four places, and a cubic goes through its answers: on a tag of 40 px to a thousandth of what noise leaves.
struct Ideal {
    first: [f64; 2],
    extent: [f64; 2],
    /// Row by row.
    nodes: [[[f64; 2]; NODES]; NODES],
}

impl Ideal {
    fn over(bender: &Bender<'_>, first: [usize; 2], last: [usize; 2]) -> Result<Self, Weakness> {
        let extent = [0, 1].map(|axis: usize| ((last[axis] - first[axis]) as f64).max(1.0));
        let first = first.map(|value| value as f64);
        let mut nodes = [[[0.0; 2]; NODES]; NODES];
        for (row, line) in nodes.iter_mut().enumerate() {
            for (column, node) in line.iter_mut().enumerate() {
                let part = |k: usize| k as f64 / (NODES - 1) as f64;
                *node = bender.undistort([first[0] + part(column) * extent[0], first[1] + part(row) * extent[1]])?;
            }
        }
        Ok(Self { first, extent, nodes })
    }

    /// Lagrange's weights of the nodes along one axis.
    fn weights(&self, axis: usize, at: usize) -> [f64; NODES] {
        let t = 3.0 * (at as f64 - self.first[axis]) / self.extent[axis];
        let [a, b, c, d] = [t, t - 1.0, t - 2.0, t - 3.0];
        [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0]
    }

    /// The nodes of one row of the picture.
    fn line(&self, row: usize) -> [[f64; 2]; NODES] {
        let down = self.weights(1, row);
        [0, 1, 2, 3].map(|column: usize| {
            [0, 1].map(|axis: usize| (0..NODES).map(|k| down[k] * self.nodes[k][column][axis]).sum())
        })
    }

    fn at(line: &[[f64; 2]; NODES], across: &[f64; NODES]) -> [f64; 2] {
        [0, 1].map(|axis: usize| (0..NODES).map(|k| across[k] * line[k][axis]).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::{Frame, Ideal, Pixels};
    use crate::detect::GreyPicture;
    use crate::detect::lens::{Bender, Lens};

    /// A strong barrel, as a formula of its own; only its inverse is used.
    struct Barrel;

    impl Lens for Barrel {
        fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
            let (u, v) = ((x - 640.0) / 700.0, (y - 360.0) / 700.0);
            let stretch = 1.0 + 0.3 * (u * u + v * v) + 0.1 * (u * u + v * v).powi(2);
            Some([640.0 + 700.0 * u * stretch, 360.0 + 700.0 * v * stretch])
        }

        fn distort(&self, _: [f64; 2]) -> Option<[f64; 2]> {
            None
        }
    }

    #[test]
    fn a_lens_is_a_cubic_over_a_tag() {
        for (size, most) in [(40, 1e-4), (100, 4e-3)] {
            let ideal = Ideal::over(&Bender(Some(&Barrel)), [1100, 550], [1100 + size, 550 + size]).unwrap();
            let mut worst = 0.0_f64;
            for row in 550..=550 + size {
                let line = ideal.line(row);
                for column in 1100..=1100 + size {
                    let [x, y] = Ideal::at(&line, &ideal.weights(0, column));
                    let [a, b] = Barrel.undistort([column as f64, row as f64]).unwrap();
                    worst = worst.max((x - a).hypot(y - b));
                }
            }
            assert!(worst < most, "{size}: {worst}");
        }
    }

    #[test]
    fn every_pixel_is_there_once_and_knows_its_neighbours() {
        let picture = GreyPicture::new(20, 10, (0..200).collect()).unwrap();
        let frame = Frame { low: [2.0, 1.0], high: [11.0, 7.0], middle: [5.0, 4.0] };
        let round = |[x, y]: [f64; 2]| x * x + y * y < 10.0;
        let pixels = Pixels::gather(&picture, &Bender(None), &frame, round).unwrap();
        let mut found: Vec<[i32; 3]> = pixels
            .groups
            .iter()
            .flat_map(|group| {
                (0..8).filter(|k| group.filled[*k] > 0.0).map(|k| [group.y[k], group.x[k], group.value[k]])
            })
            .map(|numbers| numbers.map(|number| number.round() as i32))
            .collect();
        found.sort_unstable();
        let expected: Vec<[i32; 3]> = (-3..=3)
            .flat_map(|y| (-3..=3).map(move |x| [y, x, (y + 4) * 20 + x + 5]))
            .filter(|at| at[0] * at[0] + at[1] * at[1] < 10)
            .collect();
        assert_eq!(found, expected);
        assert_eq!(pixels.count, expected.len());
        // Residuals that change sign from column to column.
        let stripes: Vec<f64> = pixels.places.iter().map(|at| if at[0] % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert_eq!(pixels.neighbours().alike(&stripes), [-1.0, 1.0]);
    }
}
