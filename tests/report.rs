//! The report: its parts, its size, and, where Chromium is there, that it runs without a complaint.

#[path = "support/program.rs"]
mod program;

use program::{folder, json, run, stderr, stdout};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// A simulated cell, solved with a report: one robot, two cameras, one of them on its wrist, no pictures.
fn solved() -> tempfile::TempDir {
    let dir = folder(&[]);
    let new = [
        "new",
        "cell.yaml",
        "--robots",
        "ur5e",
        "--cameras",
        "left,wrist@ur5e",
        "--targets",
        "table:grid,tool:cube@ur5e",
        "--json",
    ];
    assert_eq!(run(dir.path(), &new).status.code(), Some(0));
    let made = run(dir.path(), &["simulate", "cell.yaml", "--out", "cell", "--configurations", "12", "--json"]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let solved = run(dir.path(), &["solve", "cell/layout.yaml", "--report", "report.html", "--json"]);
    assert_eq!(solved.status.code(), Some(0), "{}", stderr(&solved));
    dir
}

fn data(html: &str) -> Value {
    let text = html.split("<script type=\"application/json\" id=\"data\">").nth(1).unwrap();
    serde_json::from_str(text.split("</script>").next().unwrap()).unwrap()
}

#[test]
fn the_report_has_all_its_parts_and_needs_no_network() {
    let dir = solved();
    let html = std::fs::read_to_string(dir.path().join("report.html")).unwrap();
    assert!(html.starts_with("<!doctype html>") && html.trim_end().ends_with("</html>"));
    assert!(html.len() < 10_000_000, "{}", html.len());
    for section in [
        "summary",
        "cell-section",
        "poses",
        "paths",
        "errors",
        "residuals",
        "pictures",
        "undetermined",
        "rejected",
        "covariance",
        "provenance",
    ] {
        assert_eq!(html.matches(&format!("<section id=\"{section}\">")).count(), 1, "{section}");
        assert!(html.contains(&format!("href=\"#{section}\"")), "{section}");
    }
    // Everything but the plotting library, which is one script element.
    let library = html.find("plotly.js v").unwrap();
    let end = library + html[library..].find("</script>").unwrap();
    let own = format!("{}{}", &html[..library], &html[end..]);
    for outside in ["src=\"http", "href=\"http", "@import", "url(http"] {
        assert!(!own.contains(outside), "{outside}");
    }
    assert!(
        own.contains("<html lang=\"en\">")
            && own.contains("name=\"viewport\"")
            && own.contains("class=\"verdict good\"")
    );
    assert!(own.contains("Standard deviations in two ways") && own.contains("times the variance of independent ones"));
    // Every control has a label.
    for id in ["stop", "swell", "stretch", "camera"] {
        assert!(own.contains(&format!("id=\"{id}\"")) && own.contains(&format!("<label for=\"{id}\"")), "{id}");
    }
    let data = data(&html);
    let scene = &data["scene"];
    assert_eq!(scene["stops"].as_array().unwrap().len(), 12);
    let frames = scene["frames"].as_array().unwrap();
    let tool = frames.iter().find(|f| f["name"] == "tool").unwrap();
    assert_eq!((tool["poses"].as_array().unwrap().len(), tool["pose"].is_null()), (12, true));
    assert_eq!(scene["ellipsoids"].as_array().unwrap().len(), 4);
    let figures = &data["figures"];
    assert_eq!(figures["residuals"].as_array().unwrap().len(), 2);
    assert_eq!(figures["correlation"]["labels"].as_array().unwrap().len(), 24);
}

/// What each picture measures lies near what the solution computes, as near as its corners allow, and the histogram counts every corner.
#[test]
fn the_figures_show_what_was_measured() {
    let dir = solved();
    let html = std::fs::read_to_string(dir.path().join("report.html")).unwrap();
    let figures = &data(&html)["figures"];
    let path = &figures["paths"].as_array().unwrap().iter().find(|p| p["target"] == "tool").unwrap();
    let number = |v: &Value| v.as_f64().unwrap();
    let computed = path["computed"]["configuration"].as_array().unwrap();
    let seen = &path["measured"][0];
    let mut near = 0;
    for (i, configuration) in seen["configuration"].as_array().unwrap().iter().enumerate() {
        let at = computed.iter().position(|c| c == configuration).unwrap();
        let apart: f64 =
            ["x", "y", "z"].iter().map(|k| (number(&seen[*k][i]) - number(&path["computed"][*k][at])).powi(2)).sum();
        near += usize::from(apart.sqrt() < 10.0);
    }
    assert!(near as f64 > 0.9 * seen["configuration"].as_array().unwrap().len() as f64);
    let solution = json(&run(dir.path(), &["solve", "cell/layout.yaml", "--json"]));
    let corners: u64 = solution["corners"].as_array().unwrap().iter().map(|t| t["accepted"].as_u64().unwrap()).sum();
    let counted: u64 = figures["residuals"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|c| c["bins"]["u"].as_array().unwrap())
        .map(|n| n.as_u64().unwrap())
        .sum();
    assert_eq!(counted, corners);
}

#[test]
fn a_solution_file_gives_the_same_report_but_for_what_it_does_not_hold() {
    let dir = solved();
    let output = run(dir.path(), &["report", "cell/solution.yaml", "--out", "again.html"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let (one, two) = ["report.html", "again.html"].map(|f| std::fs::read_to_string(dir.path().join(f)).unwrap()).into();
    let (one, two) = (data(&one), data(&two));
    assert_eq!(one["figures"]["residuals"], two["figures"]["residuals"]);
    assert_eq!(one["figures"]["stops"], two["figures"]["stops"]);
    assert!(two["figures"]["correlation"].is_null());
    assert_eq!(two["scene"]["ellipsoids"].as_array().unwrap().len(), 4);
    // A layout is no solution.
    let output = run(dir.path(), &["report", "cell/layout.yaml"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("this layout is no solution"), "{}", stderr(&output));
}

/// Words from a layout are only ever words.
#[test]
fn names_cannot_break_the_page() {
    let layout = "cellmap: 1\nunits: {length: m, angle: rad}\nworld: base\ncameras: {\"<b>&'eye\": {}}\n\
        robots: {arm: {flange_poses: f.csv, pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}}\n\
        targets: {\"<\\u002fscript><i>\": {mount: arm.flange}}\nobservations: {target_poses: p.csv}\n";
    let layout = layout.replace("\\u002f", "\u{2215}");
    let row = "x,y,z,qx,qy,qz,qw\n";
    let flange = format!("configuration,robot,{row}1,arm,0,0,0,0,0,0,1\n2,arm,1,0,0,1,0,0,0\n3,arm,0,1,0,0,1,0,0\n");
    let name = "<\u{2215}script><i>";
    let poses = format!(
        "configuration,shot,camera,target,{row}1,0,<b>&'eye,{name},0,0,1,0,0,0,1\n2,0,<b>&'eye,{name},1,0,1,1,0,0,0\n3,0,<b>&'eye,{name},0,1,1,0,1,0,0\n"
    );
    let dir = folder(&[("layout.yaml", &layout), ("f.csv", &flange), ("p.csv", &poses)]);
    let output = run(dir.path(), &["solve", "layout.yaml", "--report", "r.html"]);
    let html = std::fs::read_to_string(dir.path().join("r.html")).unwrap_or_else(|_| panic!("{}", stderr(&output)));
    assert!(html.contains("&lt;b&gt;&amp;'eye") && !html.contains("<td><b>"));
    assert!(data(&html)["scene"]["frames"].as_array().unwrap().iter().any(|f| f["name"] == name));
}

/// Where the screenshot of a width is kept.
fn screenshot(width: u32) -> std::path::PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("report_{width}.png"))
}

/// Runs a page in headless Chromium and returns what its document holds at the end, and what was said. A screenshot stays in the folder that cargo keeps for tests.
fn browse(page: &Path, width: u32) -> Option<(String, String)> {
    let browser = ["chromium", "chromium-browser", "google-chrome"]
        .into_iter()
        .find(|name| Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success()))?;
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu-sandbox",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
        ])
        .args(["--enable-logging=stderr", "--virtual-time-budget=60000", "--dump-dom"])
        .arg(format!("--screenshot={}", screenshot(width).display()))
        .arg(format!("--window-size={width},5000"))
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    Some((String::from_utf8_lossy(&output.stdout).into_owned(), stderr(&output)))
}

#[test]
fn the_report_runs_in_a_browser() {
    let dir = solved();
    let html = std::fs::read_to_string(dir.path().join("report.html")).unwrap();
    // Draws everything, moves every slider, changes the theme, and notes what went wrong and what is there.
    let probe = "<script>const wrong=[];window.addEventListener('error',(e)=>wrong.push(e.message));\
        window.addEventListener('load',()=>setTimeout(()=>{try{cellmapDrawAll();\
        const put=(id,v)=>{const s=document.getElementById(id);s.value=v;s.dispatchEvent(new Event('input',{bubbles:true}));};\
        put('stop',5);put('swell',30);put('stretch',35);document.getElementById('theme').click();\
        document.querySelector('[data-view=top]').click();\
        setTimeout(()=>{document.title=JSON.stringify({wrong,plots:document.querySelectorAll('.plot .main-svg').length,\
        stop:document.getElementById('stop-value').textContent,swell:document.getElementById('swell-value').textContent,\
        theme:document.documentElement.dataset.theme,wide:document.documentElement.scrollWidth-window.innerWidth});},2000);}\
        catch(e){document.title=JSON.stringify({wrong:[String(e)]});}},500));</script></head>";
    std::fs::write(dir.path().join("probe.html"), html.replacen("</head>", probe, 1)).unwrap();
    for width in [1440, 800, 390] {
        let Some((dom, log)) = browse(&dir.path().join("probe.html"), width) else {
            println!("skipped: no Chromium");
            return;
        };
        let title = dom.split("<title>").nth(1).unwrap().split("</title>").next().unwrap().replace("&quot;", "\"");
        let found: Value = serde_json::from_str(&title).unwrap_or_else(|_| panic!("{title}\n{log}"));
        assert_eq!(found["wrong"], serde_json::json!([]), "{found}");
        // Plotly draws up to three layers a figure; every figure must have at least one.
        assert!(found["plots"].as_u64().unwrap() >= 11, "{found}");
        assert_eq!((found["stop"].as_str(), found["swell"].as_str()), (Some("6"), Some("× 1000")), "{found}");
        assert!(["dark", "light"].contains(&found["theme"].as_str().unwrap()), "{found}");
        assert!(found["wide"].as_i64().unwrap() <= 0, "the page is wider than the screen: {found}");
        let picture = image::open(screenshot(width)).unwrap().to_rgb8();
        let inked = picture.pixels().filter(|pixel| pixel.0 != picture.get_pixel(0, 0).0).count();
        assert!(inked * 50 > picture.len() / 3, "the screenshot is nearly empty: {inked}");
        let complaints: Vec<&str> = log
            .lines()
            .filter(|line| line.contains("CONSOLE") && (line.contains("rror") || line.contains("Uncaught")))
            .collect();
        assert!(complaints.is_empty(), "{complaints:?}");
    }
    assert!(stdout(&run(dir.path(), &["report", "--help"])).contains("Example"));
}
