//! The worst pictures, with their residuals drawn in.

use base64::Engine;
use image::imageops::FilterType;
use std::collections::BTreeMap;

use super::ReportInput;
use super::markup::escape;
use crate::layout::images::ImagePattern;

/// Pictures shown.
const SHOWN: usize = 6;
/// Pictures are shrunk to this width, px.
const WIDTH: u32 = 900;
/// JPEG quality, per cent.
const QUALITY: u8 = 72;
/// What is cut out around the corners is at least this share of the picture's width.
const LEAST: f64 = 0.25;
/// The longest residual of a picture is drawn as long as this share of the width of what is shown.
const LONGEST: f64 = 0.06;

/// A picture's corners: pixel, residual (none for a corner that was set aside).
type Corners = Vec<([f64; 2], Option<[f64; 2]>)>;

/// Camera, configuration, shot.
type Picture = (usize, u64, u64);

/// The worst pictures as HTML figures.
pub(super) fn worst(input: &ReportInput<'_>) -> String {
    let s = input.solved;
    let m = &s.plan.measurements;
    let seen = || m.appearances(0..m.corner_count()).map(|(range, one)| (range, one.picture()));
    // Of each picture: the sum of the squared residuals, and how many numbers are in it.
    let mut pictures: BTreeMap<Picture, (f64, f64)> = BTreeMap::new();
    for (range, picture) in seen() {
        let sum = pictures.entry(picture).or_default();
        for d in s.residuals.corners(range).flatten() {
            *sum = (sum.0 + (d[0] * d[0] + d[1] * d[1]), sum.1 + 2.0);
        }
    }
    let rms = |(sum, count): (f64, f64)| if count == 0.0 { 0.0 } else { (sum / count).sqrt() };
    let mut order: Vec<(Picture, f64)> = pictures.into_iter().map(|(picture, sum)| (picture, rms(sum))).collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    order.truncate(SHOWN);
    let mut shown: BTreeMap<Picture, Corners> = order.iter().map(|(picture, _)| (*picture, Vec::new())).collect();
    for (range, picture) in seen() {
        if let Some(corners) = shown.get_mut(&picture) {
            corners.extend(range.map(|i| (m.pixel(i), s.residuals.corner(i))));
        }
    }
    let one = |(picture, rms): &(Picture, f64)| figure(input, *picture, *rms, &shown[picture]);
    order.iter().map(one).collect()
}

fn figure(input: &ReportInput<'_>, (camera, configuration, shot): Picture, rms: f64, corners: &Corners) -> String {
    let layout = &input.solved.layout;
    let (name, size) =
        (&layout.cameras[camera].name, layout.cameras[camera].intrinsics.as_ref().map(|lens| lens.size()));
    let [width, height] = size.unwrap_or([640, 480]).map(f64::from);
    let longest = corners.iter().filter_map(|(_, d)| d.map(|d| d[0].hypot(d[1]))).fold(0.0, f64::max);
    let cut = cut_out(corners, [width, height]);
    let scale = times(LONGEST * cut[2] / longest.max(1e-9));
    let unit = cut[2] / 450.0;
    let mut marks = String::new();
    for ([u, v], residual) in corners {
        match residual {
            // From the corner as found towards where the solution has it.
            Some([du, dv]) => marks.push_str(&format!(
                "<circle cx=\"{u:.1}\" cy=\"{v:.1}\" r=\"{:.1}\"/><line x1=\"{u:.1}\" y1=\"{v:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"/>",
                2.2 * unit,
                u + du * scale,
                v + dv * scale
            )),
            None => marks.push_str(&format!(
                "<path class=\"aside\" d=\"M{:.1} {:.1}l{r:.1} {r:.1}m0 -{r:.1}l-{r:.1} {r:.1}\"/>",
                u - 5.0 * unit,
                v - 5.0 * unit,
                r = 10.0 * unit
            )),
        }
    }
    let aside = corners.iter().filter(|(_, d)| d.is_none()).count();
    let picture = embedded(input, camera, configuration, shot, cut);
    let [left, top, width, height] = cut;
    let place = format!("x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\"");
    let background = picture.as_ref().map_or_else(
        || format!("<rect {place} class=\"blank\"/>"),
        |data| format!("<image href=\"data:image/jpeg;base64,{data}\" {place} preserveAspectRatio=\"none\"/>"),
    );
    let words =
        format!("{name}, configuration {configuration}, shot {shot}: {rms:.3} px rms, {} corners", corners.len());
    let aside = if aside == 0 { String::new() } else { format!(", {aside} set aside (crosses)") };
    let long = if scale == 1.0 { "in true length".to_owned() } else { format!("{scale:.0} times as long") };
    let missing = if picture.is_none() { " The picture itself is not in the recording." } else { "" };
    format!(
        "<figure><svg viewBox=\"{left} {top} {width} {height}\" role=\"img\" aria-label=\"{0}\" style=\"--unit:{unit:.3}px\">{background}<g class=\"marks\">{marks}</g></svg>\
         <figcaption>{0}{aside}. Residuals are drawn {long}.{missing}</figcaption></figure>",
        escape(&words)
    )
}

/// The part of a picture that holds all corners: left, top, width, height (px), as wide to high as the picture, whole pixels.
fn cut_out(corners: &Corners, [width, height]: [f64; 2]) -> [f64; 4] {
    let side = |axis: usize, whole: f64| {
        let (least, most) =
            corners.iter().map(|(pixel, _)| pixel[axis]).fold((whole, 0.0), |(a, b), v| (v.min(a), v.max(b)));
        (0.5 * (least + most), 1.5 * (most - least) / whole)
    };
    let ((u, across), (v, down)) = (side(0, width), side(1, height));
    let share = across.max(down).clamp(LEAST, 1.0);
    let [w, h] = [(share * width).round(), (share * height).round()];
    let begin = |middle: f64, size: f64, whole: f64| (middle - 0.5 * size).clamp(0.0, whole - size).round();
    [begin(u, w, width), begin(v, h, height), w, h]
}

/// The nearest of 1, 2, 5, 10, 20... below.
fn times(value: f64) -> f64 {
    let power = 10f64.powf(value.max(1.0).log10().floor());
    [5.0, 2.0, 1.0].iter().map(|step| step * power).find(|step| *step <= value.max(1.0)).unwrap_or(1.0)
}

/// A part of a picture as base64 JPEG, shrunk; none if the picture is not there or cannot be read.
fn embedded(input: &ReportInput<'_>, camera: usize, configuration: u64, shot: u64, cut: [f64; 4]) -> Option<String> {
    let layout = &input.solved.layout;
    let pattern = ImagePattern::parse(layout.cameras[camera].images.as_deref()?).ok()?;
    let path = pattern.path(&layout.recording, configuration, shot);
    let picture = image::ImageReader::open(path).ok()?.with_guessed_format().ok()?.decode().ok()?;
    let [left, top, width, height] = cut.map(|v| v as u32);
    let part = picture.crop_imm(left, top, width, height);
    let high = (f64::from(part.height()) * f64::from(WIDTH) / f64::from(part.width().max(1))).round() as u32;
    let small = if part.width() > WIDTH { part.resize_exact(WIDTH, high.max(1), FilterType::Triangle) } else { part };
    let mut bytes = std::io::Cursor::new(Vec::new());
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, QUALITY);
    small.to_rgb8().write_with_encoder(encoder).ok()?;
    Some(base64::engine::general_purpose::STANDARD.encode(bytes.into_inner()))
}
