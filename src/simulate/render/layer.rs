//! What a camera sees, as light before the lens: still things first, then moving ones before them and their shadows over them.
//!
//! The picture is worked through in tiles. For each, the few bodies that its rays can meet are picked; each pixel then lays their surfaces over each other from near
//! to far by the parts of the pixel they cover.

use nalgebra::Vector3;

use super::face::{Face, Patch};
use super::rays::{Ray, RayTable};
use super::solid::Solid;
use super::texture::Textures;
use super::tile::{TILE, Tile, ball};

/// Most bodies whose surfaces are told apart in one pixel.
const MOST_LAYERS: usize = 24;
/// Light from all around, and from the lamp, that a white surface facing it returns.
const AMBIENT: f64 = 0.48;
const DIRECT: f64 = 0.60;
/// How far behind a still surface (m) a moving one may lie and still be drawn: no more than rounding.
const SLACK: f64 = 1e-4;

/// The lamp, in the camera's frame.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    /// Its place.
    pub place: Vector3<f64>,
    /// Which way is up.
    pub up: Vector3<f64>,
    /// Its radius, m: how soft shadows are.
    pub radius: f64,
    /// The distance (m) at which it has its nominal strength.
    pub nominal: f64,
}

/// What still things send to a camera: the part from all around, the part from the lamp (shadows of still things taken off), and how far away they are (m).
#[derive(Debug)]
pub struct Layer {
    pub(super) ambient: Vec<f32>,
    pub(super) direct: Vec<f32>,
    pub(super) depth: Vec<f32>,
}

/// A camera's view of a cell.
#[derive(Debug)]
pub struct View<'a> {
    /// The lens.
    pub rays: &'a RayTable,
    /// The lamp; `shadows` says whether it casts any.
    pub light: Light,
    /// Whether bodies cast shadows.
    pub shadows: bool,
    /// Floor, ceiling and walls, facing inwards; empty for none.
    pub room: &'a [Face<'a>],
    /// Textures.
    pub textures: &'a Textures,
}

/// One body in one pixel.
#[derive(Clone, Copy)]
struct Fragment {
    depth: f64,
    covered: f64,
    ambient: f64,
    direct: f64,
}

const NOTHING: Fragment = Fragment { depth: f64::INFINITY, covered: 0.0, ambient: 0.0, direct: 0.0 };

/// The bodies of one pixel from near to far.
struct Stack {
    fragments: [Fragment; MOST_LAYERS],
    count: usize,
}

impl Stack {
    fn insert(&mut self, fragment: Fragment) {
        if self.count == MOST_LAYERS {
            return;
        }
        let mut place = self.count;
        while place > 0 && self.fragments[place - 1].depth > fragment.depth {
            self.fragments[place] = self.fragments[place - 1];
            place -= 1;
        }
        self.fragments[place] = fragment;
        self.count += 1;
    }
}

/// A body with those that may stand in its light.
struct Lit<'a> {
    solid: &'a Solid<'a>,
    shaded_by: Vec<&'a Solid<'a>>,
}

impl View<'_> {
    /// Bodies with those that may shade them.
    fn lit<'b>(&self, bodies: &'b [Solid<'b>], casters: &[&'b Solid<'b>]) -> Vec<Lit<'b>> {
        let shades = |solid: &Solid<'b>, caster: &Solid<'b>| {
            let kin = solid.group == caster.group && solid.link.abs_diff(caster.link) < 2;
            !kin && caster.near_shaft(&solid.middle, solid.radius, &self.light.place, self.light.radius)
        };
        let one = |solid: &'b Solid<'b>| {
            let shaded_by = if self.shadows {
                casters.iter().copied().filter(|caster| shades(solid, caster)).collect()
            } else {
                Vec::new()
            };
            Lit { solid, shaded_by }
        };
        bodies.iter().map(one).collect()
    }

    /// The light a white surface returns: from all around and from the lamp.
    fn falling(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> (f64, f64) {
        let ambient = AMBIENT * (0.8 + 0.2 * normal.dot(&self.light.up));
        let to_light = self.light.place - point;
        let squared = to_light.norm_squared();
        let strength = DIRECT * self.light.nominal / squared;
        (ambient, (strength * normal.dot(&to_light)).max(0.0))
    }

    /// The bodies a tile's rays can meet, each with those that may shade the part of it that the tile shows.
    fn pick<'b>(&self, lit: &[Lit<'b>], tile: &Tile) -> Vec<Lit<'b>> {
        let corner = |column: usize, row: usize| self.rays.direction(column, row);
        let (left, right) = (tile.columns.start, tile.columns.end - 1);
        let (top, bottom) = (tile.rows.start, tile.rows.end - 1);
        let corners = match (corner(left, top), corner(right, top), corner(right, bottom), corner(left, bottom)) {
            (Some(a), Some(b), Some(c), Some(d)) if left < right && top < bottom => Some([a, b, c, d]),
            _ => None,
        };
        let near = lit.iter().filter(|lit| {
            lit.solid.near_cone(&tile.axis, tile.tangent) && !corners.is_some_and(|corners| lit.solid.misses(&corners))
        });
        near.map(|lit| {
            let mut shaded_by = lit.shaded_by.clone();
            if !shaded_by.is_empty()
                && let Some(points) = self.shown(lit.solid, tile)
            {
                let (middle, radius) = ball(&points);
                shaded_by.retain(|c| c.near_shaft(&middle, radius, &self.light.place, self.light.radius));
                self.darken(&points, &mut shaded_by);
            }
            Lit { solid: lit.solid, shaded_by }
        })
        .collect()
    }

    /// Points on a lattice over a tile that a body fills; `None` if it does not.
    fn shown(&self, solid: &Solid<'_>, tile: &Tile) -> Option<[Vector3<f64>; 16]> {
        let mut points = [Vector3::zeros(); 16];
        for (index, point) in points.iter_mut().enumerate() {
            let ray = self.rays.ray(tile.lattice(index)[0], tile.lattice(index)[1])?;
            let mut full = false;
            solid.patches(&ray, self.textures, |patch| {
                full |= patch.covered == 1.0;
                *point = ray.direction * patch.depth;
            });
            if !full {
                return None;
            }
        }
        Some(points)
    }

    /// If one body takes all the light from a whole lattice of points, none of the others matters: bodies are convex, and so are their shadows.
    fn darken<'b>(&self, points: &[Vector3<f64>; 16], casters: &mut Vec<&'b Solid<'b>>) {
        let dark = casters.iter().position(|caster| points.iter().all(|point| self.passing(point, &[caster]) == 0.0));
        if let Some(dark) = dark {
            *casters = vec![casters[dark]];
        }
    }

    fn fragment(&self, lit: &Lit<'_>, ray: &Ray) -> Fragment {
        let mut sum = NOTHING;
        let mut widest = 0.0;
        lit.solid.patches(ray, self.textures, |patch: Patch| {
            if patch.covered <= 0.0 {
                return;
            }
            let point = ray.direction * patch.depth;
            let (ambient, mut direct) = self.falling(&point, &patch.normal);
            if direct > 0.0 && !lit.shaded_by.is_empty() {
                direct *= self.passing(&point, &lit.shaded_by);
            }
            sum.covered += patch.covered;
            sum.ambient += patch.tone * ambient;
            sum.direct += patch.tone * direct;
            if patch.covered > widest {
                widest = patch.covered;
                sum.depth = patch.depth;
            }
        });
        sum.covered = sum.covered.min(1.0);
        sum
    }

    /// The planes of the room that a tile shows.
    fn walls(&self, tile: &Tile) -> &[Face<'_>] {
        let hit = |index: usize| {
            let [column, row] = tile.lattice(index);
            let direction = self.rays.direction(column, row)?;
            let distances = self.room.iter().enumerate().filter_map(|(i, f)| Some((f.distance(&direction)?, i)));
            distances.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, i)| i)
        };
        // The room is convex: what all corners show fills the tile.
        match hit(0) {
            Some(face) if [3, 12, 15].iter().all(|corner| hit(*corner) == Some(face)) => &self.room[face..=face],
            _ => self.room,
        }
    }

    /// Floor, walls and ceiling in a pixel.
    fn backdrop(&self, room: &[Face<'_>], ray: &Ray) -> Fragment {
        let nearest = room.iter().filter_map(|face| Some((face.distance(&ray.direction)?, face)));
        let Some((_, face)) = nearest.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Fragment { depth: 1e6, covered: 1.0, ambient: 0.35 * AMBIENT, direct: 0.0 };
        };
        match face.plane_patch(ray, self.textures) {
            Some(patch) => {
                let (ambient, direct) = self.falling(&(ray.direction * patch.depth), &patch.normal);
                Fragment {
                    depth: patch.depth,
                    covered: 1.0,
                    ambient: patch.tone * ambient,
                    direct: patch.tone * direct,
                }
            }
            None => Fragment { depth: 1e6, covered: 1.0, ambient: 0.2 * AMBIENT, direct: 0.0 },
        }
    }

    /// What still things look like.
    #[must_use]
    pub fn still(&self, bodies: &[Solid<'_>]) -> Layer {
        let count = self.rays.size[0] * self.rays.size[1];
        let mut layer = Layer { ambient: vec![0.0; count], direct: vec![0.0; count], depth: vec![0.0; count] };
        let casters: Vec<&Solid<'_>> = bodies.iter().collect();
        let lit = self.lit(bodies, &casters);
        let mut stack = Stack { fragments: [NOTHING; MOST_LAYERS], count: 0 };
        for tile in self.rays.tiles() {
            let mut near = self.pick(&lit, &tile);
            let room = self.walls(&tile);
            // Most tiles show one body and nothing else; its shadows can wait until all of them is known.
            let fills = near.len() == 1 && self.shown(near[0].solid, &tile).is_some();
            let deferred = if fills { std::mem::take(&mut near[0].shaded_by) } else { Vec::new() };
            for row in tile.rows.clone() {
                for column in tile.columns.clone() {
                    let Some(ray) = self.rays.ray(column, row) else { continue };
                    stack.count = 0;
                    for lit in &near {
                        let fragment = self.fragment(lit, &ray);
                        if fragment.covered > 0.0 {
                            stack.insert(fragment);
                        }
                    }
                    let (mut through, mut ambient, mut direct, mut depth) = (1.0, 0.0, 0.0, f64::INFINITY);
                    for fragment in &stack.fragments[..stack.count] {
                        ambient += through * fragment.ambient;
                        direct += through * fragment.direct;
                        through *= 1.0 - fragment.covered;
                        if depth.is_infinite() && through < 0.5 {
                            depth = fragment.depth;
                        }
                        if through < 1e-6 {
                            break;
                        }
                    }
                    if through >= 1e-6 {
                        let behind = self.backdrop(room, &ray);
                        ambient += through * behind.ambient;
                        direct += through * behind.direct;
                        depth = depth.min(behind.depth);
                    }
                    let index = row * self.rays.size[0] + column;
                    layer.ambient[index] = ambient as f32;
                    layer.direct[index] = direct as f32;
                    layer.depth[index] = depth as f32;
                }
            }
            if self.shadows {
                if fills {
                    self.lay_shadows(&mut layer, &tile, &deferred, None);
                } else {
                    self.lay_shadows(&mut layer, &tile, &casters, Some(room));
                }
            }
        }
        layer
    }

    /// The light that reaches the lens: still things, moving bodies before them and their shadows. Row by row; 1 is white paper in full light.
    #[must_use]
    pub fn compose(&self, layer: &Layer, still: &[Solid<'_>], moving: &[Solid<'_>]) -> Vec<f32> {
        let mut light: Vec<f32> = layer.ambient.iter().zip(&layer.direct).map(|(a, d)| a + d).collect();
        let casters: Vec<&Solid<'_>> = still.iter().chain(moving).collect();
        let lit = self.lit(moving, &casters);
        let mut stack = Stack { fragments: [NOTHING; MOST_LAYERS], count: 0 };
        let mut shading = Vec::new();
        for tile in self.rays.tiles() {
            let near = self.pick(&lit, &tile);
            shading.clear();
            if self.shadows
                && let Some((middle, radius)) = self.extent(layer, &tile)
            {
                let reaches = |s: &&Solid<'_>| s.near_shaft(&middle, radius, &self.light.place, self.light.radius);
                shading.extend(moving.iter().filter(reaches));
            }
            if near.is_empty() && shading.is_empty() {
                continue;
            }
            let passing =
                if shading.is_empty() { [1.0; TILE * TILE] } else { self.passing_tile(layer, &tile, &shading) };
            for row in tile.rows.clone() {
                for column in tile.columns.clone() {
                    let index = row * self.rays.size[0] + column;
                    let Some(ray) = self.rays.ray(column, row) else { continue };
                    let behind = f64::from(layer.depth[index]);
                    stack.count = 0;
                    for lit in &near {
                        let fragment = self.fragment(lit, &ray);
                        if fragment.covered > 0.0 && fragment.depth < behind + SLACK {
                            stack.insert(fragment);
                        }
                    }
                    let (mut through, mut sum) = (1.0, 0.0);
                    for fragment in &stack.fragments[..stack.count] {
                        sum += through * (fragment.ambient + fragment.direct);
                        through *= 1.0 - fragment.covered;
                        if through < 1e-6 {
                            break;
                        }
                    }
                    if through >= 1e-6 {
                        let place = (row - tile.rows.start) * tile.columns.len() + column - tile.columns.start;
                        let direct = f64::from(layer.direct[index] * passing[place]);
                        sum += through * (f64::from(layer.ambient[index]) + direct);
                    }
                    light[index] = sum as f32;
                }
            }
        }
        light
    }
}
