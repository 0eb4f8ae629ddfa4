//! The corners of a square tag, from straight lines along its four sides.
//!
//! Why not look at the corner itself, as everyone's first attempt does? A corner is a few pixels
//! large, blur rounds it off *inwards*, and any method that looks there is pulled towards the tag's
//! centre: 0.28 px with OpenCV's `SUBPIX`, in every picture alike, so that the tag seems smaller and
//! farther than it is and no number of pictures helps. A side is fifty pixels long and blur, being
//! symmetric, does not move it. So the sides are measured where they are straight, away from the
//! corners, and the corners are where the lines meet.
//!
//! Lines are straight only to a perfect lens. Given a [`Lens`], the sides are straight in undistorted
//! coordinates: there the lines are drawn and crossed; the pixels are measured as they are, against
//! the curve that the line becomes in the picture.
//!
//! A camera that does not answer to light in proportion moves edges: `edge_tone` finds by how much, best from all tags of a picture at once.
//!
//! A corner comes with its covariance, from the scatter of its own two lines, or with the reason why
//! it could not be measured. It is never passed on unrefined.

use super::all_cells::{self, Measured, Start};
use super::edge_behind::Behind;
use super::edge_fit::SideFit;
use super::edge_side::{Bend, Side};
use super::edge_stations::{Profile, Stations};
use super::edge_tone::{Shift, Tone};
use super::known_lines::KnownLines;
use super::known_tag::Fit;
use super::lens::Bender;
pub use super::lens::Lens;
use super::picture::GreyPicture;
use super::projection::{Projection, cross};
pub use super::refinement::{Refinement, Weakness};

/// Standard deviation in px, along the worst direction, above which a corner is weak.
pub const LARGEST_DEVIATION: f64 = 0.5;
/// Error of a line in px that its own scatter cannot show, since it bends all stations alike.
const LINE_FLOOR: f64 = 0.003;
/// A first idea of the edges' blur, px.
const USUAL_BLUR: f64 = 0.9;
/// Cells of so many blurs or more let nothing shine through their border that the lines do not allow for.
const CLEAR: f64 = 4.5;
/// Exact fits of a tag's sides, at most.
const MOST_PASSES: usize = 3;
/// Tones that are tried, at most.
const MOST_TONES: usize = 3;

/// A tag that was found and is to be measured.
#[derive(Debug, Clone, Copy)]
pub struct RoughTag<'a> {
    /// Its corners in order around it, either way.
    pub corners: [[f64; 2]; 4],
    /// Cells along the edge that is measured (8 for a 6x6 dictionary with its border on both ends): the
    /// border is one cell wide, and so at least is the margin around it.
    pub cells_per_side: usize,
    /// Whether the border is bright and what is around it dark.
    pub bright_inside: bool,
    /// Whether the corners are within half a pixel; else they may be several pixels off.
    pub close: bool,
    /// Whether each cell within the edge has the shade of the margin: row by row from the first corner, the second one being at the end
    /// of the first row. Where cells are small they shine through the border, which can be allowed for if they are known.
    pub cells: Option<&'a [bool]>,
}

/// Measures the four corners of a tag; answers in the order of its corners.
///
/// About 40 us for a tag of 70 px that was found closely. Where its cells are only a few blurs wide or a side cannot be measured, and the cells are
/// known, all of them are fitted at once: about three times as long.
#[must_use]
pub fn refine_tag(picture: &GreyPicture, lens: Option<&dyn Lens>, tag: &RoughTag<'_>) -> [Refinement; 4] {
    let [corners] = refine_tags(picture, lens, &[*tag])[..] else {
        return [Refinement::Weak(Weakness::TooFewEdges); 4];
    };
    corners
}

/// Measures the corners of all tags of a picture; answers in the order of the tags. Better than one by one, since they share the camera's tone.
#[must_use]
pub fn refine_tags(picture: &GreyPicture, lens: Option<&dyn Lens>, tags: &[RoughTag<'_>]) -> Vec<[Refinement; 4]> {
    measure_tags(picture, lens, tags, false).into_iter().map(|(corners, _)| corners).collect()
}

/// The same; with `keep` also what of their fits holds in other pictures that show the same.
pub(super) fn measure_tags(
    picture: &GreyPicture,
    lens: Option<&dyn Lens>,
    tags: &[RoughTag<'_>],
    keep: bool,
) -> Vec<Measured> {
    let bender = Bender(lens);
    let mut stations = Stations::default();
    let start = Profile { blur: USUAL_BLUR, tone: 0.0 };
    let mut lines: Vec<_> = tags.iter().map(|tag| lines(picture, &bender, tag, start, &mut stations)).collect();
    let mut tone = Tone::of(0.0, lines.iter().flatten().filter_map(|lines| lines.shift));
    for _ in 0..MOST_TONES {
        // A shift takes away what is lopsided only on average; much of it is better put into the edges' profile.
        let Some(better) = tone.better() else { break };
        for (tag, lines) in tags.iter().zip(&mut lines) {
            if let Ok(clear) = lines
                && clear.clear
            {
                *lines = clear.again(picture, &bender, tag, better, &mut stations);
            }
        }
        tone = Tone::of(better, lines.iter().flatten().filter_map(|lines| lines.shift));
    }
    let measured = tags.iter().zip(&lines).map(|(tag, lines)| {
        let corrected = lines.as_ref().map_err(|weakness| *weakness).and_then(|lines| lines.corners(&bender, &tone));
        if let (Ok(lines), Ok(corners)) = (lines, &corrected)
            && lines.clear
            && corners.iter().all(|corner| matches!(corner, Refinement::Refined { .. }))
        {
            let kept = keep.then(|| KnownLines::of(lines, picture, &bender, tag, &mut stations)).and_then(Result::ok);
            return (*corners, kept.map(Fit::Lines));
        }
        let start = lines.as_ref().map_or(Start { ideal: None, blur: USUAL_BLUR }, Lines::start);
        all_cells::corners(picture, &bender, tag, &start, keep)
            .or_else(|_| corrected.map(|corners| (corners, None)))
            .unwrap_or_else(|weakness| ([Refinement::Weak(weakness); 4], None))
    });
    measured.collect()
}

/// Measures the four corners of a tag of which only rough corners are known.
///
/// # Arguments
/// * `rough` - its corners in order around it, either way, each within a few pixels of the truth.
/// * `cells_per_side` - as in [`RoughTag`].
#[must_use]
pub fn refine_quad(
    picture: &GreyPicture,
    lens: Option<&dyn Lens>,
    rough: [[f64; 2]; 4],
    cells_per_side: usize,
) -> [Refinement; 4] {
    let tag = RoughTag { corners: rough, cells_per_side, bright_inside: false, close: false, cells: None };
    refine_tag(picture, lens, &tag)
}

/// What the lines say.
#[derive(Debug)]
pub(super) struct Lines {
    pub rough: [[f64; 2]; 4],
    pub sides: [Side; 4],
    pub fits: [Result<SideFit, Weakness>; 4],
    /// What the edges were fitted with.
    pub expected: Profile,
    /// Where they meet, ideal pixels.
    pub ideal: [[f64; 2]; 4],
    blur: f64,
    /// Whether all sides are measured and nothing shines through.
    clear: bool,
    /// How far the camera's tone moves the edges, by this tag alone.
    shift: Option<Shift>,
}

fn lines(
    picture: &GreyPicture,
    bender: &Bender<'_>,
    tag: &RoughTag<'_>,
    expected: Profile,
    stations: &mut Stations,
) -> Result<Lines, Weakness> {
    let rough = tag.corners;
    let mut corners = rough;
    let mut ideal = bender.undistort_all(rough)?;
    let Profile { mut blur, tone } = expected;
    if !tag.close {
        let sides = build_sides(bender, corners, ideal, tag)?;
        let fits = [0, 1, 2, 3].map(|side: usize| sides[side].fit_roughly(picture));
        // A refused move is no loss: the exact fit judges for itself.
        if let Ok(moved) = meet(bender, &sides, &fits, ideal) {
            ideal = moved;
            corners = bender.distort_all(ideal)?;
        }
    }
    let mut pass = 1;
    loop {
        let sides = build_sides(bender, corners, ideal, tag)?;
        let fits = [0, 1, 2, 3].map(|side: usize| {
            let neighbours = [&sides[(side + 3) % 4], &sides[(side + 1) % 4]];
            sides[side].fit(picture, neighbours, Profile { blur, tone }, stations)
        });
        let found = fits.map(Result::ok);
        ideal = meet(bender, &sides, &found, ideal)?;
        let before = corners;
        corners = bender.distort_all(ideal)?;
        let (count, sum) = found.iter().flatten().fold((0.0, 0.0), |(count, sum), fit| (count + 1.0, sum + fit.blur));
        let assumed = blur;
        if count > 0.0 {
            blur = sum / count;
        }
        // Once more if the sides were not where they were looked for, or the blur was not what the gates were made for.
        let moved =
            (0..4).map(|k| (corners[k][0] - before[k][0]).hypot(corners[k][1] - before[k][1])).fold(0.0, f64::max);
        if pass == MOST_PASSES || (moved < 0.3 && blur < 1.3 * assumed) {
            let thinnest = sides.iter().flat_map(|side| side.inner_cell).fold(f64::MAX, f64::min);
            let clear = thinnest > CLEAR * blur && fits.iter().all(Result::is_ok);
            let shift = if clear { Shift::of_tag(picture, bender, tag, ideal, &fits, tone, stations) } else { None };
            let expected = Profile { blur: assumed, tone };
            return Ok(Lines { rough, sides, fits, expected, ideal, blur, clear, shift });
        }
        pass += 1;
    }
}

impl Lines {
    /// Where the fit of all cells begins.
    fn start(&self) -> Start {
        Start { ideal: Some(self.ideal), blur: self.blur }
    }

    /// The same with a better tone.
    fn again(
        &self,
        picture: &GreyPicture,
        bender: &Bender<'_>,
        tag: &RoughTag<'_>,
        tone: f64,
        stations: &mut Stations,
    ) -> Result<Self, Weakness> {
        let near = RoughTag { corners: bender.distort_all(self.ideal)?, close: true, ..*tag };
        let found = lines(picture, bender, &near, Profile { blur: self.blur, tone }, stations)?;
        Ok(Self { rough: self.rough, ..found })
    }

    /// The corners, the tone's shift taken away.
    fn corners(&self, bender: &Bender<'_>, tone: &Tone) -> Result<[Refinement; 4], Weakness> {
        let shift = tone.shift(self.shift);
        let fits = self.fits.map(|fit| fit.map(|fit| shift.taken_from(fit)));
        let pixels = bender.distort_all(meet(bender, &self.sides, &fits.map(Result::ok), self.ideal)?)?;
        let [a, b, c, d] = &self.sides;
        Ok(judged(self.rough, pixels, [a, b, c, d], &fits))
    }
}

/// The last word on the corners where the sides' lines meet.
pub(super) fn judged(
    rough: [[f64; 2]; 4],
    pixels: [[f64; 2]; 4],
    sides: [&Side; 4],
    fits: &[Result<SideFit, Weakness>; 4],
) -> [Refinement; 4] {
    [0, 1, 2, 3].map(|corner: usize| {
        let before = (corner + 3) % 4;
        match (&fits[before], &fits[corner]) {
            (Err(weakness), _) | (_, Err(weakness)) => Refinement::Weak(*weakness),
            (Ok(first), Ok(second)) => {
                judge(rough[corner], pixels[corner], [sides[before], sides[corner]], [first, second])
            }
        }
    })
}

/// The last word on one corner: `first` is the side that ends there, `second` the one that begins.
fn judge(rough: [f64; 2], pixel: [f64; 2], sides: [&Side; 2], fits: [&SideFit; 2]) -> Refinement {
    let shortest = sides[0].length.min(sides[1].length);
    if (pixel[0] - rough[0]).hypot(pixel[1] - rough[1]) > (0.15 * shortest).max(3.0) {
        return Refinement::Weak(Weakness::MovedTooFar);
    }
    // A shift of the corner moves along both normals: N shift = (e1, e2), so
    // covariance = N^-1 diag(v1, v2) N^-T.
    let variances = [
        fits[0].variance_at(sides[0].length)
            + unseen(sides[0].inner_cell[1].min(sides[0].outer_cell[1]), fits[0].blur).powi(2),
        fits[1].variance_at(0.0) + unseen(sides[1].inner_cell[0].min(sides[1].outer_cell[0]), fits[1].blur).powi(2),
    ];
    let (a, b) = (sides[0].outward, sides[1].outward);
    let determinant = a[0] * b[1] - a[1] * b[0];
    let first = [b[1] / determinant, -b[0] / determinant];
    let second = [-a[1] / determinant, a[0] / determinant];
    let covariance = [
        first[0] * first[0] * variances[0] + second[0] * second[0] * variances[1],
        first[0] * first[1] * variances[0] + second[0] * second[1] * variances[1],
        first[1] * first[1] * variances[0] + second[1] * second[1] * variances[1],
    ];
    believe(pixel, covariance)
}

/// A corner, unless it is known too badly.
pub(super) fn believe(pixel: [f64; 2], covariance: [f64; 3]) -> Refinement {
    // The larger eigenvalue.
    let mean = (covariance[0] + covariance[2]) / 2.0;
    let worst = mean + ((covariance[0] - covariance[2]) / 2.0).hypot(covariance[1]);
    if worst.is_nan() || worst > LARGEST_DEVIATION.powi(2) {
        return Refinement::Weak(Weakness::TooUncertain);
    }
    Refinement::Refined { pixel, covariance }
}

/// Error of a line, px, that its own scatter does not show.
///
/// A cell that is only a few blurs wide lets the data cells behind the border shine through to the edge, and
/// where white cells come in groups so do the errors. The size is a guess, checked on rendered tags: right up to
/// a blur of 1.1 px, still too small at 1.5 px (normalised squared error 2.1).
fn unseen(cell: f64, blur: f64) -> f64 {
    LINE_FLOOR + 0.1 * blur * ((4.0 - cell / blur) / 2.0).clamp(0.0, 1.0).powi(2)
}

/// The four sides through corners known in the picture and in ideal coordinates.
fn build_sides(
    bender: &Bender<'_>,
    corners: [[f64; 2]; 4],
    ideal: [[f64; 2]; 4],
    tag: &RoughTag<'_>,
) -> Result<[Side; 4], Weakness> {
    let winding = winding(corners).ok_or(Weakness::NotAQuadrangle)?;
    let unit = Projection::from_unit_square(corners).ok_or(Weakness::NotAQuadrangle)?;
    let cell = 1.0 / tag.cells_per_side.max(3) as f64;
    let mut sides = Vec::with_capacity(4);
    for side in 0..4 {
        let (start, end) = (corners[side], corners[(side + 1) % 4]);
        let length = (end[0] - start[0]).hypot(end[1] - start[1]);
        let along = [(end[0] - start[0]) / length, (end[1] - start[1]) / length];
        let outward = [along[1] * winding, -along[0] * winding];
        let outside = |point: [f64; 2]| (point[0] - start[0]) * outward[0] + (point[1] - start[1]) * outward[1];
        // How wide one cell is across this side, near both of its ends.
        let width = |place: f64, depth: f64| outside(unit.map(Projection::on_side(side, place, depth))).abs();
        let bend = if bender.0.is_some() {
            let (from, to) = (ideal[side], ideal[(side + 1) % 4]);
            let mut points = [[0.0; 2]; 5];
            for (step, point) in points.iter_mut().enumerate() {
                let t = step as f64 / 4.0;
                let bent = bender.distort([from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])])?;
                *point = [(bent[0] - start[0]) * along[0] + (bent[1] - start[1]) * along[1], outside(bent)];
            }
            Some(Bend::through(points))
        } else {
            None
        };
        let (inner_cell, outer_cell) = ([width(0.1, cell), width(0.9, cell)], [width(0.1, -cell), width(0.9, -cell)]);
        let behind = tag.cells.and_then(|cells| Behind::of(&unit, side, tag.cells_per_side, cells));
        let bright_inside = tag.bright_inside;
        sides.push(Side { start, along, outward, length, bend, inner_cell, outer_cell, bright_inside, behind });
    }
    sides.try_into().map_err(|_| Weakness::NotAQuadrangle)
}

/// Moves each side by its fit (a side without one stays) and crosses neighbours, in ideal coordinates.
fn meet(
    bender: &Bender<'_>,
    sides: &[Side; 4],
    fits: &[Option<SideFit>; 4],
    ideal: [[f64; 2]; 4],
) -> Result<[[f64; 2]; 4], Weakness> {
    let mut lines = [[[0.0; 2]; 2]; 4];
    for side in 0..4 {
        lines[side] = match &fits[side] {
            None => [ideal[side], ideal[(side + 1) % 4]],
            Some(fit) => {
                let moved = |u: f64| bender.undistort(sides[side].point(u, fit.at(u)));
                [moved(0.0)?, moved(sides[side].length)?]
            }
        };
    }
    let mut met = [[0.0; 2]; 4];
    for corner in 0..4 {
        met[corner] = cross(lines[(corner + 3) % 4], lines[corner]).ok_or(Weakness::NotAQuadrangle)?;
    }
    Ok(met)
}

/// +1 if the corners run clockwise as seen (y down), -1 if the other way; `None` if the quadrangle is
/// not convex or a side is under 4 px.
fn winding(corners: [[f64; 2]; 4]) -> Option<f64> {
    let mut sign = 0.0;
    for corner in 0..4 {
        let [previous, this, next] = [corners[(corner + 3) % 4], corners[corner], corners[(corner + 1) % 4]];
        let (a, b) = ([this[0] - previous[0], this[1] - previous[1]], [next[0] - this[0], next[1] - this[1]]);
        let turn = a[0] * b[1] - a[1] * b[0];
        if turn.is_nan() || b[0].hypot(b[1]) < 4.0 || turn.abs() < 1.0 || turn * sign < 0.0 {
            return None;
        }
        sign = turn.signum();
    }
    Some(sign)
}
