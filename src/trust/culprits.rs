//! Measurements that were set aside, and why: which tag was misread, which corner dragged, which picture or line of a log is another's.
//!
//! Everything is judged at the solution, which the others agree on: a tag that is not where its id says is looked for at the places of all other
//! tags; corners that begin elsewhere at their own; a picture, or a line of a joint log, at all other configurations.

use std::collections::{BTreeMap, BTreeSet};

use super::fault::{Action, Fault, FaultKind};
use super::flipped::flipped_poses;
use super::lines::wrong_lines;
use super::sightings::{Sighting, between};
use super::things::{Thing, name, tag_of, tags_seen, things};
use super::undetermined::Evidence;
use crate::geometry::{Feature, Pattern, TargetGeometry};

/// A corner this near (px) to a place belongs there, if the fit is better than that.
const NEAR: f64 = 3.0;
/// A tag that was another one in so many pictures, and in this share of all, always is.
const ALWAYS_LEAST: usize = 5;
const ALWAYS: f64 = 0.8;
/// Cases of one kind that are told one by one.
pub(super) const TOLD: usize = 3;

/// Cases of one kind, told together.
#[derive(Default)]
struct Cases {
    told: Vec<String>,
    pictures: BTreeSet<(usize, u64, u64)>,
    things: BTreeMap<String, usize>,
    count: usize,
}

impl Cases {
    fn add(&mut self, evidence: &Evidence<'_>, thing: &Thing<'_>, words: String) {
        if self.told.len() < TOLD {
            self.told.push(words);
        }
        self.pictures.insert(thing.of.picture());
        *self.things.entry(thing.name(evidence)).or_default() += 1;
        self.count += 1;
    }

    fn fault(self, kind: FaultKind, what: &str, remedy: &str) -> Option<Fault> {
        let most = self.things.iter().max_by_key(|(_, count)| **count)?;
        let whose = if self.things.len() == 1 { most.0.clone() } else { format!("most often {} ({})", most.0, most.1) };
        let more = if self.count > self.told.len() { "; and more" } else { "" };
        Some(Fault {
            kind,
            what: format!(
                "{} {what} in {} picture{}: {whose}",
                self.count,
                self.pictures.len(),
                if self.pictures.len() == 1 { "" } else { "s" }
            ),
            evidence: format!("{}{more}", self.told.join("; ")),
            remedy: remedy.to_owned(),
            action: Action::Excluded,
        })
    }
}

/// Explains what was set aside at a solution that most measurements agree on. `rms_px` is the residual of what fits.
#[must_use]
pub fn culprits(evidence: &Evidence<'_>, sightings: &[Vec<Sighting>], rms_px: Option<f64>) -> Vec<Fault> {
    let near = NEAR.max(6.0 * rms_px.unwrap_or(0.0));
    let things = things(evidence);
    let (mut faults, bad_lines) = wrong_lines(evidence, sightings);
    let pictures = wrong_pictures(evidence, &things, &bad_lines, near);
    let [mut wrong, mut flipped, mut dragged, mut other] = std::array::from_fn(|_| Cases::default());
    for thing in things.iter().filter(|thing| thing.aside.contains(&true)) {
        if bad_lines.contains(&thing.configuration) || pictures.1.contains(&thing.of.picture()) {
            continue;
        }
        let (whole, picture) = (thing.name(evidence), thing.picture(evidence));
        if let Some(apart) = begins_elsewhere(evidence, thing).filter(|apart| *apart < near) {
            let own = mean(&thing.off);
            let words = format!(
                "at {picture}, {whole} fits to {apart:.1} px with its corners in another order, and to {own:.0} px as they are"
            );
            flipped.add(evidence, thing, words);
        } else if thing.wholly_aside()
            && let Some((other, apart)) = read_as_another(evidence, thing).filter(|(_, apart)| *apart < near)
        {
            let own = mean(&thing.off);
            let words = format!(
                "at {picture}, what was read as {whole} is {other} ({apart:.1} px from there, {own:.0} px from its own place)"
            );
            wrong.add(evidence, thing, words);
        } else if !thing.wholly_aside() {
            let worst = thing.off.iter().zip(&thing.aside).filter(|(_, aside)| **aside).filter_map(|(off, _)| *off);
            let worst = worst.fold(0.0, f64::max);
            dragged.add(evidence, thing, format!("at {picture}, {whole} by {worst:.1} px"));
        } else {
            let words = match mean(&thing.off) {
                off if off.is_finite() => format!("at {picture}, {whole} by {off:.1} px"),
                _ => format!("at {picture}, {whole}, which the camera could not see there"),
            };
            other.add(evidence, thing, words);
        }
    }
    // A tag that is nearly always another one is no misreading: the ids are wrong.
    let seen = if wrong.things.is_empty() { BTreeMap::new() } else { tags_seen(evidence) };
    let always: Vec<String> = wrong
        .things
        .iter()
        .filter(|(name, count)| **count >= ALWAYS_LEAST && **count as f64 >= ALWAYS * seen[*name] as f64)
        .map(|(name, _)| name.clone())
        .collect();
    let again = "look at the pictures (`cellmap detect --draw DIR`)";
    faults.extend(pictures.0);
    if !always.is_empty()
        && let Some(fault) = std::mem::take(&mut wrong).fault(
            FaultKind::WrongId,
            "tags bear another id than the layout says",
            "exchange the ids in the layout, or give the target the tags that it was designed with",
        )
    {
        let what = format!("{}; always {}", fault.what, always.join(", "));
        faults.push(Fault { what, action: Action::Refused, ..fault });
    }
    faults.extend(wrong.fault(
        FaultKind::WrongId,
        "tags were read with a wrong id",
        &format!("{again}: print tags larger or of a dictionary with fewer tags, and no id twice"),
    ));
    faults.extend(flipped_poses(evidence, sightings).into_iter().chain(flipped.fault(
        FaultKind::Flipped,
        "targets are turned in themselves",
        &format!("{again}: a detector must report the corners from the top left, clockwise"),
    )));
    faults.extend(other.fault(
        FaultKind::Unexplained,
        "tags or boards are not where they should be",
        &format!("{again}; check what their targets are mounted on, and that they stood still"),
    ));
    faults.extend(dragged.fault(
        FaultKind::DraggedCorner,
        "tags or boards have single corners that are off",
        &format!("{again} for shadows, reflections or things in the way"),
    ));
    faults
}

fn mean(off: &[Option<f64>]) -> f64 {
    let known: Vec<f64> = off.iter().flatten().copied().collect();
    if known.is_empty() { f64::INFINITY } else { known.iter().sum::<f64>() / known.len() as f64 }
}

fn family(evidence: &Evidence<'_>, target: usize) -> Option<&'static str> {
    match &evidence.layout.targets[target].pattern {
        Some(Pattern::Tags { dictionary, .. }) => Some(dictionary.family()),
        _ => None,
    }
}

/// Where the solution has a feature in a camera's picture at a configuration.
fn expected(
    evidence: &Evidence<'_>,
    camera: usize,
    target: usize,
    feature: &Feature,
    configuration: usize,
) -> Option<[f64; 2]> {
    let lens = evidence.layout.cameras[camera].intrinsics.as_ref()?.with_parameters(evidence.state.lenses[camera]);
    let (frame, place) = evidence.tree.locate(evidence.layout, target, feature)?;
    let pose = between(evidence, evidence.tree.cameras[camera], frame, configuration)?;
    let at = lens.project(&(pose * place))?;
    Some([at.x, at.y])
}

/// Mean distance (px) of measured corners of a camera (rows of the recording) from where features of another place or time would be; none if one
/// cannot be seen.
fn apart(
    evidence: &Evidence<'_>,
    camera: usize,
    rows: impl Iterator<Item = (usize, usize, Feature)>,
    configuration: usize,
) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for (row, target, feature) in rows {
        let at = expected(evidence, camera, target, &feature, configuration)?;
        let pixel = evidence.recording.corners.pixels()[row];
        sum += (at[0] - pixel[0]).hypot(at[1] - pixel[1]);
        count += 1;
    }
    (count > 0).then(|| sum / f64::from(count))
}

/// Whether a tag is turned by a quarter or more, or a board by a half: the distance in the best other order.
fn begins_elsewhere(evidence: &Evidence<'_>, thing: &Thing<'_>) -> Option<f64> {
    let target = thing.of.target;
    // Other first corners of a tag; a board's last corner in the place of its first.
    let geometry = &evidence.layout.targets[target].geometry;
    let orders: u8 = match (thing.first(evidence), geometry) {
        (Feature::TagCorner(..), _) if thing.rows.len() == 4 => 3,
        (Feature::BoardCorner(_), TargetGeometry::Board { .. }) => 1,
        _ => return None,
    };
    let ordered = |order: u8, feature: &Feature| match (feature, geometry) {
        (Feature::TagCorner(id, corner), _) => Feature::TagCorner(*id, (corner + order) % 4),
        (Feature::BoardCorner(corner), TargetGeometry::Board { columns, rows, .. }) => {
            Feature::BoardCorner((columns * rows) as u32 - 1 - corner)
        }
        (other, _) => other.clone(),
    };
    // A board's own symmetry has been dealt with before; turned corners are mostly set aside.
    if thing.aside.iter().filter(|aside| **aside).count() * 2 < thing.rows.len() {
        return None;
    }
    let best = (1..=orders).filter_map(|order| {
        let rows = thing.features(evidence).map(|(row, feature)| (row, target, ordered(order, feature)));
        apart(evidence, thing.of.camera, rows, thing.configuration)
    });
    best.reduce(f64::min)
}

/// The tag of the cell at whose place a tag was seen.
fn read_as_another(evidence: &Evidence<'_>, thing: &Thing<'_>) -> Option<(String, f64)> {
    let (first, here) = (thing.first(evidence), thing.of.target);
    let own = tag_of(first)?;
    let family_here = family(evidence, here)?;
    let mut best: Option<(String, f64)> = None;
    for (target, other) in evidence.layout.targets.iter().enumerate() {
        let TargetGeometry::Tags(faces) = &other.geometry else { continue };
        if family(evidence, target) != Some(family_here) {
            continue;
        }
        for face in faces.iter().filter(|face| (target, face.id) != (here, own)) {
            let there = |feature: &Feature| match feature {
                Feature::TagCorner(_, corner) => Feature::TagCorner(face.id, *corner),
                other => other.clone(),
            };
            let rows = thing.features(evidence).map(|(row, feature)| (row, target, there(feature)));
            if let Some(apart) = apart(evidence, thing.of.camera, rows, thing.configuration)
                && best.as_ref().is_none_or(|(_, known)| apart < *known)
            {
                best = Some((name(evidence, target, &there(first)), apart));
            }
        }
    }
    best
}

/// Pictures of which nothing fits, although the same cameras and robots agree elsewhere: pictures of another configuration.
fn wrong_pictures(
    evidence: &Evidence<'_>,
    things: &[Thing<'_>],
    bad_lines: &BTreeSet<usize>,
    near: f64,
) -> (Vec<Fault>, BTreeSet<(usize, u64, u64)>) {
    let mut pictures: BTreeMap<(usize, u64, u64), Vec<&Thing<'_>>> = BTreeMap::new();
    for thing in things.iter().filter(|thing| !bad_lines.contains(&thing.configuration)) {
        pictures.entry(thing.of.picture()).or_default().push(thing);
    }
    let (mut shown, mut found) = (BTreeMap::<usize, Vec<(u64, u64, String)>>::new(), BTreeSet::new());
    for (picture, things) in pictures {
        // Things that stand still before a camera that stands still look the same at every configuration.
        let moving: Vec<&&Thing<'_>> = things
            .iter()
            .filter(|thing| {
                let from = evidence.tree.cameras[thing.of.camera];
                let located = evidence.tree.locate(evidence.layout, thing.of.target, thing.first(evidence));
                located.is_some_and(|(to, _)| !evidence.tree.path(from, to).is_static())
            })
            .collect();
        if moving.is_empty() || !moving.iter().all(|thing| thing.wholly_aside()) {
            continue;
        }
        let rows = || {
            let of = |thing: &&&Thing<'_>| {
                let target = thing.of.target;
                thing.features(evidence).map(move |(row, feature)| (row, target, feature.clone())).collect::<Vec<_>>()
            };
            moving.iter().flat_map(of)
        };
        let camera = picture.0;
        let own = moving[0].configuration;
        let others = (0..evidence.plan.configurations.len()).filter(|c| *c != own);
        let best =
            others.filter_map(|c| Some((c, apart(evidence, camera, rows(), c)?))).min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((other, apart_there)) = best.filter(|(_, apart)| *apart < near) else { continue };
        let own_apart = apart(evidence, camera, rows(), own).unwrap_or(f64::INFINITY);
        found.insert(picture);
        let words =
            format!("its corners are {apart_there:.1} px from where they were there, {own_apart:.0} px from here");
        shown.entry(picture.0).or_default().push((picture.1, evidence.plan.configurations[other], words));
    }
    let faults = shown.into_iter().map(|(camera, cases)| {
        let camera = &evidence.layout.cameras[camera].name;
        let all: Vec<String> = cases.iter().map(|(own, other, _)| format!("that for {own} shows {other}")).collect();
        let more = if cases.len() > 2 * TOLD { " and more" } else { "" };
        Fault {
            kind: FaultKind::WrongPicture,
            what: format!(
                "{} picture{} of `{camera}` show{} another configuration: {}{more}",
                cases.len(),
                if cases.len() == 1 { "" } else { "s" },
                if cases.len() == 1 { "s" } else { "" },
                all[..all.len().min(2 * TOLD)].join(", ")
            ),
            evidence: format!("at {}, {}", cases[0].0, cases[0].2),
            remedy: "check the names of the pictures".to_owned(),
            action: Action::Excluded,
        }
    });
    (faults.collect(), found)
}
