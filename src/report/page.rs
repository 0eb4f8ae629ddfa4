//! The HTML file around everything.

use serde_json::json;

use super::ReportInput;
use super::figures::figures;
use super::markup::escape;
use super::pictures;
use super::scene::scene;
use super::tables;
use crate::workflow::measured::sights;
use crate::workflow::place::Places;

const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// The plotting library as one element of text that the script runs once the page is on the screen, without the typesetting that the crate puts beside it.
fn library() -> String {
    let both = plotly::Plot::offline_js_sources();
    let end = both.find("</script>").map_or(both.len(), |at| at + "</script>".len());
    let begin = both.find('>').map_or(0, |at| at + 1);
    format!("<script type=\"text/plain\" id=\"library\">{}", &both[begin..end])
}

/// JSON that can stand inside a script element.
fn inline(value: &serde_json::Value) -> String {
    value.to_string().replace("</", "<\\/").replace("<!--", "<\\!--")
}

/// A figure that the script draws.
fn plot(id: &str, class: &str, caption: &str) -> String {
    format!(
        "<figure class=\"{class}\"><div class=\"plot\" id=\"{id}\" role=\"img\" aria-label=\"{0}\"></div><figcaption>{0}</figcaption></figure>",
        escape(caption)
    )
}

fn slider(id: &str, label: &str, least: i64, most: i64, value: i64) -> String {
    format!(
        "<label for=\"{id}\">{label} <output id=\"{id}-value\" for=\"{id}\"></output></label><input type=\"range\" id=\"{id}\" min=\"{least}\" max=\"{most}\" value=\"{value}\">"
    )
}

/// The whole file.
pub(super) fn page(input: &ReportInput<'_>) -> String {
    let places = Places { solved: input.solved, recording: input.recording };
    let sights = sights(&places);
    let data = json!({"scene": scene(input, &places), "figures": figures(input, &sights)});
    let s = input.solved;
    let file = s.layout.file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let stops = data["scene"]["stops"].as_array().map_or(0, Vec::len);
    let title = format!("cellmap report: {}", escape(&file));
    let has = |key: &str| data["figures"][key].as_array().is_some_and(|list| !list.is_empty());
    let mut sections: Vec<(&str, &str, String)> = vec![("summary", "Summary", tables::summary(input))];
    let mut cell = String::from("<div class=\"controls\">");
    if stops > 1 {
        cell.push_str(&slider("stop", "Configuration", 0, stops as i64 - 1, 0));
    }
    cell.push_str(&slider("swell", "Ellipsoids", 0, 40, 20));
    cell.push_str("<span class=\"buttons\" role=\"group\" aria-label=\"View\"><button type=\"button\" data-view=\"iso\">Corner</button><button type=\"button\" data-view=\"top\">Top</button><button type=\"button\" data-view=\"front\">Front</button><button type=\"button\" data-view=\"side\">Side</button></span>");
    cell.push_str("<label class=\"check\"><input type=\"checkbox\" id=\"names\" checked> Names</label></div>");
    cell.push_str(&plot("cell", "tall", "The cell as found, metres, in the world's axes. Drag to turn, scroll to come nearer, click the legend to hide. Ellipsoids are standard deviations, enlarged by the slider."));
    sections.push(("cell-section", "The cell", cell));
    sections.push(("poses", "Poses", tables::poses(input)));
    if has("paths") {
        let mut html = String::from(
            "<div class=\"controls\"><label for=\"path-target\">What moves <select id=\"path-target\"></select></label></div>",
        );
        html.push_str(&plot("path-space", "tall", "The path in space, mm: the line is where the solution carries it, the dots are where each picture sees it."));
        html.push_str("<div class=\"row\">");
        for (id, plane) in [("path-xy", "x-y"), ("path-xz", "x-z"), ("path-yz", "y-z")] {
            html.push_str(&plot(id, "small", &format!("The same in the {plane} plane, mm.")));
        }
        html.push_str("</div>");
        sections.push(("paths", "Paths: computed and measured", html));
    }
    if has("errors") {
        let mut html = plot(
            "boxes",
            "wide",
            "Measured minus computed, each picture, in the world's axes: box = middle half, line = median, whiskers = 1.5 boxes.",
        );
        html.push_str("<div class=\"row two\">");
        html.push_str(&plot("cloud", "wide", "Where each picture sees the world's frame, if the robots and mounts are right, mm. A tight ball at zero is best; a shifted one is a camera that disagrees."));
        html.push_str(&plot(
            "by-stop",
            "wide",
            "Error by configuration. A step is something that moved; a spike is one bad stop.",
        ));
        html.push_str("</div>");
        html.push_str(&tables::sight_table(input, &sights));
        sections.push(("errors", "Errors: by camera and parameter", html));
    }
    if has("residuals") {
        let mut html = String::from(
            "<div class=\"controls\"><label for=\"camera\">Camera <select id=\"camera\"></select></label>",
        );
        html.push_str(&slider("stretch", "Arrows", 0, 40, 20));
        html.push_str("</div><div class=\"row two\">");
        html.push_str(&plot("field", "wide", "Residuals over the picture, px: from the corner as found towards where the solution has it. Arrows that point the same way in one region mean the lens."));
        html.push_str(&plot(
            "histogram",
            "wide",
            "How often each residual occurs, px. It should be one narrow hill around zero.",
        ));
        html.push_str("</div>");
        html.push_str(&tables::corners(input));
        html.push_str(&tables::worst_configurations(input));
        sections.push(("residuals", "Residuals", html));
        sections.push((
            "pictures",
            "The worst pictures",
            format!("<div class=\"pictures\">{}</div>", pictures::worst(input)),
        ));
    }
    sections.push(("remarks", "What noise does not explain", tables::remarks(input)));
    sections.push(("undetermined", "What is not determined", tables::undetermined(input)));
    sections.push(("rejected", "What was set aside", tables::rejected(input)));
    if data["figures"]["correlation"].is_object() {
        let words = if data["figures"]["correlation"]["whole"].as_bool() == Some(true) {
            "Correlation of the numbers found: 0 = independent, 1 or -1 = only their sum or difference is known."
        } else {
            "Correlation of the blocks found, the strongest of each pair."
        };
        sections.push(("covariance", "Correlations", plot("correlation", "tall square", words)));
    }
    sections.push(("provenance", "Times and sources", tables::provenance(input)));
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<link rel=\"icon\" href=\"data:,\">\n<style>{STYLE}</style>\n</head>\n<body>\n<a class=\"skip\" href=\"#main\">Skip to the report</a>\n<header><h1>{title}</h1>\
         <button type=\"button\" id=\"theme\" aria-pressed=\"false\">Dark or light</button></header>\n<nav aria-label=\"Sections\"><ul>"
    );
    for (id, name, _) in &sections {
        let short = name.split(':').next().unwrap_or(name);
        html.push_str(&format!("<li><a href=\"#{id}\">{short}</a></li>"));
    }
    html.push_str("</ul></nav>\n<main id=\"main\">\n");
    for (id, name, body) in &sections {
        html.push_str(&format!("<section id=\"{id}\"><h2>{name}</h2>{body}</section>\n"));
    }
    html.push_str(
        "</main>\n<noscript><p class=\"warn\">The figures need JavaScript; the tables do not.</p></noscript>\n",
    );
    html.push_str(&format!("<script type=\"application/json\" id=\"data\">{}</script>\n", inline(&data)));
    html.push_str(&library());
    html.push_str(&format!("\n<script>{SCRIPT}</script>\n</body>\n</html>\n"));
    html
}
