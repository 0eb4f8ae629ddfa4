//! Targets of which no tag was seen in any picture, while the pictures are full of tags of another dictionary.

use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

use crate::complaint::list;
use crate::detect::{Detector, GreyPicture, Lens, Pattern};
use crate::geometry::Intrinsics;
use crate::geometry::dictionary::Dictionary;
use crate::layout::Layout;
use crate::layout::images::PictureFile;
use crate::trust::{Action, Fault, FaultKind};

/// Pictures that are looked at again, spread evenly.
const LOOKED_AT: usize = 8;
/// Tags of another dictionary that are no accident: in so many pictures, and so many a picture.
const PICTURES: usize = 2;
const TAGS: usize = 2;

/// The dictionary of which the pictures show most, for targets (places in the layout) of which nothing was found.
pub(super) fn wrong_dictionary(
    layout: &Layout,
    detector: &dyn Detector,
    pictures: &[(usize, &PictureFile)],
    missing: &[usize],
) -> Option<Fault> {
    let given: BTreeSet<&str> =
        missing.iter().filter_map(|target| Some(dictionary(layout, *target)?.family())).collect();
    if given.is_empty() {
        return None;
    }
    let used: BTreeSet<&str> =
        (0..layout.targets.len()).filter_map(|t| Some(dictionary(layout, t)?.family())).collect();
    // Of each family the largest, which holds the tags of all.
    let mut families: BTreeMap<&str, Dictionary> = BTreeMap::new();
    for dictionary in Dictionary::all().filter(|dictionary| !used.contains(dictionary.family())) {
        let known = families.entry(dictionary.family()).or_insert(dictionary);
        if dictionary.tag_count() > known.tag_count() {
            *known = dictionary;
        }
    }
    let wanted: Vec<Pattern> = families
        .values()
        .map(|dictionary| Pattern::Tags { dictionary: *dictionary, ids: (0..dictionary.tag_count()).collect() })
        .collect();
    let stride = pictures.len().div_ceil(LOOKED_AT).max(1);
    let looked: Vec<&(usize, &PictureFile)> = pictures.iter().step_by(stride).collect();
    let seen: Vec<BTreeSet<(usize, u32)>> = looked
        .par_iter()
        .map(|(camera, file)| {
            let intrinsics = layout.cameras[*camera].intrinsics.as_ref();
            let picture = GreyPicture::read(&file.path, intrinsics.map(Intrinsics::size)).ok();
            let corners =
                picture.and_then(|picture| detector.detect(&picture, intrinsics.map(|i| i as &dyn Lens), &wanted).ok());
            corners.into_iter().flatten().filter_map(|corner| Some((corner.pattern, corner.tag?))).collect()
        })
        .collect();
    let mut best: Option<(usize, usize, usize)> = None;
    for pattern in 0..wanted.len() {
        let counts = seen.iter().map(|tags| tags.iter().filter(|(of, _)| *of == pattern).count());
        let (pictures, tags) = counts.filter(|count| *count > 0).fold((0, 0), |(p, t), count| (p + 1, t + count));
        if pictures >= PICTURES && tags >= TAGS * pictures && best.is_none_or(|(_, _, most)| tags > most) {
            best = Some((pattern, pictures, tags));
        }
    }
    let (pattern, in_pictures, tags) = best?;
    let ids: BTreeSet<u32> = seen.iter().flatten().filter(|(of, _)| *of == pattern).map(|(_, id)| *id).collect();
    let family = wanted.get(pattern).and_then(|pattern| match pattern {
        Pattern::Tags { dictionary, .. } => Some(dictionary.family()),
        Pattern::Checkerboard { .. } | Pattern::Charuco { .. } => None,
    })?;
    let greatest = ids.last().copied().unwrap_or(0);
    let fits = |dictionary: &Dictionary| dictionary.family() == family && dictionary.tag_count() > greatest;
    let found = Dictionary::all().filter(fits).min_by_key(|dictionary| dictionary.tag_count())?;
    let names = list(missing.iter().map(|target| layout.targets[*target].name.as_str()));
    let shown: Vec<String> = ids.iter().take(10).map(u32::to_string).collect();
    let more = if ids.len() > shown.len() { " and more" } else { "" };
    Some(Fault {
        kind: FaultKind::WrongDictionary,
        what: format!(
            "no tag of {names} was found in any picture, but the pictures show tags of the dictionary {}",
            found.name()
        ),
        evidence: format!(
            "{tags} of them in {in_pictures} of {} pictures, ids {}{more}",
            looked.len(),
            shown.join(", ")
        ),
        remedy: format!("write `dictionary: {}` if that is what is printed, and check the ids", found.name()),
        action: Action::Refused,
    })
}

fn dictionary(layout: &Layout, target: usize) -> Option<Dictionary> {
    match layout.targets[target].pattern {
        Some(Pattern::Tags { dictionary, .. } | Pattern::Charuco { dictionary, .. }) => Some(dictionary),
        Some(Pattern::Checkerboard { .. }) | None => None,
    }
}
