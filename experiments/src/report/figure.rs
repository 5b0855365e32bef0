//! The figure of results: for each experiment its rates as dots on their intervals, one below the other.
//!
//! It is drawn in pixels, without a chart in between: nothing has to be measured with a font, so the bytes are the same
//! wherever it is drawn. A disc is the success rate and a ring the cleared share, so it can be read in grey.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use program::{Exit, ExitCode};
use report::figure::{BLUE, Colour, GREY, ORANGE};

use super::share;
use crate::statistics::{Interval, Results};

/// Why the figure cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[error("failed to draw the results: {0}")]
pub struct FigureError(String);

impl Exit for FigureError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Internal
    }
}

/// What is shown together: an experiment, or a part of one.
#[derive(Debug, Clone)]
pub(crate) struct Row {
    /// What it is.
    pub(crate) name: String,
    /// Attempts that held, of all.
    pub(crate) success_rate: Option<Interval>,
    /// Objects removed, of all.
    pub(crate) cleared_share: Option<Interval>,
}

/// A rate and how it is shown.
struct Mark {
    name: &'static str,
    rate: Option<Interval>,
    colour: Colour,
    is_disc: bool,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

const LIGHT: Colour = Colour(225, 225, 225);

/// How the font is called: as those call it who have it, then one of the same widths, then any.
const FONT: &str = "DejaVu Sans, Verdana, sans-serif";

/// Where things stand, in pixels.
struct Sheet {
    width: u32,
    top: i32,
    axis_left: i32,
    axis_width: i32,
    value_left: i32,
    title: Option<&'static str>,
    axis: &'static str,
    marks: &'static [i32],
}

/// A figure that stands alone.
const ALONE: Sheet = Sheet {
    width: 800,
    top: 48,
    axis_left: 100,
    axis_width: 480,
    value_left: 600,
    title: Some("Grasp success rate (GSR) and share of objects cleared"),
    axis: "share, with its 95 % bootstrap interval over rounds",
    marks: &[0, 20, 40, 60, 80, 100],
};
/// A figure on a page, whose words can still be read on a phone.
const ON_A_PAGE: Sheet = Sheet {
    width: 440,
    top: 8,
    axis_left: 70,
    axis_width: 180,
    value_left: 268,
    title: None,
    axis: "share, with its 95 % interval",
    marks: &[0, 50, 100],
};
const ROW: i32 = 64;
const BOTTOM: i32 = 56;
const DOT_RADIUS: i32 = 5;

/// The success rate and the cleared share of experiments, as SVG.
///
/// # Errors
/// [`FigureError`] if the library fails.
pub fn svg(results: &[Results]) -> Result<String, FigureError> {
    let row = |results: &Results| Row {
        name: format!("{} ({} rounds, {} attempts)", results.protocol, results.rounds, results.attempts),
        success_rate: results.rates.success_rate,
        cleared_share: results.rates.cleared_share,
    };
    drawn(&ALONE, &results.iter().map(row).collect::<Vec<_>>())
}

/// The same of any rows, without a title and 440 pixels wide: for [`report::page`].
///
/// # Errors
/// [`FigureError`] if the library fails.
pub(crate) fn svg_for_page(rows: &[Row]) -> Result<String, FigureError> {
    drawn(&ON_A_PAGE, rows)
}

fn drawn(sheet: &Sheet, rows: &[Row]) -> Result<String, FigureError> {
    let bottom = sheet.top + ROW * rows.len() as i32;
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (sheet.width, (bottom + BOTTOM) as u32)).into_drawing_area();
        draw(&area, sheet, rows, bottom).map_err(|e| FigureError(e.to_string()))?;
    }
    if !text.ends_with('\n') {
        text.push('\n');
    }
    Ok(text)
}

fn draw(area: &Area<'_>, sheet: &Sheet, rows: &[Row], bottom: i32) -> Drawn {
    area.fill(&WHITE)?;
    if let Some(title) = sheet.title {
        write(area, title, (16, 20), 18, HPos::Left)?;
    }
    draw_axis(area, sheet, bottom)?;
    for (at, row) in rows.iter().enumerate() {
        draw_row(area, sheet, row, sheet.top + ROW * at as i32)?;
    }
    area.present()
}

fn draw_axis(area: &Area<'_>, sheet: &Sheet, bottom: i32) -> Drawn {
    for percent in sheet.marks {
        let x = sheet.x_of(f64::from(*percent) / 100.0);
        line(area, (x, sheet.top), (x, bottom), LIGHT, 1)?;
        write(area, &format!("{percent} %"), (x, bottom + 14), 13, HPos::Center)?;
    }
    line(area, (sheet.axis_left, bottom), (sheet.axis_left + sheet.axis_width, bottom), GREY, 1)?;
    let middle = sheet.axis_left + sheet.axis_width / 2;
    write(area, sheet.axis, (middle, bottom + 38), 14, HPos::Center)
}

/// A name, and below it a line for each rate.
fn draw_row(area: &Area<'_>, sheet: &Sheet, row: &Row, top: i32) -> Drawn {
    write(area, &row.name.replace(char::is_control, " "), (16, top + 12), 14, HPos::Left)?;
    let marks = [
        Mark { name: "GSR", rate: row.success_rate, colour: BLUE, is_disc: true },
        Mark { name: "cleared", rate: row.cleared_share, colour: ORANGE, is_disc: false },
    ];
    for (mark, y) in marks.iter().zip([top + 32, top + 50]) {
        draw_mark(area, sheet, mark, y)?;
    }
    Ok(())
}

fn draw_mark(area: &Area<'_>, sheet: &Sheet, mark: &Mark, y: i32) -> Drawn {
    write(area, mark.name, (sheet.axis_left - 14, y), 13, HPos::Right)?;
    write(area, &share(mark.rate), (sheet.value_left, y), 13, HPos::Left)?;
    let Some(Interval { value, low, high }) = mark.rate else { return Ok(()) };
    let (low, high, centre) = (sheet.x_of(low), sheet.x_of(high), (sheet.x_of(value), y));
    line(area, (low, y), (high, y), mark.colour, 2)?;
    for end in [low, high] {
        line(area, (end, y - 4), (end, y + 4), mark.colour, 2)?;
    }
    if mark.is_disc {
        area.draw(&Circle::new(centre, DOT_RADIUS, mark.colour.filled()))
    } else {
        area.draw(&Circle::new(centre, DOT_RADIUS, WHITE.filled()))?;
        area.draw(&Circle::new(centre, DOT_RADIUS, mark.colour.stroke_width(2)))
    }
}

impl Sheet {
    fn x_of(&self, share: f64) -> i32 {
        self.axis_left + (f64::from(self.axis_width) * share.clamp(0.0, 1.0)).round() as i32
    }
}

fn line(area: &Area<'_>, from: (i32, i32), to: (i32, i32), colour: Colour, width: u32) -> Drawn {
    area.draw(&PathElement::new([from, to], colour.stroke_width(width)))
}

/// Text on one line, its middle at the height of `at`.
fn write(area: &Area<'_>, text: &str, at: (i32, i32), size: i32, anchor: HPos) -> Drawn {
    let style = TextStyle::from((FONT, size).into_font()).pos(Pos::new(anchor, VPos::Center));
    area.draw(&Text::new(text.to_owned(), at, style))
}

#[cfg(test)]
mod tests {
    use super::super::tests::small;
    use super::*;
    use crate::statistics::results;

    /// Reads tags as XML does, and fails where one is not closed in its turn.
    fn assert_balanced(svg: &str) {
        let mut open = Vec::new();
        for tag in svg.split('<').skip(1) {
            let (tag, _) = tag.split_once('>').unwrap();
            let name = tag.split_whitespace().next().unwrap();
            if let Some(closed) = tag.strip_prefix('/') {
                assert_eq!(open.pop(), Some(closed), "{svg}");
            } else if !tag.ends_with('/') {
                open.push(name);
            }
        }
        assert!(open.is_empty(), "{open:?} are left open in {svg}");
    }

    #[test]
    fn the_svg_is_well_formed_and_the_same_every_time() {
        let both = [small("pile & <packed>"), results("nothing\u{7}", &[], &[])];
        let figure = svg(&both).unwrap();
        assert!(figure.starts_with("<svg") && figure.ends_with("</svg>\n"), "{figure}");
        assert_balanced(&figure);
        for words in ["pile &amp; &lt;packed&gt; (4 rounds", "nothing  (0 rounds", "60.0 % (41.2 to 75.0)", "100 %"] {
            assert!(figure.contains(words), "{words} is not in {figure}");
        }
        assert_eq!(figure, svg(&both).unwrap());
        assert_balanced(&svg(&[]).unwrap());
    }

    #[test]
    fn dots_stand_where_the_shares_are() {
        let figure = svg(&[small("pile")]).unwrap();
        let circles: Vec<&str> = figure.lines().filter(|line| line.starts_with("<circle")).collect();
        // 100 + 480 · 0.6, and twice (a white disc in a ring) 100 + 480 · 0.75.
        let places = ["cx=\"388\" cy=\"80\"", "cx=\"460\" cy=\"98\"", "cx=\"460\" cy=\"98\""];
        assert_eq!(circles.len(), places.len(), "{figure}");
        assert!(circles.iter().zip(places).all(|(circle, place)| circle.contains(place)), "{circles:?}");
        // The interval of the success rate: from 100 + 480 · 0.412 to 100 + 480 · 0.75.
        assert!(figure.contains("points=\"298,80 460,80 \""), "{figure}");
    }
}
