//! The arrays behind corners: filled as a file is read, put together from its parts, and put into order.

use super::corners::Appearance;

/// The arrays.
#[derive(Debug, Default)]
pub(super) struct Held {
    pub(super) appearances: Vec<Appearance>,
    /// By corner: what it is, a number of [`Names`].
    pub(super) marks: Vec<u32>,
    /// By corner: (u, v), px.
    pub(super) pixels: Vec<[f64; 2]>,
    /// By corner: (suu, suv, svv), px^2, zeros where there is none; empty where no corner has one.
    pub(super) covariances: Vec<[f64; 3]>,
}

impl Held {
    /// How many corners there are.
    pub(super) fn len(&self) -> usize {
        self.marks.len()
    }

    /// Makes room for so many corners more.
    pub(super) fn reserve(&mut self, more: usize) {
        self.marks.reserve(more);
        self.pixels.reserve(more);
    }

    /// Appends a corner of what `one` says was seen; `one`'s own corners are no matter.
    pub(super) fn push(&mut self, one: &Appearance, mark: u32, pixel: [f64; 2], covariance: Option<[f64; 3]>) {
        let corner = self.marks.len() as u32;
        match self.appearances.last_mut().filter(|last| last.key() == one.key()) {
            Some(last) => last.end = corner + 1,
            None => self.appearances.push(Appearance { start: corner, end: corner + 1, ..*one }),
        }
        if covariance.is_some() && self.covariances.is_empty() {
            self.covariances.resize(self.marks.len(), [0.0; 3]);
        }
        if covariance.is_some() || !self.covariances.is_empty() {
            self.covariances.push(covariance.unwrap_or_default());
        }
        self.marks.push(mark);
        self.pixels.push(pixel);
    }

    /// Appends all of another.
    pub(super) fn append(&mut self, other: &Self) {
        let before = self.marks.len();
        if !other.covariances.is_empty() {
            self.covariances.resize(before, [0.0; 3]);
            self.covariances.extend_from_slice(&other.covariances);
        } else if !self.covariances.is_empty() {
            self.covariances.resize(before + other.marks.len(), [0.0; 3]);
        }
        self.marks.extend_from_slice(&other.marks);
        self.pixels.extend_from_slice(&other.pixels);
        for one in &other.appearances {
            let (start, end) = (one.start + before as u32, one.end + before as u32);
            match self.appearances.last_mut().filter(|last| last.key() == one.key()) {
                Some(last) => last.end = end,
                None => self.appearances.push(Appearance { start, end, ..*one }),
            }
        }
    }

    /// Puts the corners into order; says whether all are different.
    pub(super) fn order(&mut self) -> bool {
        if self.is_ascending() {
            return true;
        }
        let mut appearances = std::mem::take(&mut self.appearances);
        // Stable, so that corners given twice keep the order in which they were given.
        appearances.sort_by_key(Appearance::key);
        let old = std::mem::take(self);
        let mut numbers: Vec<u32> = Vec::new();
        for same in appearances.chunk_by(|a, b| a.key() == b.key()) {
            numbers.clear();
            same.iter().for_each(|one| numbers.extend(one.start..one.end));
            numbers.sort_by_key(|corner| old.marks[*corner as usize]);
            for corner in numbers.iter().map(|corner| *corner as usize) {
                let covariance = old.covariances.get(corner).copied().filter(|covariance| covariance[0] != 0.0);
                self.push(&same[0], old.marks[corner], old.pixels[corner], covariance);
            }
        }
        self.is_ascending()
    }

    /// Whether the corners are in order and no two are the same.
    pub(super) fn is_ascending(&self) -> bool {
        let in_order = |one: &Appearance| self.marks[one.corners()].is_sorted_by(|a, b| a < b);
        self.appearances.is_sorted_by(|a, b| a.key() < b.key()) && self.appearances.iter().all(in_order)
    }
}
