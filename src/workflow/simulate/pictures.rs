//! The pictures of a simulated recording, rendered in parallel.

use rand::Rng;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::Prepared;
use crate::layout::images::ImagePattern;
use crate::layout::simulate::PictureSettings;
use crate::simulate::Simulated;
use crate::simulate::random::{Purpose, stream};
use crate::simulate::render::{Exposure, Look, PictureFormat, Scene, encode, render};
use crate::workflow::detect::Watch;

/// How a picture is taken; the camera shakes along `direction` (rad).
fn exposure(settings: &PictureSettings, direction: f64) -> Exposure {
    let (sin, cos) = direction.sin_cos();
    // About half of a camera's noise on white paper comes with the light.
    let part = std::f64::consts::FRAC_1_SQRT_2 * settings.noise;
    Exposure {
        gain: settings.exposure,
        defocus: settings.blur,
        motion: [settings.motion_blur * cos, settings.motion_blur * sin],
        read_noise: part,
        shot_noise: part,
        vignetting: settings.vignetting,
        ..Exposure::default()
    }
}

/// Renders every picture that exists; returns how many there are.
pub(super) fn write_pictures(
    folder: &Path,
    prepared: &Prepared,
    simulated: &Simulated,
    watch: &Watch<'_>,
) -> std::io::Result<usize> {
    let cell = simulated.cell();
    let look = &prepared.layout.simulate.picture;
    let seed = prepared.request.seed;
    let scene = Scene::new(&cell, &if look.clutter { Look::full(seed) } else { Look::plain(seed) });
    let missing: std::collections::BTreeSet<_> = simulated.missing.iter().copied().collect();
    let mut work = Vec::new();
    let mut patterns: BTreeMap<usize, (ImagePattern, PictureFormat)> = BTreeMap::new();
    for (camera, (described, format)) in prepared.layout.cameras.iter().zip(&prepared.formats).enumerate() {
        let pattern = described.images.as_deref().and_then(|text| ImagePattern::parse(text).ok());
        let (Some(pattern), Some(format)) = (pattern, format) else { continue };
        patterns.insert(camera, (pattern, *format));
        for &configuration in &simulated.configurations {
            for shot in 0..prepared.layout.simulate.shots {
                if !missing.contains(&(camera, configuration, shot)) {
                    work.push((camera, configuration, shot));
                }
            }
        }
    }
    let done = AtomicUsize::new(0);
    let one = |&(camera, configuration, shot): &(usize, u64, u64)| -> std::io::Result<usize> {
        if watch.stop.load(Ordering::Relaxed) {
            return Ok(0);
        }
        let Some((pattern, format)) = patterns.get(&camera) else { return Ok(0) };
        let mut random = stream(seed, Purpose::Picture, [camera as u64, configuration, shot]);
        let exposure = exposure(look, random.random_range(0.0..std::f64::consts::TAU));
        let Some(picture) = render(&cell, &scene, camera, configuration, shot, &exposure) else { return Ok(0) };
        let path = pattern.path(folder, configuration, shot);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent)?;
        }
        std::fs::write(path, encode(&picture, *format)?)?;
        (watch.progress)(done.fetch_add(1, Ordering::Relaxed) + 1, work.len());
        Ok(1)
    };
    work.par_iter().map(one).collect::<std::io::Result<Vec<usize>>>().map(|counts| counts.iter().sum())
}
