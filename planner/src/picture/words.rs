//! Words in the picture, set with the font that is part of the program.

use plotters::backend::BitMapBackend;
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind, IntoDrawingArea};
use plotters::element::{Circle, Rectangle, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontStyle, IntoFont, RGBColor, TextStyle, register_font};

use super::PictureError;
use super::tints::{INK, Rgb, WHITE};

const FONT: &str = "DejaVu Sans";
const FONT_BYTES: &[u8] = include_bytes!("../../../report/fonts/DejaVuSans.ttf");
/// No caption is longer; what comes after it would not be read anyway.
const CHARACTERS_MAX: usize = 240;

/// A picture of three bytes a pixel, to write on.
pub(super) struct Page<'a> {
    area: DrawingArea<BitMapBackend<'a>, Shift>,
}

/// A sample in the legend.
#[derive(Debug, Clone, Copy)]
pub(super) enum Sample {
    Dot(i32, Rgb),
    Bar(i32, Rgb),
    Square(Rgb),
    Ring(Rgb),
}

type Failure = DrawingAreaErrorKind<<BitMapBackend<'static> as plotters::backend::DrawingBackend>::ErrorType>;

const fn ink([r, g, b]: Rgb) -> RGBColor {
    RGBColor(r, g, b)
}

fn style(size: i32, colour: Rgb, across: HPos) -> TextStyle<'static> {
    let plain = TextStyle::from((FONT, size).into_font());
    TextStyle { color: ink(colour).to_backend_color(), ..plain }.pos(Pos::new(across, VPos::Center))
}

impl<'a> Page<'a> {
    /// Writes on this buffer.
    pub(super) fn new(pixels: &'a mut [u8], width: usize, height: usize) -> Self {
        // A font that is part of the program and cannot be read leaves text out, and a test would say so.
        let _ = register_font(FONT, FontStyle::Normal, FONT_BYTES);
        Self { area: BitMapBackend::with_buffer(pixels, (width as u32, height as u32)).into_drawing_area() }
    }

    /// A word about `(x, y)` with a white edge, to be read on any ground.
    pub(super) fn haloed(&self, word: &str, (x, y): (i32, i32), size: i32, colour: Rgb) -> Result<(), PictureError> {
        let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (4 * dx, 4 * dy)));
        for (dx, dy) in around.filter(|offset| *offset != (0, 0)) {
            self.text(word, (x + dx, y + dy), style(size, WHITE, HPos::Center))?;
        }
        self.text(word, (x, y), style(size, colour, HPos::Center))
    }

    /// A line that begins at `(x, y)` and is cut to `width` pixels. Gives where it ends.
    pub(super) fn line(&self, line: &str, (x, y): (i32, i32), size: i32, width: i32) -> Result<i32, PictureError> {
        let style = style(size, INK, HPos::Left);
        let (line, taken) = self.cut(line, &style, width)?;
        self.text(&line, (x, y), style)?;
        Ok(x + taken)
    }

    /// As much of the text as fits into `width` pixels, without control characters, and what it takes.
    fn cut(&self, text: &str, style: &TextStyle<'_>, width: i32) -> Result<(String, i32), PictureError> {
        let readable = text.chars().map(|c| if c.is_control() { ' ' } else { c });
        let mut kept: String = readable.take(CHARACTERS_MAX).collect();
        let mut shown = kept.clone();
        if kept.len() < text.len() {
            shown.push('…');
        }
        loop {
            let taken = self.area.estimate_text_size(&shown, style).map_err(|e| failed(&e))?.0 as i32;
            if taken <= width || kept.pop().is_none() {
                return Ok((shown, taken));
            }
            shown = format!("{}…", kept.trim_end());
        }
    }

    fn text(&self, text: &str, at: (i32, i32), style: TextStyle<'static>) -> Result<(), PictureError> {
        self.area.draw(&Text::new(text.to_owned(), at, style)).map_err(|e| failed(&e))
    }

    /// A thin frame from corner to corner.
    pub(super) fn frame(&self, from: (i32, i32), to: (i32, i32)) -> Result<(), PictureError> {
        let thin = RGBColor(205, 205, 205).stroke_width(2);
        self.area.draw(&Rectangle::new([from, to], thin)).map_err(|e| failed(&e))
    }

    /// A sample that begins at `(x, y)`. Gives where it ends.
    pub(super) fn sample(&self, sample: Sample, (x, y): (i32, i32)) -> Result<i32, PictureError> {
        let drawn = match sample {
            Sample::Dot(radius, colour) => {
                self.area.draw(&Circle::new((x + radius, y), radius, ink(colour).filled())).map(|()| x + 2 * radius)
            }
            Sample::Bar(half, colour) => {
                let bar = Rectangle::new([(x, y - half), (x + 44, y + half)], ink(colour).filled());
                self.area.draw(&bar).map(|()| x + 44)
            }
            Sample::Square(colour) => self.square(colour, (x, y)).map(|()| x + 26),
            Sample::Ring(colour) => {
                let outer = Circle::new((x + 10, y), 10, ink(INK).filled());
                let inner = Circle::new((x + 10, y), 6, ink(colour).filled());
                self.area.draw(&outer).and_then(|()| self.area.draw(&inner)).map(|()| x + 20)
            }
        };
        drawn.map_err(|e| failed(&e))
    }

    fn square(&self, colour: Rgb, (x, y): (i32, i32)) -> Result<(), Failure> {
        let corners = [(x, y - 13), (x + 26, y + 13)];
        self.area.draw(&Rectangle::new(corners, ink(colour).filled()))?;
        self.area.draw(&Rectangle::new(corners, RGBColor(150, 150, 150).stroke_width(2)))
    }
}

fn failed(reason: &dyn std::fmt::Display) -> PictureError {
    PictureError::Drawing(reason.to_string())
}
