//! The figure of results: for each experiment its rates as dots on their intervals, one below the other.
//!
//! It is drawn in pixels, without a chart in between: nothing has to be measured with a font, so the bytes are the same
//! wherever it is drawn. A disc is the success rate and a ring the cleared share, so it can be read in grey.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::share;
use crate::statistics::{Interval, Results};

/// Why the figure cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[error("failed to draw the results: {0}")]
pub struct FigureError(String);

/// A rate and how it is shown.
struct Mark {
    name: &'static str,
    rate: Option<Interval>,
    colour: RGBColor,
    is_disc: bool,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Colours that stay apart for the colour-blind (Okabe and Ito, 2008).
const BLUE: RGBColor = RGBColor(0, 114, 178);
const ORANGE: RGBColor = RGBColor(213, 94, 0);
const GREY: RGBColor = RGBColor(90, 90, 90);
const LIGHT: RGBColor = RGBColor(225, 225, 225);

/// How the font is called: as those call it who have it, then one of the same widths, then any.
const FONT: &str = "DejaVu Sans, Verdana, sans-serif";

// All in pixels.
const WIDTH: u32 = 800;
const TOP: i32 = 48;
const ROW: i32 = 64;
const BOTTOM: i32 = 56;
const AXIS_LEFT: i32 = 100;
const AXIS_WIDTH: i32 = 480;
const VALUE_LEFT: i32 = 600;
const DOT_RADIUS: i32 = 5;

/// The success rate and the cleared share of experiments, as SVG.
///
/// # Errors
/// [`FigureError`] if the library fails.
pub fn svg(results: &[Results]) -> Result<String, FigureError> {
    let bottom = TOP + ROW * results.len() as i32;
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (WIDTH, (bottom + BOTTOM) as u32)).into_drawing_area();
        draw(&area, results, bottom).map_err(|e| FigureError(e.to_string()))?;
    }
    if !text.ends_with('\n') {
        text.push('\n');
    }
    Ok(text)
}

fn draw(area: &Area<'_>, results: &[Results], bottom: i32) -> Drawn {
    area.fill(&WHITE)?;
    write(area, "Grasp success rate (GSR) and share of objects cleared", (16, 20), 18, HPos::Left)?;
    draw_axis(area, bottom)?;
    for (at, one) in results.iter().enumerate() {
        draw_row(area, one, TOP + ROW * at as i32)?;
    }
    area.present()
}

fn draw_axis(area: &Area<'_>, bottom: i32) -> Drawn {
    for percent in [0, 20, 40, 60, 80, 100] {
        let x = x_of(f64::from(percent) / 100.0);
        line(area, (x, TOP), (x, bottom), LIGHT, 1)?;
        write(area, &format!("{percent} %"), (x, bottom + 14), 13, HPos::Center)?;
    }
    line(area, (AXIS_LEFT, bottom), (AXIS_LEFT + AXIS_WIDTH, bottom), GREY, 1)?;
    let middle = AXIS_LEFT + AXIS_WIDTH / 2;
    write(area, "share, with its 95 % bootstrap interval over rounds", (middle, bottom + 38), 14, HPos::Center)
}

/// An experiment: its name, and below it a line for each rate.
fn draw_row(area: &Area<'_>, results: &Results, top: i32) -> Drawn {
    let name = results.protocol.replace(char::is_control, " ");
    let name = format!("{name} ({} rounds, {} attempts)", results.rounds, results.attempts);
    write(area, &name, (16, top + 12), 14, HPos::Left)?;
    let rates = &results.rates;
    let marks = [
        Mark { name: "GSR", rate: rates.success_rate, colour: BLUE, is_disc: true },
        Mark { name: "cleared", rate: rates.cleared_share, colour: ORANGE, is_disc: false },
    ];
    for (mark, y) in marks.iter().zip([top + 32, top + 50]) {
        draw_mark(area, mark, y)?;
    }
    Ok(())
}

fn draw_mark(area: &Area<'_>, mark: &Mark, y: i32) -> Drawn {
    write(area, mark.name, (AXIS_LEFT - 14, y), 13, HPos::Right)?;
    write(area, &share(mark.rate), (VALUE_LEFT, y), 13, HPos::Left)?;
    let Some(Interval { value, low, high }) = mark.rate else { return Ok(()) };
    let (low, high, centre) = (x_of(low), x_of(high), (x_of(value), y));
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

fn x_of(share: f64) -> i32 {
    AXIS_LEFT + (f64::from(AXIS_WIDTH) * share.clamp(0.0, 1.0)).round() as i32
}

fn line(area: &Area<'_>, from: (i32, i32), to: (i32, i32), colour: RGBColor, width: u32) -> Drawn {
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
