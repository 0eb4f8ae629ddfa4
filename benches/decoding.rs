//! Decoding alone, for comparison with `cellmap detect`: reads every picture below a folder, in as many threads as there are cores.
//!
//! `cargo bench --bench decoding -- FOLDER`

use std::path::{Path, PathBuf};
use std::time::Instant;

use cellmap::detect::GreyPicture;
use rayon::prelude::*;

fn pictures(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder that can be listed") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            pictures(&path, found);
        } else if path.extension().is_some_and(|kind| ["png", "jpg", "pgm"].iter().any(|known| kind == *known)) {
            found.push(path);
        }
    }
}

fn main() {
    let folder = std::env::args().skip(1).find(|word| !word.starts_with("--"));
    let Some(folder) = folder else {
        println!("no folder was named");
        return;
    };
    let mut found = Vec::new();
    pictures(Path::new(&folder), &mut found);
    found.sort();
    let began = Instant::now();
    let pixels: usize = found
        .par_iter()
        .map(|path| GreyPicture::read(path, None).expect("a picture that can be read").pixels().len())
        .sum();
    let seconds = began.elapsed().as_secs_f64();
    println!(
        "{} pictures, {:.0} megapixels, {seconds:.2} s, {:.0} pictures a second",
        found.len(),
        pixels as f64 / 1e6,
        found.len() as f64 / seconds
    );
}
