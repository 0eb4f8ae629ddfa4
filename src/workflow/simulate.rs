//! `simulate`: a layout whose poses are known becomes a recording in ordinary files, with its truth.

use rand::Rng;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use super::detect::Watch;
use super::localise::{Copied, localise};
use crate::complaint::{Complaint, InputError};
use crate::geometry::TargetGeometry;
use crate::layout::images::ImagePattern;
use crate::layout::simulate::{PathSource, PictureSettings};
use crate::layout::write::sections;
use crate::layout::{Document, Layout, Motion, Paths, plain};
use crate::recording::write::{write_motions, write_points, write_target_poses};
use crate::recording::{DEFAULT_DETECTIONS, Recording, RobotMotion, atomic, write_detections, write_exact_detections};
use crate::simulate::random::{Purpose, stream};
use crate::simulate::render::{Exposure, Look, PictureFormat, Scene, encode, render};
use crate::simulate::{CornerNoise, Simulated, corners, knowledge, paths, simulate};

/// What to simulate.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulateRequest {
    /// The folder of the recording that is made.
    pub out: PathBuf,
    /// The same seed gives the same files.
    pub seed: u64,
    /// Render pictures; the corners are then for a detector to find.
    pub pictures: bool,
    /// Replace what an earlier simulation left in the folder.
    pub force: bool,
    /// Multiplies every standard deviation of the measurements.
    pub noise: f64,
    /// In the place of the layout's number.
    pub configurations: Option<u64>,
    /// In the place of the layout's number.
    pub shots: Option<u64>,
}

/// A simulation that has been checked and can begin.
#[derive(Debug)]
pub struct Prepared {
    layout: Layout,
    request: SimulateRequest,
    copied: Vec<Copied>,
    formats: Vec<Option<PictureFormat>>,
    /// Pictures that will be rendered at most.
    pub pictures: u64,
    /// Bytes that the recording will need, about.
    pub bytes: u64,
    /// Whether the robots' own files are the path.
    pub recorded_path: bool,
    /// Whether every pose is hidden because the layout marks none as unknown.
    pub hides_all: bool,
}

/// What was made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Made {
    /// Configurations.
    pub configurations: usize,
    /// Pictures rendered.
    pub pictures: usize,
    /// Corners measured; none where pictures were rendered.
    pub corners: usize,
    /// Whole poses measured.
    pub poses: usize,
    /// Points measured.
    pub points: usize,
    /// Cameras that never see anything.
    pub blind: Vec<String>,
    /// Targets that no camera ever sees.
    pub unseen: Vec<String>,
    /// What was spoilt on purpose, in words.
    pub spoilt: Vec<String>,
    /// Whether the caller stopped it; nothing was then written.
    pub interrupted: bool,
}

/// The file in which a simulated recording keeps what is true.
pub const TRUTH: &str = "truth.yaml";
/// The layout that a solver is told.
pub const LAYOUT: &str = "layout.yaml";
/// Where every corner really is.
const TRUE_CORNERS: &str = "true_corners.csv";
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

/// Makes the recording: all of it, or nothing.
///
/// # Errors
/// Faults of a recorded path, a path that cannot be found, a cell in which nothing is ever seen, a folder that cannot be written to.
pub fn make(prepared: &Prepared, watch: &Watch<'_>) -> Result<Made, InputError> {
    let Prepared { layout, request, .. } = prepared;
    let settings = &layout.simulate;
    let truth_for_path = knowledge::truth(layout, request.seed);
    let motions = if prepared.recorded_path {
        recorded(layout, settings.configurations, request.configurations.is_some())?
    } else {
        paths::generate(&truth_for_path, settings.configurations, request.seed)?
    };
    let simulated = simulate(layout, motions, request.seed, request.noise)?;
    let mut made = summary(layout, &simulated);
    if simulated.recording.corners.is_empty() && made.poses == 0 && made.points == 0 {
        return Err(Complaint::of(
            &layout.file,
            "in this cell nothing is ever seen: no camera sees a target at any configuration",
            "check the cameras' poses (x right, y down, z forward), and the targets' faces (z out of a tag)",
        )
        .into());
    }
    let failed = |error: std::io::Error| -> InputError {
        let what = format!("the recording cannot be written: {error}");
        Complaint::of(&request.out, what, "give another folder with `--out DIR`").into()
    };
    let parent = request.out.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(parent).map_err(failed)?;
    let folder = tempfile::Builder::new().prefix(".cellmap-simulate-").tempdir_in(parent).map_err(failed)?;
    write_files(folder.path(), prepared, &simulated).map_err(failed)?;
    if request.pictures {
        made.corners = 0;
        made.pictures = write_pictures(folder.path(), prepared, &simulated, watch).map_err(failed)?;
    }
    if watch.stop.load(Ordering::Relaxed) {
        return Ok(Made { interrupted: true, ..made });
    }
    put_in_place(folder, &request.out).map_err(failed)?;
    Ok(made)
}

/// The robots' own files as the path, the first `count` configurations of it if that was asked for.
fn recorded(layout: &Layout, count: u64, limited: bool) -> Result<Vec<RobotMotion>, InputError> {
    let mut motions = Recording::read_motion(layout)?.motions;
    if limited {
        for motion in &mut motions {
            let last = motion.configurations().get(count as usize).copied();
            match (motion, last) {
                (RobotMotion::Joints(values), Some(last)) => values.retain(|configuration, _| *configuration < last),
                (RobotMotion::Flange(poses), Some(last)) => poses.retain(|configuration, _| *configuration < last),
                _ => {}
            }
        }
    }
    if layout.simulate.joints.is_empty() {
        return Ok(motions);
    }
    let ranges = paths::joint_ranges(layout)?;
    for ((robot, motion), ranges) in layout.robots.iter().zip(&motions).zip(&ranges) {
        let RobotMotion::Joints(values) = motion else { continue };
        for (configuration, joints) in values {
            let outside = joints.iter().zip(ranges).position(|(q, [least, most])| q < least || q > most);
            if let Some(joint) = outside {
                return Err(Complaint::at(
                    &layout.file,
                    robot.line,
                    format!(
                        "configuration {configuration} cannot be reached: joint {} of robot `{}` is outside its range",
                        joint + 1,
                        robot.name
                    ),
                    "mend the path, or the ranges in `simulate: {joints: ...}`",
                )
                .into());
            }
        }
    }
    Ok(motions)
}

fn summary(layout: &Layout, simulated: &Simulated) -> Made {
    let recording = &simulated.recording;
    let seen_by = |camera: usize| {
        recording.corners.iter().any(|row| row.camera == camera)
            || recording.poses.iter().any(|row| row.camera == camera)
    };
    let seen = |target: usize| {
        recording.corners.iter().any(|row| row.target == target)
            || recording.poses.iter().any(|row| row.target == target)
            || recording.points.iter().any(|row| row.target == target)
    };
    let cameras = layout.cameras.iter().enumerate().filter(|(i, _)| !seen_by(*i));
    let targets = layout.targets.iter().enumerate().filter(|(i, _)| !seen(*i));
    Made {
        configurations: simulated.configurations.len(),
        corners: recording.corners.len(),
        poses: recording.poses.len(),
        points: recording.points.len(),
        blind: cameras.map(|(_, camera)| camera.name.clone()).collect(),
        unseen: targets.map(|(_, target)| target.name.clone()).collect(),
        spoilt: simulated.spoilt.clone(),
        ..Made::default()
    }
}

fn write_files(folder: &Path, prepared: &Prepared, simulated: &Simulated) -> std::io::Result<()> {
    let Prepared { request, copied, .. } = prepared;
    for file in copied {
        let to = folder.join(&file.name);
        if let Some(parent) = to.parent() {
            std::fs::create_dir_all(parent)?;
        }
        std::fs::copy(&file.from, to)?;
    }
    let (mut truth, mut told) = (simulated.truth.clone(), simulated.told.clone());
    for layout in [&mut truth, &mut told] {
        layout.file = folder.join(LAYOUT);
        layout.recording = folder.to_owned();
        // Names of motion files may have been those of a path that was read from elsewhere.
        let _ = localise(layout, false);
        let observed = &mut layout.observations;
        let measured = &simulated.recording;
        let name = |there: bool, name: &str| if there { vec![name.to_owned()] } else { Vec::new() };
        observed.detections = name(!measured.corners.is_empty(), DEFAULT_DETECTIONS);
        observed.target_poses = name(!measured.poses.is_empty(), "target_poses.csv");
        observed.points = name(!measured.points.is_empty(), "points.csv");
        observed.contacts.clear();
    }
    write_motions(folder, &told, &simulated.logged)?;
    let recording = &simulated.recording;
    if !recording.corners.is_empty() {
        if !request.pictures {
            let write = if request.noise == 0.0 { write_exact_detections } else { write_detections };
            write(&folder.join(DEFAULT_DETECTIONS), &told, &recording.corners)?;
        }
        let exact = corners(&simulated.cell(), &simulated.configurations, CornerNoise { pixel_sigma: 0.0, seed: 0 });
        write_exact_detections(&folder.join(TRUE_CORNERS), &truth, &exact)?;
    }
    if !recording.poses.is_empty() {
        write_target_poses(&folder.join("target_poses.csv"), &told, &recording.poses)?;
    }
    if !recording.points.is_empty() {
        write_points(&folder.join("points.csv"), &told, &recording.points)?;
    }
    let seed = request.seed;
    let heads = [
        (
            TRUTH,
            &truth,
            format!(
                "# What is true of this simulated recording (seed {seed}). `cellmap compare` holds a solution against it."
            ),
        ),
        (LAYOUT, &told, format!("# What a solver is told of this simulated recording (seed {seed}).")),
    ];
    for (name, layout, head) in heads {
        let yaml = Document::Map(sections(layout, &Paths::new(layout, folder))).to_yaml()?;
        atomic::write(&folder.join(name), |out| write!(out, "{head}\n{yaml}"))?;
    }
    Ok(())
}

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
fn write_pictures(
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

/// Moves a finished folder to its place, over what an earlier simulation left there.
fn put_in_place(folder: tempfile::TempDir, out: &Path) -> std::io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755))?;
    }
    let is_there = out.exists();
    let empty = is_there && std::fs::read_dir(out)?.next().is_none();
    if is_there && !empty {
        forget_earlier(out);
        return merge(folder.path(), out);
    }
    if empty {
        std::fs::remove_dir(out)?;
    }
    std::fs::rename(folder.keep(), out)
}

/// Removes the pictures and measurements of an earlier simulation, which would mix with the new ones. Nothing is touched in a folder that holds none.
fn forget_earlier(out: &Path) {
    let Ok(earlier) = crate::layout::read_layout(&out.join(TRUTH), None) else { return };
    for camera in &earlier.cameras {
        let pattern = camera.images.as_deref().and_then(|text| ImagePattern::parse(text).ok());
        for picture in pattern.map(|pattern| pattern.find(out)).unwrap_or_default() {
            let _ = std::fs::remove_file(picture.path);
        }
    }
    for name in [DEFAULT_DETECTIONS, "target_poses.csv", "points.csv", TRUE_CORNERS] {
        let _ = std::fs::remove_file(out.join(name));
    }
}

fn merge(from: &Path, to: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let place = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            merge(&entry.path(), &place)?;
        } else {
            std::fs::rename(entry.path(), place)?;
        }
    }
    Ok(())
}
