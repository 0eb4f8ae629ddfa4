//! cellmap's own finder of square tags.
//!
//! One pass over the picture, then work only where there is something:
//!
//! 1. [`tiles`]: a threshold for every 8 x 8 pixels that have contrast around them.
//! 2. [`components`]: dark and bright patches, from runs of pixels, with the extents of those of a tag's size.
//! 3. [`outline`]: the quadrangle that a patch fills, if it fills one, settled on the grey values.
//! 4. [`reading`] and [`codebook`]: its rings, its cells, its id.
//! 5. [`shade`]: the same once more, by thresholds of their own, where something may stand in the shade of something bright.
//!
//! Checkerboards: [`crossings`] are where their corners may be, [`grid`] puts them together.
//!
//! Pictures that show the same are known by their tiles ([`Sight`]) and need not be searched twice.
//!
//! Corners are then measured by [`super::edge_lines`] like those of any finder. Nothing is kept between pictures.

mod codebook;
mod components;
mod crossings;
mod darker;
mod grid;
mod outline;
mod reading;
mod shade;
mod sight;
mod tiles;

use super::checkerboard;
use super::patterns::{Finder, FoundTag, detect_with};
use super::picture::GreyPicture;
use super::{Corner, DetectError, Detector, Dictionary, Expected, ExpectedTag, KnownTag, Lens, Pattern};
use codebook::Codebook;
use components::Wanted;
use outline::Quad;
pub use sight::Sight;
use tiles::Tiles;

/// Tags, checkerboards and ChArUco boards without any library. Free to make and to share.
#[derive(Debug, Clone, Copy, Default)]
pub struct NativeDetector {
    inverted: bool,
}

impl NativeDetector {
    /// Finds tags as their family prints them.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Finds tags printed with black and white exchanged too. The search then takes up to twice as long.
    #[must_use]
    pub fn with_inverted() -> Self {
        Self { inverted: true }
    }

    /// Every tag of some dictionaries in a picture, an id as often as it is seen; in the order of `dictionaries`.
    ///
    /// Corners are within a third of a pixel or so. The search costs the same for many dictionaries as for one.
    #[must_use]
    pub fn find_tags(&self, picture: &GreyPicture, dictionaries: &[Dictionary]) -> Vec<Vec<FoundTag>> {
        let books: Vec<&Codebook> = dictionaries.iter().map(|dictionary| Codebook::of(*dictionary)).collect();
        let mut found: Vec<Vec<FoundTag>> = vec![Vec::new(); books.len()];
        let extremes = tiles::tile_extremes(picture);
        let tiles = tiles::tiles(&extremes);
        self.look(picture, &tiles, &books, false, &mut found);
        if let Some(shade) = shade::in_shade(picture, &extremes, &tiles) {
            self.look(picture, &shade, &books, true, &mut found);
        }
        found
    }

    /// Adds what is found by some thresholds and was not found before; `doubtful` if they were taken of little.
    fn look(
        &self,
        picture: &GreyPicture,
        tiles: &Tiles,
        books: &[&Codebook],
        doubtful: bool,
        found: &mut [Vec<FoundTag>],
    ) {
        let looked_for = |book: &Codebook, bright: bool| self.inverted || book.bright_inside == bright;
        let [dark, bright] = [false, true].map(|bright| books.iter().any(|book| looked_for(book, bright)));
        let fewest_cells = books.iter().map(|book| book.edge).min().unwrap_or(0);
        let [dark, bright] = components::patches(picture, tiles, Wanted { dark, bright, fewest_cells });
        let known: Vec<Quad> = found.iter().flatten().map(|tag| tag.corners).collect();
        let mut hull = Vec::new();
        let mut reader = reading::Reader::default();
        for (patches, bright_inside) in [(dark, false), (bright, true)] {
            for patch in patches.iter() {
                let Some(quad) = outline::quadrangle(&patch, &mut hull) else { continue };
                if !reading::large_enough(&quad, fewest_cells) || known.iter().any(|known| outline::same(known, &quad))
                {
                    continue;
                }
                let Some(quad) = outline::settle(picture, quad, bright_inside) else { continue };
                let suited = books.iter().zip(found.iter_mut()).filter(|(book, _)| looked_for(book, bright_inside));
                for (book, found) in suited {
                    if let Some(read) = reader.read(picture, quad, bright_inside, book, doubtful) {
                        found.push(FoundTag { id: read.id, corners: read.corners, bright_inside, close: true });
                    }
                }
            }
        }
    }

    /// The tag that is expected, if it is there: its border within a few pixels of where it is expected, its cells, its first corner.
    #[must_use]
    pub fn verify(&self, picture: &GreyPicture, expected: &ExpectedTag) -> Option<FoundTag> {
        // A prediction may be anything; a tag that is seen lies in the picture.
        let extent = [picture.width() as f64, picture.height() as f64];
        let inside = |corner: &[f64; 2]| (0..2).all(|axis| (-4.0..extent[axis] + 4.0).contains(&corner[axis]));
        if !expected.corners.iter().all(inside) {
            return None;
        }
        let book = Codebook::of(expected.dictionary);
        let mut reader = reading::Reader::default();
        let shades = [book.bright_inside, !book.bright_inside];
        shades.into_iter().take(if self.inverted { 2 } else { 1 }).find_map(|bright_inside| {
            let quad = outline::settle(picture, expected.corners, bright_inside)?;
            let read = reader.read(picture, quad, bright_inside, book, false)?;
            // Its first corner is the one that was expected.
            (read.id == expected.id && read.corners == quad).then_some(FoundTag {
                id: read.id,
                corners: quad,
                bright_inside,
                close: true,
            })
        })
    }

    /// A checkerboard's rough corners in canonical order, if a believable one is in the picture.
    #[must_use]
    pub fn find_checkerboard(&self, picture: &GreyPicture, columns: usize, rows: usize) -> Option<Vec<[f64; 2]>> {
        let crossings = crossings::crossings(picture, &tiles::tiles(&tiles::tile_extremes(picture)));
        grid::grid(&crossings, columns, rows)
            .filter(|grid| checkerboard::plausible(picture, grid, columns, rows))
            .and_then(|grid| checkerboard::canonical(picture, &grid, columns, rows))
            .map(|canonical| canonical.corners)
    }
}

impl Finder for NativeDetector {
    fn tags(&self, picture: &GreyPicture, dictionaries: &[Dictionary]) -> Result<Vec<Vec<FoundTag>>, DetectError> {
        Ok(self.find_tags(picture, dictionaries))
    }

    fn checkerboard(
        &self,
        picture: &GreyPicture,
        columns: usize,
        rows: usize,
    ) -> Result<Option<Vec<[f64; 2]>>, DetectError> {
        Ok(self.find_checkerboard(picture, columns, rows))
    }
}

/// A detector that was told what to expect.
struct Told<'a> {
    detector: &'a NativeDetector,
    expected: &'a Expected,
}

impl Finder for Told<'_> {
    fn tags(&self, picture: &GreyPicture, dictionaries: &[Dictionary]) -> Result<Vec<Vec<FoundTag>>, DetectError> {
        let mut verified: Vec<Vec<FoundTag>> = vec![Vec::new(); dictionaries.len()];
        for tag in &self.expected.tags {
            let Some(place) = dictionaries.iter().position(|dictionary| *dictionary == tag.dictionary) else {
                continue;
            };
            // What shows the same as where it was read need not be read again.
            let known = self.expected.known.iter().find(|known| known.tag() == tag);
            let found = known.and_then(|known| known.found_in(picture));
            match found.or_else(|| self.detector.verify(picture, tag)) {
                Some(found) => verified[place].push(found),
                None => return self.detector.tags(picture, dictionaries),
            }
        }
        if self.expected.all { Ok(verified) } else { self.detector.tags(picture, dictionaries) }
    }

    fn checkerboard(
        &self,
        picture: &GreyPicture,
        columns: usize,
        rows: usize,
    ) -> Result<Option<Vec<[f64; 2]>>, DetectError> {
        self.detector.checkerboard(picture, columns, rows)
    }
}

impl Detector for NativeDetector {
    fn name(&self) -> &'static str {
        if self.inverted { "native, inverted too" } else { "native" }
    }

    fn detect(
        &self,
        picture: &GreyPicture,
        lens: Option<&dyn Lens>,
        wanted: &[Pattern],
    ) -> Result<Vec<Corner>, DetectError> {
        detect_with(self, picture, lens, wanted, &[], None)
    }

    fn detect_expected(
        &self,
        picture: &GreyPicture,
        lens: Option<&dyn Lens>,
        wanted: &[Pattern],
        expected: &Expected,
    ) -> Result<Vec<Corner>, DetectError> {
        detect_with(&Told { detector: self, expected }, picture, lens, wanted, &expected.known, None)
    }

    fn detect_known(
        &self,
        picture: &GreyPicture,
        lens: Option<&dyn Lens>,
        wanted: &[Pattern],
        expected: &Expected,
    ) -> Result<(Vec<Corner>, Vec<KnownTag>), DetectError> {
        let mut keep = Vec::new();
        let finder = Told { detector: self, expected };
        let corners = detect_with(&finder, picture, lens, wanted, &expected.known, Some(&mut keep))?;
        Ok((corners, keep))
    }
}
