//! Tags by OpenCV from 4.7 on: the module `objdetect`.

use ::opencv::core::{Point2f, ToInputArray, Vector};
use ::opencv::objdetect::{
    ArucoDetector, CornerRefineMethod, DetectorParameters, RefineParameters, get_predefined_dictionary_i32,
};
use ::opencv::prelude::*;

use crate::detect::Dictionary;

/// The last family it has.
pub(super) const LAST: i32 = Dictionary::ArucoMip36h12 as i32;

/// Ids and rough corners of a family's tags.
pub(super) fn find(
    picture: &impl ToInputArray,
    family: i32,
) -> ::opencv::Result<(Vector<i32>, Vector<Vector<Point2f>>)> {
    let family = get_predefined_dictionary_i32(family)?;
    let mut parameters = DetectorParameters::default()?;
    usual_parameters!(parameters, CornerRefineMethod::CORNER_REFINE_NONE);
    // Two tags side by side are not one tag twice until they nearly coincide. At 0.05 and below a tag's cells can keep it from being found (16h5, 7x7).
    parameters.set_min_marker_distance_rate(0.1);
    let detector = ArucoDetector::new(&family, &parameters, RefineParameters::new(10.0, 3.0, true)?)?;
    let (mut ids, mut corners, mut rejected) = (Vector::new(), Vector::new(), Vector::<Vector<Point2f>>::new());
    detector.detect_markers(picture, &mut corners, &mut ids, &mut rejected)?;
    Ok((ids, corners))
}
