//! Which of OpenCV's two homes of tags is there: the contrib module `aruco` up to 4.6, the module `objdetect` from 4.7 on. Without the feature
//! `opencv` this does nothing.
//!
//! `CELLMAP_OPENCV_VERSION` says which version it is where pkg-config does not know.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=CELLMAP_OPENCV_VERSION");
    println!("cargo::rustc-check-cfg=cfg(opencv_before_4_7)");
    println!("cargo::rustc-check-cfg=cfg(opencv_before_5)");
    if std::env::var_os("CARGO_FEATURE_OPENCV").is_none() {
        return;
    }
    let said = std::env::var("CELLMAP_OPENCV_VERSION").ok();
    let version = said.or_else(|| ["opencv4", "opencv5", "opencv"].into_iter().find_map(installed));
    let Some([major, minor]) = version.as_deref().and_then(parse) else {
        println!(
            "cargo::error=OpenCV's version cannot be told by pkg-config: set CELLMAP_OPENCV_VERSION, for example to 4.10"
        );
        return;
    };
    if [major, minor] < [4, 7] {
        println!("cargo::rustc-cfg=opencv_before_4_7");
    }
    if major < 5 {
        println!("cargo::rustc-cfg=opencv_before_5");
    }
}

/// What pkg-config says.
fn installed(package: &str) -> Option<String> {
    let answer = Command::new("pkg-config").args(["--modversion", package]).output().ok()?;
    answer.status.success().then(|| String::from_utf8_lossy(&answer.stdout).trim().to_owned())
}

/// `4.6.0` to 4, 6.
fn parse(version: &str) -> Option<[u32; 2]> {
    let mut numbers = version.split('.').map(str::parse);
    Some([numbers.next()?.ok()?, numbers.next()?.ok()?])
}
