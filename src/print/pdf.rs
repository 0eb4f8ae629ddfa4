//! Pages as PDF, written by `pdf-writer`.

use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str, TextStr};

use super::arrange::Page;
use super::shapes::Shape;

/// Points a millimetre.
const POINTS: f64 = 72.0 / 25.4;

/// A PDF of pages in true size.
pub(super) fn write(pages: &[Page]) -> Vec<u8> {
    let mut pdf = Pdf::new();
    let mut next = 1;
    let mut take = || {
        next += 1;
        Ref::new(next - 1)
    };
    let (catalog, tree, font, info) = (take(), take(), take(), take());
    let references: Vec<(Ref, Ref)> = pages.iter().map(|_| (take(), take())).collect();
    let mut root = pdf.catalog(catalog);
    root.pages(tree);
    // Asks viewers not to scale; not all obey, which is what the ruler is for.
    root.viewer_preferences().pair(Name(b"PrintScaling"), Name(b"None"));
    root.finish();
    pdf.pages(tree).kids(references.iter().map(|(page, _)| *page)).count(pages.len() as i32);
    pdf.type1_font(font).base_font(Name(b"Helvetica")).encoding_predefined(Name(b"WinAnsiEncoding"));
    pdf.document_info(info).title(TextStr("cellmap targets")).creator(TextStr("cellmap"));
    for (page, (id, contents)) in pages.iter().zip(&references) {
        let [width, height] = page.size.map(|side| (side * POINTS) as f32);
        let mut out = pdf.page(*id);
        out.media_box(Rect::new(0.0, 0.0, width, height)).parent(tree).contents(*contents);
        out.resources().fonts().pair(Name(b"F1"), font);
        out.finish();
        let mut content = Content::new();
        let pen = Pen { height: page.size[1] };
        for shape in &page.shapes {
            pen.draw(shape, &mut content);
        }
        pdf.stream(*contents, &content.finish());
    }
    pdf.finish()
}

/// Turns millimetres with y down into points with y up.
struct Pen {
    height: f64,
}

impl Pen {
    fn at(&self, [x, y]: [f64; 2]) -> (f32, f32) {
        ((x * POINTS) as f32, ((self.height - y) * POINTS) as f32)
    }

    fn path(&self, points: &[[f64; 2]], content: &mut Content) {
        for (i, point) in points.iter().enumerate() {
            let (x, y) = self.at(*point);
            if i == 0 {
                content.move_to(x, y)
            } else {
                content.line_to(x, y)
            };
        }
    }

    fn draw(&self, shape: &Shape, content: &mut Content) {
        match shape {
            Shape::Fill { outlines, grey } => {
                content.set_fill_gray(*grey as f32);
                for outline in outlines {
                    self.path(outline, content);
                    content.close_path();
                }
                content.fill_nonzero();
            }
            Shape::Line { points, width, grey, dash } => {
                content.save_state().set_stroke_gray(*grey as f32).set_line_width((width * POINTS) as f32);
                if let Some(dash) = dash {
                    let length = (dash * POINTS) as f32;
                    content.set_dash_pattern([length, length], 0.0);
                }
                self.path(points, content);
                content.stroke().restore_state();
            }
            Shape::Text { at, size, grey, words } => {
                let (x, y) = self.at(*at);
                // The base fonts know WinAnsi only; a name from another script is spelt with question marks, the pattern is what counts.
                let bytes: Vec<u8> = words.chars().map(|c| if c.is_ascii() { c as u8 } else { b'?' }).collect();
                content.set_fill_gray(*grey as f32).begin_text();
                content.set_font(Name(b"F1"), (size * POINTS) as f32).next_line(x, y);
                content.show(Str(&bytes)).end_text();
            }
            Shape::Clipped { corner, size, shapes } => {
                let (x, y) = self.at([corner[0], corner[1] + size[1]]);
                content.save_state();
                content.rect(x, y, (size[0] * POINTS) as f32, (size[1] * POINTS) as f32);
                content.clip_nonzero().end_path();
                for shape in shapes {
                    self.draw(shape, content);
                }
                content.restore_state();
            }
        }
    }
}
