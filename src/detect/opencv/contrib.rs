//! Tags by OpenCV up to 4.6: the contrib module `aruco`.

use ::opencv::aruco::{CornerRefineMethod, DetectorParameters, detect_markers, get_predefined_dictionary_i32};
use ::opencv::core::{Point2f, Ptr, ToInputArray, Vector};
use ::opencv::prelude::*;

use crate::detect::Dictionary;

/// The last family it has.
pub(super) const LAST: i32 = Dictionary::AprilTag36h11 as i32;

/// Ids and rough corners of a family's tags.
pub(super) fn find(
    picture: &impl ToInputArray,
    family: i32,
) -> ::opencv::Result<(Vector<i32>, Vector<Vector<Point2f>>)> {
    let family = get_predefined_dictionary_i32(family)?;
    let mut parameters = DetectorParameters::default()?;
    usual_parameters!(parameters, CornerRefineMethod::CORNER_REFINE_NONE);
    // Two tags side by side are not one tag twice until they nearly coincide.
    parameters.set_min_marker_distance_rate(0.02);
    let parameters = Ptr::new(parameters);
    let (mut ids, mut corners, mut rejected) = (Vector::new(), Vector::new(), Vector::<Vector<Point2f>>::new());
    detect_markers(picture, &family, &mut corners, &mut ids, &parameters, &mut rejected)?;
    Ok((ids, corners))
}
