//! From a tag that lines do not measure to the fit of all of its cells.

use super::blurred_cells::Cells;
use super::edge_lines::{Refinement, RoughTag, Weakness, believe};
use super::known_tag::Fit;
use super::lens::Bender;
use super::picture::GreyPicture;
use super::whole_tag::{Fitted, IdealCorner, WholeTag};

/// What lines along its sides say of a tag.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    /// Where they meet, ideal pixels, if they do.
    pub ideal: Option<[[f64; 2]; 4]>,
    /// px.
    pub blur: f64,
}

/// Corners, and what of the fit that they are from holds in other pictures that show the same.
pub(super) type Measured = ([Refinement; 4], Option<Fit>);

/// What all cells together say; with `keep` the fit too.
pub(super) fn corners(
    picture: &GreyPicture,
    bender: &Bender<'_>,
    tag: &RoughTag<'_>,
    start: &Start,
    keep: bool,
) -> Result<Measured, Weakness> {
    let finish = |corners: [IdealCorner; 4], fitted: Fitted<'_>| {
        let corners = in_picture(bender, corners)?;
        Ok((corners, if keep { Some(Fit::Cells(Box::new(fitted.linear()?))) } else { None }))
    };
    let whole = whole(bender, tag, start)?;
    let fitted = whole.settle(picture, bender)?;
    let (corners, seen) = fitted.corners()?;
    match whole.with_less_margin(&corners, seen) {
        Some(whole) => {
            let fitted = whole.settle(picture, bender)?;
            finish(fitted.corners()?.0, fitted)
        }
        None => finish(corners, fitted),
    }
}

/// How all cells of a tag are to be fitted.
fn whole<'a>(bender: &Bender<'_>, tag: &RoughTag<'a>, start: &Start) -> Result<WholeTag<'a>, Weakness> {
    let cells = Cells { per_side: tag.cells_per_side, bright: tag.cells.ok_or(Weakness::TooFewEdges)? };
    let ideal = match start.ideal {
        Some(ideal) if !tag.close => ideal,
        _ => bender.undistort_all(tag.corners)?,
    };
    // Without the lens the tag, and its blur with it, is larger or smaller.
    let length = |quad: &[[f64; 2]; 4], k: usize| (quad[k][0] - quad[k ^ 2][0]).hypot(quad[k][1] - quad[k ^ 2][1]);
    let pixels = bender.distort_all(ideal)?;
    let stretch = f64::max(length(&ideal, 0) / length(&pixels, 0), length(&ideal, 1) / length(&pixels, 1));
    Ok(WholeTag { ideal, cells, bright_inside: tag.bright_inside, blur: stretch * start.blur })
}

/// Corners that all cells gave, as the picture has them.
pub(super) fn in_picture(bender: &Bender<'_>, corners: [IdealCorner; 4]) -> Result<[Refinement; 4], Weakness> {
    let mut measured = [Refinement::Weak(Weakness::TooUncertain); 4];
    for (measured, (ideal, covariance)) in measured.iter_mut().zip(corners) {
        *measured = believe(bender.distort(ideal)?, bender.bend(ideal, covariance)?);
    }
    Ok(measured)
}
