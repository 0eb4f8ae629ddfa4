//! Everything that can be said in words and tables, as HTML that needs no script.

use serde_json::Value;
use std::collections::BTreeMap;

use super::ReportInput;
use super::markup::{escape, items, list, number, prose, table, text};
use crate::solve::GroupKind;
use crate::workflow::measured::Sight;

/// Configurations named in the table of the worst.
const WORST: usize = 12;

/// Whether the findings say that the answer can be used.
fn trustworthy(findings: &Value) -> bool {
    let fit = findings.get("fit");
    let converged = fit.and_then(|f| f.get("converged")).and_then(Value::as_bool).unwrap_or(false);
    let refused = items(findings.get("faults")).iter().any(|fault| text(fault.get("action")) == "refused");
    converged
        && !refused
        && items(fit.and_then(|f| f.get("doubts"))).is_empty()
        && items(findings.get("undetermined")).is_empty()
}

/// The verdict, and the few numbers that one wants first.
pub(super) fn summary(input: &ReportInput<'_>) -> String {
    let (f, s) = (&input.findings, input.solved);
    let fit = f.get("fit").cloned().unwrap_or_default();
    let good = trustworthy(f);
    let (class, words) = if good {
        ("good", "The answer can be used: it converged, everything is determined, and the measurements agree.")
    } else {
        ("bad", "The answer needs a second look; the reasons follow.")
    };
    let mut html = format!(
        "<p class=\"verdict {class}\" id=\"verdict\"><strong>{}</strong> {words}</p>",
        if good { "&#10003; Good." } else { "&#9888; Not to be trusted yet." }
    );
    html.push_str("<dl class=\"facts\">");
    let mut fact = |name: &str, value: String| {
        html.push_str(&format!("<div><dt>{name}</dt><dd>{}</dd></div>", escape(&value)));
    };
    let residual = |key: &str, unit: &str, decimals: usize| {
        fit.get(key).and_then(Value::as_f64).map(|v| format!("{v:.decimals$} {unit}"))
    };
    for (key, name, unit, decimals) in [
        ("rms_px", "corners, rms a coordinate", "px", 3),
        ("rms_pose_mm", "measured poses, rms", "mm", 3),
        ("rms_pose_deg", "measured poses, rms", "deg", 3),
        ("rms_point_mm", "measured points, rms", "mm", 3),
        ("rms_contact_mm", "contacts, rms", "mm", 3),
    ] {
        if let Some(value) = residual(key, unit, decimals) {
            fact(name, value);
        }
    }
    let whole = |key: &str| fit.get(key).and_then(Value::as_u64).map_or_else(|| "?".to_owned(), |v| v.to_string());
    fact("numbers measured", whole("observations"));
    fact("numbers found", whole("unknowns"));
    fact("configurations", s.plan.configurations.len().to_string());
    fact("set aside", whole("rejected"));
    html.push_str("</dl>");
    if fit.get("converged").and_then(Value::as_bool) != Some(true) {
        html.push_str(&format!(
            "<p class=\"warn\">The search did not end well: {}.</p>",
            prose(&text(fit.get("termination")))
        ));
    }
    if let Some(streamed) = &s.streamed {
        let [first, all] = streamed.configurations;
        html.push_str(&format!(
            "<p>The corners did not fit into the memory that was given. Poses, standard deviations and counts are those of all {all} configurations; \
             pictures, figures, lists of residuals, factors, remarks and faults are those of {first} of them, one of {}.</p>",
            streamed.stride
        ));
    }
    for fault in items(f.get("faults")).iter().filter(|fault| text(fault.get("action")) == "refused") {
        html.push_str(&format!(
            "<p class=\"warn\"><a href=\"#faults\">Wrong</a>: {}.</p>",
            prose(&text(fault.get("what")))
        ));
    }
    let open = items(f.get("undetermined")).len();
    if open > 0 {
        let what = if open == 1 { "1 direction is".to_owned() } else { format!("{open} directions are") };
        html.push_str(&format!("<p class=\"warn\">{what} <a href=\"#undetermined\">not determined</a>.</p>"));
    }
    for doubt in items(fit.get("doubts")) {
        html.push_str(&format!("<p class=\"warn\">{}</p>", prose(doubt.as_str().unwrap_or(""))));
    }
    html
}

/// What nothing determines, and what little determines, in words.
pub(super) fn undetermined(input: &ReportInput<'_>) -> String {
    let mut html = String::new();
    let open = items(input.findings.get("undetermined"));
    if open.is_empty() {
        html.push_str("<p>Every direction is determined.</p>");
    } else {
        html.push_str(&directions(&open));
    }
    let weak = items(input.findings.get("weak"));
    if !weak.is_empty() {
        html.push_str("<p>Determined, but weakly:</p>");
        html.push_str(&directions(&weak));
    }
    html
}

fn directions(all: &[Value]) -> String {
    let mut html = String::from("<ul class=\"open\">");
    for one in all {
        let (reason, remedy) = (text(one.get("reason")), text(one.get("remedy")));
        html.push_str(&format!("<li>{}<br><em>What helps:</em> {}</li>", prose(&reason), prose(&remedy)));
    }
    html + "</ul>"
}

/// Poses with their standard deviations.
pub(super) fn poses(input: &ReportInput<'_>) -> String {
    let Some(poses) = input.findings.get("poses").and_then(Value::as_object) else { return String::new() };
    let mut rows = Vec::new();
    let mut fixed = 0;
    for (key, pose) in poses {
        if text(pose.get("kind")) == "fixed" {
            fixed += 1;
            continue;
        }
        let (xyz, sxyz) = (list(pose.get("xyz_mm"), 2), list(pose.get("sigma_xyz_mm"), 3));
        let (turn, sturn) = (list(pose.get("rotvec_deg"), 3), list(pose.get("sigma_rotvec_deg"), 4));
        let mut row = vec![key.clone()];
        row.extend(xyz.iter().zip(&sxyz).map(|(v, s)| format!("{v} \u{b1} {s}")));
        row.extend(turn.iter().zip(&sturn).map(|(v, s)| format!("{v} \u{b1} {s}")));
        rows.push(row);
    }
    let header =
        ["parent_from_child", "x, mm", "y, mm", "z, mm", "rotation x, deg", "rotation y, deg", "rotation z, deg"];
    let mut html = table("Poses found, \u{b1} one standard deviation", &header, &rows);
    if fixed > 0 {
        html.push_str(&format!(
            "<p class=\"note\">{fixed} more were given and are not listed. ? = not determined.</p>"
        ));
    }
    html.push_str(&two_ways(input));
    if let Some(parameters) = input.findings.get("parameters").and_then(Value::as_object) {
        let mut rows = Vec::new();
        for (block, entries) in parameters {
            for (name, value) in entries.as_object().into_iter().flatten() {
                rows.push(vec![
                    format!("{block}: {name}"),
                    number(value.get("value"), 5),
                    number(value.get("sigma"), 5),
                    number(value.get("information_sigma"), 5),
                    number(value.get("clusters_sigma"), 5),
                ]);
            }
        }
        html.push_str(&table(
            "Lenses and links found",
            &["parameter", "value", "\u{b1}", "information", "clusters"],
            &rows,
        ));
    }
    html
}

/// The standard deviations of each pose in both ways, and what the residuals show of shared errors.
fn two_ways(input: &ReportInput<'_>) -> String {
    let Some(poses) = input.findings.get("poses").and_then(Value::as_object) else { return String::new() };
    let both = |pose: &Value, what: &str, decimals: usize| -> Vec<String> {
        let [one, other] =
            ["information", "clusters"].map(|way| list(pose.get(format!("{way}_sigma_{what}")), decimals));
        one.iter().zip(&other).map(|(one, other)| format!("{one} / {other}")).collect()
    };
    let found = poses.iter().filter(|(_, pose)| text(pose.get("kind")) != "fixed");
    let rows: Vec<Vec<String>> = found
        .map(|(key, pose)| {
            let mut row = vec![key.clone()];
            row.extend(both(pose, "xyz_mm", 3));
            row.extend(both(pose, "rotvec_deg", 4));
            row
        })
        .collect();
    let header =
        ["parent_from_child", "x, mm", "y, mm", "z, mm", "rotation x, deg", "rotation y, deg", "rotation z, deg"];
    let mut html = table("Standard deviations in two ways: independent / shared errors", &header, &rows);
    let shared = input.findings.get("fit").and_then(|fit| fit.get("shared_errors"));
    let mut words = Vec::new();
    for (key, whose) in
        [("by_configuration", "of one configuration"), ("by_corner", "of one corner seen again and again")]
    {
        let scatter = shared.and_then(|shared| shared.get(key));
        let shown = scatter.and_then(|scatter| scatter.get("shown")).and_then(Value::as_bool) == Some(true);
        let ratio = number(scatter.and_then(|scatter| scatter.get("variance_ratio")), 1);
        words.push(format!(
            "Errors {whose}: {ratio} times the variance of independent ones, {}.",
            if shown { "more than chance" } else { "no more than chance" }
        ));
    }
    html.push_str(&format!(
        "<p class=\"note\">The first takes each corner for an independent fact, the second each configuration, and each corner that stands still, for one. \
         The table above has the first unless errors are shared, and then the larger. {}</p>",
        words.join(" ")
    ));
    html
}

/// How corners fared, by camera and target, and what was set aside.
pub(super) fn corners(input: &ReportInput<'_>) -> String {
    let s = input.solved;
    let rows: Vec<Vec<String>> = s
        .tallies
        .iter()
        .map(|t| {
            let all = t.accepted + t.rejected;
            let share = 100.0 * t.rejected as f64 / (all.max(1)) as f64;
            vec![
                t.camera.clone(),
                t.target.clone(),
                all.to_string(),
                format!("{} ({share:.1} %)", t.rejected),
                t.rms_px.map_or_else(|| "-".to_owned(), |rms| format!("{rms:.3}")),
            ]
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    table("Corners by camera and target", &["camera", "target", "corners", "set aside", "rms, px"], &rows)
}

/// How whole poses and points fared, by sensor and target.
pub(super) fn sight_table(input: &ReportInput<'_>, sights: &[Sight]) -> String {
    let frames = &input.solved.tree.frames;
    let mut by: BTreeMap<(usize, usize), Vec<&Sight>> = BTreeMap::new();
    for sight in sights {
        by.entry((sight.by, sight.of)).or_default().push(sight);
    }
    let rows: Vec<Vec<String>> = by
        .into_iter()
        .map(|((sensor, target), sights)| {
            let mean_square =
                |f: &dyn Fn(&Sight) -> f64| (sights.iter().map(|s| f(s)).sum::<f64>() / sights.len() as f64).sqrt();
            let shift = mean_square(&|s| (s.measured.translation - s.computed.translation).norm_squared()) * 1e3;
            let turn = mean_square(&|s| s.measured.rotation.angle_to(&s.computed.rotation).powi(2)).to_degrees();
            let turned = sights.iter().any(|s| s.turned);
            vec![
                frames[sensor].name.clone(),
                frames[target].name.clone(),
                sights.len().to_string(),
                format!("{shift:.3}"),
                if turned { format!("{turn:.4}") } else { "-".to_owned() },
            ]
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let header = ["seen by", "target", "times", "distance, rms mm", "angle, rms deg"];
    table("Where each picture sees each target, against the solution", &header, &rows)
}

/// The configurations that fit worst.
pub(super) fn worst_configurations(input: &ReportInput<'_>) -> String {
    let s = input.solved;
    let mut sums: BTreeMap<usize, (f64, usize, usize)> = BTreeMap::new();
    for group in s.plan.groups.iter().filter(|group| matches!(group.kind, GroupKind::Corners { .. })) {
        for block in &group.blocks {
            let sum = sums.entry(block.configuration).or_default();
            for residual in s.residuals.corners(block.start..block.end) {
                match residual {
                    Some(d) => *sum = (sum.0 + d[0] * d[0] + d[1] * d[1], sum.1 + 1, sum.2),
                    None => sum.2 += 1,
                }
            }
        }
    }
    let rms = |sum: &(f64, usize, usize)| (sum.0 / (2.0 * sum.1.max(1) as f64)).sqrt();
    let mut all: Vec<_> = sums.into_iter().collect();
    all.sort_by(|a, b| rms(&b.1).total_cmp(&rms(&a.1)).then(a.0.cmp(&b.0)));
    let rows: Vec<Vec<String>> = all
        .iter()
        .take(WORST)
        .map(|(c, sum)| {
            vec![
                s.plan.configurations[*c].to_string(),
                sum.1.to_string(),
                sum.2.to_string(),
                format!("{:.3}", rms(sum)),
            ]
        })
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    table("The configurations that fit worst", &["configuration", "corners", "set aside", "rms, px"], &rows)
}

/// What is wrong with the recording or its description, in words.
fn faults(input: &ReportInput<'_>) -> String {
    let all = items(input.findings.get("faults"));
    if all.is_empty() {
        return String::new();
    }
    let mut html = String::from("<ul class=\"open\" id=\"faults\">");
    for one in all {
        let part = |key: &str| prose(&text(one.get(key)));
        let refused = text(one.get("action")) == "refused";
        let action = if refused { "The answer is not to be used." } else { "It was left out." };
        html.push_str(&format!(
            "<li><strong>{}</strong>. {action}<br>{}.<br><em>What helps:</em> {}</li>",
            part("what"),
            part("evidence"),
            part("remedy")
        ));
    }
    html + "</ul>"
}

/// What noise does not explain although the fit may be sound.
pub(super) fn remarks(input: &ReportInput<'_>) -> String {
    let all = items(input.findings.get("remarks"));
    if all.is_empty() {
        return "<p>Residuals follow neither distance, angle, place in the picture nor a joint more than noise does.</p>".to_owned();
    }
    let mut html = String::from("<ul class=\"open\">");
    for one in all {
        let (what, remedy) = (text(one.get("what")), text(one.get("remedy")));
        html.push_str(&format!("<li>{}<br><em>What to check:</em> {}</li>", prose(&what), prose(&remedy)));
    }
    html + "</ul>"
}

/// What was set aside, and why.
pub(super) fn rejected(input: &ReportInput<'_>) -> String {
    let r = &input.solved.rejected;
    let kinds =
        [(r.corners, "corners"), (r.poses, "measured poses"), (r.points, "measured points"), (r.contacts, "contacts")];
    let mut html = faults(input);
    let set: Vec<String> = kinds.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
    if set.is_empty() && r.unplaced == 0 {
        return html + "<p>Nothing was set aside.</p>";
    }
    if !set.is_empty() {
        html.push_str(&format!(
            "<p>Set aside: {}. Each lies more than five times the scale of the bulk away from where the rest says it is, or would be behind the \
             camera: a wrong id, a corner dragged by a shadow or reflection, a shifted log. The rest was then fitted by least squares.</p>",
            set.join(", ")
        ));
    }
    if r.unplaced > 0 {
        html.push_str(&format!(
            "<p>Left out: {} measurements of moving targets of which too little was seen.</p>",
            r.unplaced
        ));
    }
    html
}

/// Times and where everything came from.
pub(super) fn provenance(input: &ReportInput<'_>) -> String {
    let s = input.solved;
    let mut html = String::new();
    if input.fresh {
        let t = &s.seconds;
        let rows = [
            ("reading files", t.read),
            ("finding a start", t.initialise),
            ("linearising", t.linearise),
            ("factorising", t.factorise),
            ("trial steps", t.evaluate),
            ("covariance", t.covariance),
            ("in all", t.total),
        ];
        let rows: Vec<Vec<String>> = rows.iter().map(|(what, v)| vec![(*what).to_owned(), format!("{v:.3}")]).collect();
        html.push_str(&table("Where the time went", &["stage", "seconds"], &rows));
    }
    let fit = input.findings.get("fit");
    let search = text(fit.and_then(|f| f.get("termination")));
    let (from, to) = (fit.and_then(|f| f.get("initial_cost")), fit.and_then(|f| f.get("final_cost")));
    html.push_str(&format!("<p>The search: {}; cost {} to {}.</p>", escape(&search), number(from, 1), number(to, 1)));
    let provenance = input.findings.get("provenance");
    let rows: Vec<Vec<String>> = items(provenance.and_then(|p| p.get("inputs")))
        .iter()
        .map(|one| vec![text(one.get("file")), text(one.get("sha256"))])
        .collect();
    html.push_str(&table("Input files", &["file", "SHA-256"], &rows));
    html.push_str(&format!(
        "<p class=\"note\">Solved by cellmap {}, reported by cellmap {}.</p>",
        escape(&text(provenance.and_then(|p| p.get("cellmap")))),
        crate::VERSION
    ));
    html
}
