//! A picture of several panels with text, for writing as PNG.

use plotters::backend::BitMapBackend;
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::element::{Circle, Rectangle, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, FontStyle, IntoFont, RGBColor, TextStyle, register_font};
use program::{ExitCode, Failure};

use super::canvas::{Canvas, INK, WHITE};
use super::layer::{MEAN_OF, Rgb, means};
use crate::figure::{FONT, FONT_BYTES};

/// Maximum length of a line of text.
const CHARACTERS_MAX: usize = 160;

type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;
type Drawn<T> = Result<T, Failure>;

/// A picture. All lengths refer to the large picture, twice as wide and high as the PNG.
#[derive(Debug)]
pub struct Sheet {
    pixels: Vec<u8>,
    size: [usize; 2],
}

/// A label centred on a point, with a white edge for any background.
#[derive(Debug, Clone)]
pub struct Word {
    /// The text.
    pub text: String,
    /// Its centre.
    pub at: (i32, i32),
    /// Its height.
    pub size: i32,
    /// Its colour.
    pub colour: Rgb,
}

/// A symbol of the legend.
#[derive(Debug, Clone, Copy)]
pub enum Symbol {
    /// A dot with this radius.
    Dot(i32, Rgb),
    /// A thick line with this half height.
    Bar(i32, Rgb),
    /// A square with an outline.
    Square(Rgb),
    /// A dot with a dark ring.
    Ring(Rgb),
}

impl Sheet {
    /// A white sheet.
    #[must_use]
    pub fn new(size: [usize; 2]) -> Self {
        Self { pixels: vec![255; 3 * size[0] * size[1]], size }
    }

    /// Copies a canvas to a position (its upper left corner), frames it, and writes its name and labels; the first
    /// label is on top.
    ///
    /// # Errors
    /// If the drawing library fails.
    pub fn panel(&mut self, canvas: &Canvas, [left, top]: [usize; 2], name: &str, words: &[Word]) -> Drawn<()> {
        let (width, height) = (canvas.sheet.width, canvas.sheet.height);
        for (row, colours) in canvas.sheet.colour.chunks_exact(width).enumerate() {
            let start = 3 * ((top + row) * self.size[0] + left);
            self.pixels[start..start + 3 * width].copy_from_slice(colours.as_flattened());
        }
        let (area, [left, top]) = (self.area(), [left as i32, top as i32]);
        let frame = [(left, top), (left + width as i32 - 1, top + height as i32 - 1)];
        area.draw(&Rectangle::new(frame, ink([205; 3]).stroke_width(2))).map_err(|e| failed(&e))?;
        text(&area, name, (left + 20, top + 34), style(28, INK, HPos::Left))?;
        for Word { text: word, at: (x, y), size, colour } in words.iter().rev() {
            let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (4 * dx, 4 * dy)));
            for (dx, dy) in around.filter(|offset| *offset != (0, 0)) {
                text(&area, word, (left + x + dx, top + y + dy), style(*size, WHITE, HPos::Center))?;
            }
            text(&area, word, (left + x, top + y), style(*size, *colour, HPos::Center))?;
        }
        Ok(())
    }

    /// A line of text that begins at `(x, y)`, cut if it is long.
    ///
    /// # Errors
    /// If the drawing library fails.
    pub fn line(&mut self, line: &str, at: (i32, i32), size: i32) -> Drawn<()> {
        let mut shown: String =
            line.chars().take(CHARACTERS_MAX).map(|c| if c.is_control() { ' ' } else { c }).collect();
        if shown.len() < line.len() {
            shown.push('…');
        }
        text(&self.area(), &shown, at, style(size, INK, HPos::Left))
    }

    /// Symbols with their meanings, side by side from `(x, y)`.
    ///
    /// # Errors
    /// If the drawing library fails.
    pub fn legend(&mut self, entries: &[(Symbol, &str)], (mut x, y): (i32, i32), size: i32) -> Drawn<()> {
        let area = self.area();
        let style = style(size, INK, HPos::Left);
        for (symbol, name) in entries {
            x += drawn(&area, *symbol, (x, y))? + 14;
            text(&area, name, (x, y), style.clone())?;
            x += area.estimate_text_size(name, &style).map_err(|e| failed(&e))?.0 as i32 + 46;
        }
        Ok(())
    }

    /// The picture as PNG.
    ///
    /// # Errors
    /// If the encoder fails.
    pub fn png(&self) -> Drawn<Vec<u8>> {
        png(&means(&self.pixels, self.size[0]), self.size.map(|side| side / MEAN_OF))
    }

    fn area(&mut self) -> Area<'_> {
        // If the built-in font cannot be read, text is omitted; a test would notice.
        let _ = register_font(FONT, FontStyle::Normal, FONT_BYTES);
        let [width, height] = self.size.map(|side| side as u32);
        BitMapBackend::with_buffer(&mut self.pixels, (width, height)).into_drawing_area()
    }
}

const fn ink([r, g, b]: Rgb) -> RGBColor {
    RGBColor(r, g, b)
}

fn style(size: i32, colour: Rgb, across: HPos) -> TextStyle<'static> {
    let plain = TextStyle::from((FONT, size).into_font());
    TextStyle { color: ink(colour).to_backend_color(), ..plain }.pos(Pos::new(across, VPos::Center))
}

fn text(area: &Area<'_>, text: &str, at: (i32, i32), style: TextStyle<'static>) -> Drawn<()> {
    area.draw(&Text::new(text.to_owned(), at, style)).map_err(|e| failed(&e))
}

/// Draws a symbol at `(x, y)` and returns its width.
fn drawn(area: &Area<'_>, symbol: Symbol, (x, y): (i32, i32)) -> Drawn<i32> {
    let dot = |middle: i32, radius: i32, colour: Rgb| {
        area.draw(&Circle::new((middle, y), radius, ink(colour).filled())).map_err(|e| failed(&e))
    };
    let bar = |half: i32, width: i32, colour: Rgb| {
        area.draw(&Rectangle::new([(x, y - half), (x + width, y + half)], ink(colour).filled())).map_err(|e| failed(&e))
    };
    Ok(match symbol {
        Symbol::Dot(radius, colour) => dot(x + radius, radius, colour).map(|()| 2 * radius)?,
        Symbol::Bar(half, colour) => bar(half, 44, colour).map(|()| 44)?,
        Symbol::Square(colour) => {
            bar(13, 26, [150; 3])?;
            let inner = Rectangle::new([(x + 2, y - 11), (x + 24, y + 11)], ink(colour).filled());
            area.draw(&inner).map_err(|e| failed(&e)).map(|()| 26)?
        }
        Symbol::Ring(colour) => dot(x + 10, 10, INK).and_then(|()| dot(x + 10, 6, colour)).map(|()| 20)?,
    })
}

fn failed(reason: &dyn std::fmt::Display) -> Failure {
    Failure::new(ExitCode::Internal, format!("failed to draw the picture: {reason}"))
}

/// A PNG of three bytes a pixel.
///
/// # Errors
/// If the encoder fails.
pub fn png(pixels: &[u8], [width, height]: [usize; 2]) -> Drawn<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(|e| failed(&e))?;
    writer.write_image_data(pixels).and_then(|()| writer.finish()).map_err(|e| failed(&e))?;
    Ok(bytes)
}
