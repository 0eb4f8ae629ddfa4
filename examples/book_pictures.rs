//! Makes the book's pictures: the steps of the quick start, seen. Screenshots need Chromium.
//!
//! `cargo build --release && cargo run --release --example book_pictures -- target/release/cellmap`

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use image::imageops::{FilterType, replace};
use image::{DynamicImage, RgbImage};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Width of a screenshot, px.
const WIDTH: u32 = 1000;

fn run(program: &Path, folder: &Path, arguments: &str) -> Outcome<()> {
    let output = Command::new(program).current_dir(folder).args(arguments.split_whitespace()).output()?;
    if !output.status.success() {
        return Err(format!("{arguments}: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    Ok(())
}

/// Pictures of one height side by side.
fn beside(pictures: &[RgbImage]) -> RgbImage {
    let width = pictures.iter().map(|picture| picture.width() + 8).sum::<u32>().saturating_sub(8);
    let height = pictures.iter().map(RgbImage::height).max().unwrap_or(1);
    let mut whole = RgbImage::from_pixel(width.max(1), height, image::Rgb([255; 3]));
    let mut left = 0;
    for picture in pictures {
        replace(&mut whole, picture, left, 0);
        left += i64::from(picture.width()) + 8;
    }
    whole
}

fn high(picture: &DynamicImage, height: u32) -> RgbImage {
    picture.resize(u32::MAX, height, FilterType::Lanczos3).to_rgb8()
}

/// The first pages of a PDF.
fn pages(pdf: &Path, count: usize) -> Outcome<Vec<DynamicImage>> {
    let pdf = hayro::Pdf::new(Arc::new(std::fs::read(pdf)?)).map_err(|_| "the PDF cannot be read")?;
    let settings = hayro::RenderSettings::default();
    let interpreter = hayro::InterpreterSettings::default();
    let all = pdf.pages().iter().take(count).map(|page| {
        let pixels = hayro::render(page, &interpreter, &settings);
        let rgb = pixels.data_as_u8_slice().chunks_exact(4).flat_map(|p| {
            let paper = 255 - u16::from(p[3]);
            [p[0], p[1], p[2]].map(|value| (u16::from(value) + paper).min(255) as u8)
        });
        let (width, height) = (u32::from(pixels.width()), u32::from(pixels.height()));
        let page = RgbImage::from_raw(width, height, rgb.collect()).unwrap_or_default();
        let mut framed = RgbImage::from_pixel(width + 4, height + 4, image::Rgb([150; 3]));
        replace(&mut framed, &page, 2, 2);
        DynamicImage::from(framed)
    });
    Ok(all.collect())
}

/// The configuration at which a camera saw most corners.
fn best_stop(detections: &Path, camera: &str) -> Outcome<u64> {
    let mut counts: BTreeMap<u64, usize> = BTreeMap::new();
    for row in csv::Reader::from_path(detections)?.records() {
        let row = row?;
        if &row[2] == camera {
            *counts.entry(row[0].parse()?).or_default() += 1;
        }
    }
    let best = counts.into_iter().max_by_key(|(_, count)| *count);
    Ok(best.ok_or("the camera saw nothing")?.0)
}

/// Without the white around it.
fn trimmed(picture: &DynamicImage) -> RgbImage {
    let rgb = picture.to_rgb8();
    let inked = rgb.enumerate_pixels().filter(|(_, _, pixel)| pixel.0 != [255; 3]);
    let (right, bottom) = inked.fold((0, 0), |(right, bottom), (x, y, _)| (right.max(x + 1), bottom.max(y + 1)));
    picture.crop_imm(0, 0, right.max(1), bottom.max(1)).to_rgb8()
}

/// One figure of a report, alone on a page.
fn screenshot(report: &Path, figures: &str, height: u32, out: &Path) -> Outcome<()> {
    let html = std::fs::read_to_string(report)?;
    let alone = format!(
        "<style>header, nav, h2, .controls, figcaption, .scroll {{ display: none !important; }} section, figure {{ display: none; }} \
         section:has({figures}), figure:has({figures}) {{ display: block !important; margin: 0; }} main {{ padding: 0; max-width: none; }}</style>\
         <script>addEventListener('load', () => setTimeout(() => window.cellmapDrawAll(), 500));</script></head>"
    );
    let folder = tempfile::tempdir()?;
    let page = folder.path().join("page.html");
    std::fs::write(&page, html.replacen("</head>", &alone, 1))?;
    let shot = folder.path().join("shot.png");
    let status = Command::new("chromium")
        .args([
            "--headless",
            "--no-sandbox",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--hide-scrollbars",
        ])
        .args(["--virtual-time-budget=20000", "--force-prefers-reduced-motion"])
        .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
        .arg(format!("--window-size={WIDTH},{height}"))
        .arg(format!("--screenshot={}", shot.display()))
        .arg(format!("file://{}", page.display()))
        .output()?;
    if !status.status.success() {
        return Err("Chromium made no screenshot".into());
    }
    trimmed(&image::open(shot)?).save(out)?;
    Ok(())
}

fn main() -> Outcome<()> {
    let program = PathBuf::from(std::env::args().nth(1).ok_or("name the program")?).canonicalize()?;
    let out = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/src/pictures");
    std::fs::create_dir_all(&out)?;
    let folder = tempfile::tempdir()?;
    let at = folder.path();
    for arguments in [
        "new cell.yaml --robots ur5e --cameras left,right,wrist@ur5e --targets table:grid,tool:cube@ur5e,pallet:tag",
        "print cell.yaml --paper a3",
        "simulate cell.yaml --out cell --pictures --configurations 25",
        "detect cell/layout.yaml --draw drawn",
        "solve cell/layout.yaml --report report.html",
    ] {
        run(&program, at, arguments)?;
    }
    let sheets: Vec<RgbImage> = pages(&at.join("targets.pdf"), 2)?.iter().map(|page| high(page, 420)).collect();
    beside(&sheets).save(out.join("pages.png"))?;
    let seen = |name: &str| -> Outcome<DynamicImage> { Ok(image::open(at.join(name))?) };
    let stop = best_stop(&at.join("cell/detections.csv"), "wrist")?;
    let both = ["left", "wrist"].map(|camera| seen(&format!("cell/images/{camera}/{stop:03}.png")));
    let both = both.into_iter().collect::<Outcome<Vec<DynamicImage>>>()?;
    let both: Vec<RgbImage> = both.iter().map(|picture| high(picture, 280)).collect();
    beside(&both).save(out.join("seen.jpg"))?;
    let drawn = seen(&format!("drawn/left_{stop:04}_00.png"))?;
    drawn.crop_imm(370, 380, 480, 300).to_rgb8().save(out.join("found.jpg"))?;
    let report = at.join("report.html");
    for (figures, height, name) in [
        ("#cell", 640, "report_cell.png"),
        ("#path-space", 640, "report_paths.png"),
        ("#boxes", 400, "report_boxes.png"),
        ("#field", 480, "report_residuals.png"),
    ] {
        screenshot(&report, figures, height, &out.join(name))?;
    }
    Ok(())
}
