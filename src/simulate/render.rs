//! Pictures of a cell.

use super::cell::Cell;
use super::picture::{PictureNoise, Plate, plates, png};
use crate::detect::GreyPicture;
use crate::layout::simulate::PictureSettings;

/// What does not change between pictures.
#[derive(Clone, Debug, Default)]
pub struct Look {
    pub seed: u64,
    pub clutter: bool,
}
/// A scene.
#[derive(Debug)]
pub struct Scene {
    plates: Vec<Plate>,
    seed: u64,
}
impl Scene {
    /// new
    pub fn new(cell: &Cell<'_>, look: &Look) -> Self {
        Self { plates: plates(cell), seed: look.seed }
    }
}
/// How a picture is spoilt.
#[derive(Clone, Copy, Debug)]
pub struct Exposure {
    blur: f64,
    noise: f64,
}
impl From<PictureSettings> for Exposure {
    fn from(s: PictureSettings) -> Self {
        Self { blur: s.blur, noise: s.noise }
    }
}
/// A file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    Png,
    Jpeg(u8),
    Pgm,
}
/// render
pub fn render(
    cell: &Cell<'_>,
    scene: &Scene,
    camera: usize,
    configuration: u64,
    shot: u64,
    e: &Exposure,
) -> Option<GreyPicture> {
    super::picture::render(
        cell,
        &scene.plates,
        camera,
        configuration,
        PictureNoise { blur: e.blur, grey: e.noise, seed: scene.seed ^ (shot << 50) },
    )
}
/// encode
pub fn encode(picture: &GreyPicture, _format: PictureFormat) -> std::io::Result<Vec<u8>> {
    png(picture)
}
