//! What stands in the lamp's light.

use nalgebra::Vector3;

use super::face::Face;
use super::layer::{Layer, View};
use super::solid::Solid;
use super::tile::{TILE, Tile};

/// Edge of a block within which light is first looked at in the corners only, px.
const BLOCK: usize = 8;

impl View<'_> {
    /// The part of the lamp's light that reaches a point past some bodies.
    pub(super) fn passing(&self, point: &Vector3<f64>, casters: &[&Solid<'_>]) -> f64 {
        let to_light = self.light.place - point;
        let distance = to_light.norm();
        let direction = to_light / distance;
        let mut passing = 1.0;
        for caster in casters {
            passing *= 1.0 - caster.shade(point, &direction, distance, self.light.radius);
            if passing < 1e-3 {
                return 0.0;
            }
        }
        passing
    }

    /// Lays shadows of still bodies over a tile whose surfaces are not shaded yet: floor and walls, or one body that fills it.
    pub(super) fn lay_shadows(
        &self,
        layer: &mut Layer,
        tile: &Tile,
        casters: &[&Solid<'_>],
        only_room: Option<&[Face<'_>]>,
    ) {
        let Some((middle, radius)) = self.extent(layer, tile) else { return };
        let reaches = |c: &&&Solid<'_>| c.near_shaft(&middle, radius, &self.light.place, self.light.radius);
        let shading: Vec<&Solid<'_>> = casters.iter().filter(reaches).copied().collect();
        if shading.is_empty() {
            return;
        }
        let passing = self.passing_tile(layer, tile, &shading);
        for (place, (row, column)) in tile.pixels().enumerate() {
            let index = row * self.rays.size[0] + column;
            if let Some(room) = only_room {
                let Some(direction) = self.rays.direction(column, row) else { continue };
                let behind = room.iter().filter_map(|face| face.distance(&direction)).fold(1e6, f64::min);
                // A body here has been shaded as such.
                if f64::from(layer.depth[index]) < behind * (1.0 - 1e-4) {
                    continue;
                }
            }
            layer.direct[index] *= passing[place];
        }
    }

    /// The part of the lamp's light that reaches each pixel of a tile's still surfaces. Shadows are soft, so a block of pixels whose corners are all
    /// lit alike is lit alike.
    pub(super) fn passing_tile(&self, layer: &Layer, tile: &Tile, casters: &[&Solid<'_>]) -> [f32; TILE * TILE] {
        let (width, wide) = (self.rays.size[0], tile.columns.len());
        let mut passing = [f32::NAN; TILE * TILE];
        let one = |column: usize, row: usize| {
            let depth = layer.depth[row * width + column];
            let direction = self.rays.direction(column, row).unwrap_or_else(Vector3::z);
            (self.passing(&(direction * f64::from(depth)), casters) as f32, depth)
        };
        // Blocks still to be looked at: first row, first column, edge.
        let mut blocks: Vec<[usize; 3]> = Vec::with_capacity(8);
        for top in tile.rows.clone().step_by(BLOCK) {
            blocks.extend(tile.columns.clone().step_by(BLOCK).map(|left| [top, left, BLOCK]));
        }
        while let Some([top, left, edge]) = blocks.pop() {
            let (bottom, right) = ((top + edge).min(tile.rows.end), (left + edge).min(tile.columns.end));
            let corners = [one(left, top), one(right - 1, top), one(left, bottom - 1), one(right - 1, bottom - 1)];
            let (first, depth) = corners[0];
            let alike = corners.iter().all(|c| (c.0 - first).abs() < 2e-3 && (c.1 - depth).abs() < 0.05 * depth);
            if !alike && edge == BLOCK {
                let half = BLOCK / 2;
                let places = [(top, left), (top, left + half), (top + half, left), (top + half, left + half)];
                let inside = places.into_iter().filter(|(row, column)| *row < bottom && *column < right);
                blocks.extend(inside.map(|(row, column)| [row, column, half]));
                continue;
            }
            for row in top..bottom {
                for column in left..right {
                    let place = (row - tile.rows.start) * wide + column - tile.columns.start;
                    passing[place] = if alike { first } else { one(column, row).0 };
                }
            }
        }
        passing
    }

    /// A ball around all that a tile shows.
    pub(super) fn extent(&self, layer: &Layer, tile: &Tile) -> Option<(Vector3<f64>, f64)> {
        let (mut low, mut high) = (f64::INFINITY, 0.0f64);
        for row in tile.rows.clone() {
            let start = row * self.rays.size[0];
            for depth in &layer.depth[start + tile.columns.start..start + tile.columns.end] {
                let depth = f64::from(*depth);
                if depth > 0.0 && depth < 1e5 {
                    (low, high) = (low.min(depth), high.max(depth));
                }
            }
        }
        (high > 0.0).then(|| (tile.axis * (0.5 * (low + high)), 0.5 * (high - low) + high * tile.tangent))
    }
}
