//! The files of a simulated recording, and how they come to their place: all of them, or none.

use std::path::Path;

use super::{LAYOUT, Prepared, TRUTH};
use crate::layout::images::ImagePattern;
use crate::layout::write::sections;
use crate::layout::{Document, Paths};
use crate::recording::write::{write_motions, write_points, write_target_poses};
use crate::recording::{DEFAULT_DETECTIONS, atomic, write_detections, write_exact_detections};
use crate::simulate::{CornerNoise, Simulated, corners};
use crate::workflow::localise::localise;

/// Where every corner really is.
const TRUE_CORNERS: &str = "true_corners.csv";

/// Writes every file of the recording that is not a picture.
pub(super) fn write_files(folder: &Path, prepared: &Prepared, simulated: &Simulated) -> std::io::Result<()> {
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

/// Moves a finished folder to its place, over what an earlier simulation left there.
pub(super) fn put_in_place(folder: tempfile::TempDir, out: &Path) -> std::io::Result<()> {
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
