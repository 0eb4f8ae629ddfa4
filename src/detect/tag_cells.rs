//! The printed cells of a tag, from OpenCV's dictionaries.

use ::opencv::core::{Mat, Ptr};
use ::opencv::prelude::*;
use ::opencv::{aruco, core};

use super::{DetectError, Dictionary};

/// The cells of a tag as printed, row by row from the top left, border included: whether each is white.
///
/// # Errors
/// [`DetectError::Library`] if the dictionary has no such tag.
pub fn tag_cells(dictionary: Dictionary, id: u32) -> Result<Vec<bool>, DetectError> {
    let side = dictionary.cells_per_side();
    let failed = |words: String| DetectError::Library { detector: "opencv", doing: "drawing a tag", words };
    let draw = || -> ::opencv::Result<Vec<u8>> {
        let family: Ptr<aruco::Dictionary> = aruco::get_predefined_dictionary_i32(dictionary as i32)?;
        let mut drawn = Mat::default();
        aruco::draw_marker(&family, i32::try_from(id).unwrap_or(-1), side as i32, &mut drawn, 1)?;
        // AprilRobotics prints its families turned by half a turn against OpenCV.
        let mut turned = Mat::default();
        let upright = if dictionary.is_april_tag() {
            core::rotate(&drawn, &mut turned, core::ROTATE_180)?;
            turned
        } else {
            drawn
        };
        Ok(upright.data_bytes()?.to_vec())
    };
    let grey = draw().map_err(|error| failed(error.to_string()))?;
    if grey.len() != side * side {
        return Err(failed(format!("tag {id} of {dictionary} came out with {} cells", grey.len())));
    }
    Ok(grey.into_iter().map(|value| value > 127).collect())
}
