//! Figures: bars and lines in axes, as SVG. A figure's bytes are a pure function of what it shows, for its
//! text is set with the font in `report/fonts`, not with the system's.

use plotters::coord::Shift;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::register_font;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use program::{ExitCode, Failure};

/// A colour: red, green, blue.
pub use plotters::prelude::RGBColor as Colour;

/// A figure. Words in parentheses, in labels and in the legend, are left out; captions have them.
#[derive(Debug, Clone)]
pub struct Figure {
    /// The line above all.
    pub title: String,
    /// The horizontal axis.
    pub x: Scale,
    /// The vertical axis.
    pub y: Scale,
    /// The lines; named ones appear in the legend, in this order.
    pub lines: Vec<Line>,
    /// Bars behind the lines; named ones appear in the legend, before the lines.
    pub bars: Vec<Bars>,
}

/// Bars of one colour.
#[derive(Debug, Clone)]
pub struct Bars {
    /// Their name in the legend; empty for none.
    pub name: String,
    /// Their colour.
    pub colour: Colour,
    /// From where to where: x, then y.
    pub bars: Vec<[f64; 4]>,
}

/// An axis: what it measures, in which unit, from its first mark to its last.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    label: String,
    marks: Vec<f64>,
    decimals: usize,
}

/// A line.
#[derive(Debug, Clone)]
pub struct Line {
    /// Its name in the legend; empty for none.
    pub name: String,
    /// Its colour.
    pub colour: Colour,
    /// Whether it is drawn in dashes, or through, with a dot at each point.
    pub is_dashed: bool,
    /// Its points.
    pub points: Vec<(f64, f64)>,
}

// Colours that stay apart for the colour-blind and in grey (Okabe and Ito, 2008).
/// Blue.
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
/// Vermilion.
pub const ORANGE: RGBColor = RGBColor(213, 94, 0);
/// Green.
pub const GREEN: RGBColor = RGBColor(0, 158, 115);
/// Grey.
pub const GREY: RGBColor = RGBColor(90, 90, 90);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn<T> = Result<T, DrawingAreaErrorKind<std::io::Error>>;

/// The SVG that `draw` draws, of a height in pixels. Words can still be read when it is as wide as a phone.
fn svg(title: &str, height: u32, draw: impl FnOnce(&Area<'_>) -> Drawn<()>) -> Result<String, Failure> {
    // A font that is part of the program and cannot be read leaves text out, and a test would say so.
    let _ = register_font(FONT, FontStyle::Normal, FONT_BYTES);
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (WIDTH, height)).into_drawing_area();
        let drawn = area.fill(&WHITE).and_then(|()| draw(&area)).and_then(|()| area.present());
        drawn.map_err(|e| Failure::new(ExitCode::Internal, format!("failed to draw {title:?}: {e}")))?;
    }
    Ok(text.trim_end().to_owned() + "\n")
}

/// Text at a height in pixels, its middle at the height of the point at which it stands.
fn words(size: i32, anchor: HPos) -> TextStyle<'static> {
    TextStyle::from((FONT, size).into_font()).color(&BLACK).pos(Pos::new(anchor, VPos::Center))
}

const WIDTH: u32 = 440;
const HEIGHT: u32 = 280;
const LIGHT: Colour = RGBColor(225, 225, 225);
/// Height of a row of the legend.
const LEGEND_ROW: i32 = 24;

/// How the font is called in an SVG: as those call it who have it, then one of the same widths, then any.
pub(crate) const FONT: &str = "DejaVu Sans, Verdana, sans-serif";
pub(crate) const FONT_BYTES: &[u8] = include_bytes!("../fonts/DejaVuSans.ttf");

impl Line {
    /// A line through dots.
    pub fn new(name: &str, colour: Colour, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.to_owned(), colour, is_dashed: false, points }
    }

    /// A line in dashes.
    pub fn dashed(name: &str, colour: Colour, points: Vec<(f64, f64)>) -> Self {
        Self { is_dashed: true, ..Self::new(name, colour, points) }
    }
}

impl Scale {
    /// From a round number at or below `low` to one at or above `high`, with up to about eight marks.
    pub fn around(label: &str, low: f64, high: f64) -> Self {
        let width = (high - low).max(1e-6);
        let exponent = libm::log10(width / 7.0).floor();
        let power = 10.0_f64.powi(exponent as i32);
        let factor = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * power * 7.0 >= width * (1.0 - 1e-9));
        let step = factor.unwrap_or(10.0) * power;
        let (first, last) = ((low / step + 1e-9).floor(), (high / step - 1e-9).ceil());
        let count = (last - first).max(1.0) as usize;
        let marks = (0..=count).map(|at| (first + at as f64) * step).collect();
        let decimals = if step >= 1.0 { 0 } else { (-libm::log10(step) - 1e-9).ceil() as usize };
        Self { label: label.to_owned(), marks, decimals }
    }

    /// From one number to another with marks at every step.
    pub fn steps(label: &str, low: f64, high: f64, step: f64) -> Self {
        let count = ((high - low) / step).round() as usize; // a few
        let marks = (0..=count).map(|at| low + at as f64 * step).collect();
        let decimals = if step.fract() == 0.0 { 0 } else { 1 };
        Self { label: label.to_owned(), marks, decimals }
    }
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn range(&self) -> std::ops::Range<f64> {
        self.marks[0]..self.marks[self.marks.len() - 1]
    }

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        RangedCoordf64::from(self.range()).map(value, limit)
    }

    fn key_points<H: KeyPointHint>(&self, hint: H) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.marks.clone() }
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, value: &f64) -> String {
        format!("{value:.*}", self.decimals)
    }
}

impl Figure {
    /// The figure as SVG, without its title.
    ///
    /// # Errors
    /// [`ExitCode::Internal`] if the library fails.
    pub fn svg(&self) -> Result<String, Failure> {
        svg(&self.title, HEIGHT, |area| self.draw(area))
    }

    fn draw(&self, area: &Area<'_>) -> Drawn<()> {
        let rows = self.draw_legend(area)?;
        let (_, below) = area.split_vertically(LEGEND_ROW * rows);
        let mut chart = ChartBuilder::on(&below)
            .margin_top(10)
            .margin_right(24)
            .margin_bottom(8)
            .margin_left(8)
            .x_label_area_size(48)
            .y_label_area_size(64)
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(LIGHT.stroke_width(1))
            .axis_style(GREY.stroke_width(1))
            .x_desc(short(&self.x.label))
            .y_desc(short(&self.y.label))
            .label_style(TextStyle::from((FONT, 13).into_font()).color(&BLACK))
            .axis_desc_style(TextStyle::from((FONT, 14).into_font()).color(&BLACK))
            .set_all_tick_mark_size(4)
            .draw()?;
        for Bars { colour, bars, .. } in &self.bars {
            let rectangle =
                |[left, right, low, high]: &[f64; 4]| Rectangle::new([(*left, *low), (*right, *high)], colour.filled());
            chart.draw_series(bars.iter().map(rectangle))?;
        }
        // The first line is drawn last: what matters most is on top.
        for line in self.lines.iter().rev() {
            let stroke = line.colour.stroke_width(2);
            let points = line.points.iter().copied();
            if line.is_dashed {
                chart.draw_series(DashedLineSeries::new(points, 7, 5, stroke))?;
            } else {
                chart.draw_series(LineSeries::new(points.clone(), stroke))?;
                chart.draw_series(points.map(|point| Circle::new(point, 3, line.colour.filled())))?;
            }
        }
        Ok(())
    }

    /// Names beside pieces of their lines and bars, side by side; gives the number of rows that took.
    fn draw_legend(&self, area: &Area<'_>) -> Drawn<i32> {
        let text = words(14, HPos::Left);
        let (left, right) = (16, WIDTH as i32);
        let (mut x, mut row) = (left, 0);
        let bars = self.bars.iter().map(|bars| (&bars.name, bars.colour, None));
        let lines = self.lines.iter().map(|line| (&line.name, line.colour, Some(line.is_dashed)));
        for (name, colour, is_dashed) in bars.chain(lines).filter(|(name, ..)| !name.is_empty()) {
            let name = short(name);
            let width = 34 + area.estimate_text_size(name, &text)?.0 as i32;
            if x > left && x + width > right {
                (x, row) = (left, row + 1);
            }
            let y = 11 + LEGEND_ROW * row;
            let piece = |from: i32, to: i32| PathElement::new([(x + from, y), (x + to, y)], colour.stroke_width(2));
            match is_dashed {
                None => area.draw(&Rectangle::new([(x + 12, y - 5), (x + 28, y + 5)], colour.filled()))?,
                Some(true) => {
                    [(0, 8), (12, 20), (24, 28)].into_iter().try_for_each(|(from, to)| area.draw(&piece(from, to)))?;
                }
                Some(false) => {
                    area.draw(&piece(0, 28))?;
                    area.draw(&Circle::new((x + 14, y), 3, colour.filled()))?;
                }
            }
            area.draw(&Text::new(name, (x + 34, y), text.clone()))?;
            x += width + 22;
        }
        Ok(row + 1)
    }
}

/// Words without what stands in parentheses at their end.
fn short(words: &str) -> &str {
    words.split_once(" (").map_or(words, |(short, _)| short)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure() -> Figure {
        let points = |y: f64| vec![(1.0, y), (2.0, y + 0.1), (5.0, y + 0.2)];
        Figure {
            title: "A title".to_owned(),
            x: Scale::steps("epoch", 0.0, 5.0, 1.0),
            y: Scale::around("share", 0.31, 0.87),
            lines: vec![Line::new("one", BLUE, points(0.4)), Line::dashed("two & <three>", GREY, points(0.6))],
            bars: Vec::new(),
        }
    }

    #[test]
    fn marks_are_round_numbers_that_hold_the_values() {
        for (low, high) in [(0.31, 0.87), (0.0, 1.0), (0.2, 0.2), (3.0, 1234.5), (0.6721, 0.6722), (-3.0, 2.0)] {
            let scale = Scale::around("", low, high);
            let range = scale.range();
            assert!(range.start <= low && range.end >= high, "{low} {high}: {range:?}");
            assert!((2..=10).contains(&scale.marks.len()), "{low} {high}: {:?}", scale.marks);
            let texts: std::collections::BTreeSet<String> =
                scale.marks.iter().map(|mark| scale.format_ext(mark)).collect();
            assert_eq!(texts.len(), scale.marks.len(), "{texts:?}");
        }
        assert_eq!(Scale::around("", 0.0, 1.0).marks.len(), 6);
        assert_eq!(Scale::steps("", 0.0, 9.0, 3.0).marks, [0.0, 3.0, 6.0, 9.0]);
    }

    #[test]
    fn an_svg_holds_its_words_as_text_that_xml_allows() {
        let svg = figure().svg().unwrap();
        for words in ["epoch", "share", "one", "two &amp; &lt;three&gt;", "0.4"] {
            assert!(svg.contains(words), "{words} is not in {svg}");
        }
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
        assert_eq!(svg, figure().svg().unwrap());
    }

    #[test]
    fn bars_stand_where_they_should_and_have_their_names() {
        let bars = vec![[1.0, 3.0, 0.0, 0.4], [3.0, 5.0, 0.0, 0.8]];
        let bars = Bars { name: "shards of light".to_owned(), colour: GREEN, bars };
        assert_eq!(bars.bars, [[1.0, 3.0, 0.0, 0.4], [3.0, 5.0, 0.0, 0.8]]);
        let svg = Figure { bars: vec![bars], ..figure() }.svg().unwrap();
        assert_eq!(svg.matches("fill=\"#009E73\"").count(), 3, "two bars and the legend's patch: {svg}");
        assert!(svg.contains("shards of light") && svg.contains("viewBox=\"0 0 440 280\""), "{svg}");
    }

    #[test]
    fn a_legend_that_is_too_long_goes_on_in_the_next_row() {
        let rows = |names: usize| {
            let line = Line::new("a name of some length", BLUE, vec![(1.0, 0.4), (2.0, 0.5)]);
            let svg = Figure { lines: vec![line; names], ..figure() }.svg().unwrap();
            let tops = svg.split("a name of some length").count() - 1;
            assert_eq!(tops, names);
            let heights: std::collections::BTreeSet<&str> = svg
                .split("<text ")
                .filter(|text| text.contains("a name of some length"))
                .filter_map(|text| text.split(" y=\"").nth(1)?.split('"').next())
                .collect();
            heights.len()
        };
        assert_eq!((rows(1), rows(2), rows(4)), (1, 1, 2));
    }
}
