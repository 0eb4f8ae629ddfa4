//! Everything about a simulation that can be known before anything is made: poses, formats, folder, room.

use std::path::{Path, PathBuf};

use super::{Prepared, SimulateRequest};
use crate::complaint::{Complaint, InputError};
use crate::geometry::TargetGeometry;
use crate::layout::simulate::PathSource;
use crate::layout::{Layout, Motion, plain};
use crate::simulate::render::PictureFormat;
use crate::simulate::{knowledge, paths};
use crate::workflow::localise::localise;

/// Bytes of a line of corners, whole poses or points, about.
const LINE: u64 = 90;
/// What a disk keeps for others.
const SPARE: u64 = 64 << 20;

/// Checks everything that can be known before anything is made.
///
/// # Errors
/// Poses that are not known, a folder that is not empty, patterns of pictures that cannot be written, a disk without room.
pub fn prepare(mut layout: Layout, request: SimulateRequest) -> Result<Prepared, InputError> {
    let missing = knowledge::missing(&layout);
    if !missing.is_empty() {
        return Err(InputError(missing));
    }
    layout.simulate.configurations = request.configurations.unwrap_or(layout.simulate.configurations);
    layout.simulate.shots = request.shots.unwrap_or(layout.simulate.shots);
    check_folder(&request)?;
    let recorded_path = match layout.simulate.path {
        PathSource::Recorded => true,
        PathSource::Generated => false,
        PathSource::Either => !layout.robots.is_empty() && motion_files(&layout).all(|path| path.exists()),
    };
    if !recorded_path {
        paths::joint_ranges(&layout)?;
    }
    let hides_all = !knowledge::is_marked(&layout);
    let source = layout.clone();
    let copied = localise(&mut layout, request.pictures);
    // The path is read from where the layout says, whatever its files are called in the recording.
    if recorded_path {
        layout.robots.iter_mut().zip(&source.robots).for_each(|(robot, from)| robot.motion = from.motion.clone());
    }
    let formats = if request.pictures { formats(&layout)? } else { vec![None; layout.cameras.len()] };
    let stops = layout.simulate.configurations * layout.simulate.shots;
    let pictures = stops.saturating_mul(formats.iter().flatten().count() as u64);
    let rendered: u64 = layout
        .cameras
        .iter()
        .zip(&formats)
        .filter_map(|(camera, format)| {
            let [width, height] = camera.intrinsics.as_ref()?.size().map(u64::from);
            Some(stops.saturating_mul((width as f64 * height as f64 * bytes_per_pixel((*format)?)) as u64))
        })
        .fold(0, u64::saturating_add);
    let features: u64 = layout.targets.iter().map(|target| feature_count(&target.true_geometry)).sum();
    let instruments = (layout.cameras.len() + layout.sensors.len()) as u64;
    let lines = stops.saturating_mul(features.max(1)).saturating_mul(instruments).saturating_mul(2 * LINE);
    let bytes = rendered.saturating_add(lines);
    check_room(&request.out, bytes)?;
    Ok(Prepared { layout, request, copied, formats, pictures, bytes, recorded_path, hides_all })
}

fn feature_count(geometry: &TargetGeometry) -> u64 {
    match geometry {
        TargetGeometry::None => 1,
        TargetGeometry::Tags(faces) => 4 * faces.len() as u64,
        TargetGeometry::Board { columns, rows, .. } => (columns * rows) as u64,
        TargetGeometry::Points(points) => points.len() as u64,
    }
}

fn motion_files(layout: &Layout) -> impl Iterator<Item = PathBuf> + '_ {
    layout.robots.iter().map(|robot| match &robot.motion {
        Motion::Joints { file, .. } | Motion::FlangePoses { file } => layout.recording.join(file),
    })
}

fn check_folder(request: &SimulateRequest) -> Result<(), Complaint> {
    let out = &request.out;
    let entries = match std::fs::read_dir(out) {
        Ok(mut entries) => entries.next().is_some(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => false,
        Err(error) => {
            return Err(Complaint::of(
                out,
                format!("no recording can be made there: {}", plain(&error)),
                "give another folder with `--out DIR`",
            ));
        }
    };
    if entries && !request.force {
        return Err(Complaint::of(
            out,
            "the folder exists and is not empty",
            "give another with `--out DIR`, or replace the simulation in it with `--force`",
        ));
    }
    Ok(())
}

/// Bytes a pixel of a noisy picture, at most.
fn bytes_per_pixel(format: PictureFormat) -> f64 {
    match format {
        PictureFormat::Png => 0.8,
        PictureFormat::Jpeg(quality) => 0.1 + 0.5 * (f64::from(quality) / 100.0).powi(4),
        PictureFormat::Pgm => 1.0,
    }
}

/// Whether the disk has room for the recording.
fn check_room(out: &Path, bytes: u64) -> Result<(), Complaint> {
    let existing = out.ancestors().find(|folder| !folder.as_os_str().is_empty() && folder.exists());
    let Ok(free) = fs4::available_space(existing.unwrap_or(Path::new("."))) else { return Ok(()) };
    if bytes.saturating_add(SPARE) <= free {
        return Ok(());
    }
    Err(Complaint::of(
        out,
        format!("the recording needs about {} but the disk has {} left", size(bytes), size(free)),
        "make fewer configurations or shots, use JPEG, or give another disk with `--out DIR`",
    ))
}

/// A number of bytes for people.
#[must_use]
pub fn size(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{} kB", bytes.div_ceil(1000)),
        1_000_000..1_000_000_000 => format!("{} MB", bytes / 1_000_000),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

/// The format of every camera's pictures.
fn formats(layout: &Layout) -> Result<Vec<Option<PictureFormat>>, InputError> {
    let mut complaints = Vec::new();
    let mut formats = Vec::new();
    for camera in &layout.cameras {
        let (Some(images), Some(_)) = (&camera.images, &camera.intrinsics) else {
            formats.push(None);
            continue;
        };
        let mut complain =
            |what: String, remedy: &str| complaints.push(Complaint::at(&layout.file, camera.line, what, remedy));
        let ending = Path::new(images).extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let format = match ending.as_str() {
            "png" => Some(PictureFormat::Png),
            "jpg" | "jpeg" => Some(PictureFormat::Jpeg(layout.simulate.picture.jpeg_quality)),
            "pgm" => Some(PictureFormat::Pgm),
            _ => {
                let what = format!("pictures of camera `{}` would be of kind `{ending}`", camera.name);
                complain(what, "the simulator writes `.png`, `.jpg` and `.pgm`");
                None
            }
        };
        if layout.simulate.shots > 1 && !images.contains("{shot") {
            let what = format!(
                "camera `{}` takes {} shots but its `images` have no `{{shot}}`",
                camera.name, layout.simulate.shots
            );
            complain(what, "write for example `images/left/{configuration:04}_{shot:02}.png`");
        }
        formats.push(format);
    }
    if complaints.is_empty() { Ok(formats) } else { Err(InputError(complaints)) }
}
