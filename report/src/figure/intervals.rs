//! Rates as dots on their intervals, one below the other.
//!
//! They are drawn in pixels, without a chart in between: nothing has to be measured with a font, so the bytes are the
//! same wherever they are drawn. A disc is the first rate of a row and a ring the second, so they can be read in grey.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use program::Failure;

use super::{BLUE, Colour, FONT, GREY, ORANGE, svg};

/// A figure of intervals.
#[derive(Debug, Clone)]
pub struct Intervals {
    /// The line above all.
    pub title: String,
    /// What the axis measures.
    pub axis: String,
    /// What is shown, from the top.
    pub rows: Vec<Row>,
}

/// What has two rates.
#[derive(Debug, Clone)]
pub struct Row {
    /// What it is.
    pub name: String,
    /// The rate that is a disc, and the one that is a ring.
    pub rates: [Rate; 2],
}

/// A rate.
#[derive(Debug, Clone)]
pub struct Rate {
    /// What it is.
    pub name: &'static str,
    /// The share and the ends of its interval, from 0 to 1; `None` where there is nothing to divide by.
    pub share: Option<[f64; 3]>,
    /// The same in words.
    pub text: String,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

const LIGHT: Colour = Colour(225, 225, 225);

/// Where things stand, in pixels.
struct Sheet {
    width: u32,
    top: i32,
    axis_left: i32,
    axis_width: i32,
    value_left: i32,
    is_alone: bool,
    marks: &'static [i32],
}

/// A figure that stands alone.
const ALONE: Sheet = Sheet {
    width: 800,
    top: 48,
    axis_left: 100,
    axis_width: 480,
    value_left: 600,
    is_alone: true,
    marks: &[0, 20, 40, 60, 80, 100],
};
/// A figure on a page, whose words can still be read on a phone.
const ON_A_PAGE: Sheet = Sheet {
    width: 440,
    top: 8,
    axis_left: 70,
    axis_width: 180,
    value_left: 268,
    is_alone: false,
    marks: &[0, 50, 100],
};
/// The axis of a figure on a page.
const SHORT_AXIS: &str = "share, with its 95 % interval";
const ROW: i32 = 64;
const BOTTOM: i32 = 56;
const DOT_RADIUS: i32 = 5;

impl Intervals {
    /// The figure as SVG.
    ///
    /// # Errors
    /// [`program::ExitCode::Internal`] if the library fails.
    pub fn svg(&self) -> Result<String, Failure> {
        self.svg_on(&ALONE)
    }

    /// The figure as SVG without its title, 440 pixels wide: for [`crate::document`].
    ///
    /// # Errors
    /// [`program::ExitCode::Internal`] if the library fails.
    pub fn svg_for_page(&self) -> Result<String, Failure> {
        self.svg_on(&ON_A_PAGE)
    }

    fn svg_on(&self, sheet: &Sheet) -> Result<String, Failure> {
        let bottom = sheet.top + ROW * self.rows.len() as i32;
        svg(&self.title, (sheet.width, (bottom + BOTTOM) as u32), |area| self.draw(area, sheet, bottom))
    }

    fn draw(&self, area: &Area<'_>, sheet: &Sheet, bottom: i32) -> Drawn {
        area.fill(&WHITE)?;
        if sheet.is_alone {
            write(area, &self.title, (16, 20), 18, HPos::Left)?;
        }
        draw_axis(area, sheet, if sheet.is_alone { &self.axis } else { SHORT_AXIS }, bottom)?;
        for (at, row) in self.rows.iter().enumerate() {
            draw_row(area, sheet, row, sheet.top + ROW * at as i32)?;
        }
        area.present()
    }
}

fn draw_axis(area: &Area<'_>, sheet: &Sheet, axis: &str, bottom: i32) -> Drawn {
    for percent in sheet.marks {
        let x = sheet.x_of(f64::from(*percent) / 100.0);
        line(area, (x, sheet.top), (x, bottom), LIGHT, 1)?;
        write(area, &format!("{percent} %"), (x, bottom + 14), 13, HPos::Center)?;
    }
    line(area, (sheet.axis_left, bottom), (sheet.axis_left + sheet.axis_width, bottom), GREY, 1)?;
    let middle = sheet.axis_left + sheet.axis_width / 2;
    write(area, axis, (middle, bottom + 38), 14, HPos::Center)
}

/// A name, and below it a line for each rate.
fn draw_row(area: &Area<'_>, sheet: &Sheet, row: &Row, top: i32) -> Drawn {
    write(area, &row.name.replace(char::is_control, " "), (16, top + 12), 14, HPos::Left)?;
    let [disc, ring] = &row.rates;
    draw_rate(area, sheet, disc, BLUE, top + 32)?;
    draw_rate(area, sheet, ring, ORANGE, top + 50)
}

fn draw_rate(area: &Area<'_>, sheet: &Sheet, rate: &Rate, colour: Colour, y: i32) -> Drawn {
    write(area, rate.name, (sheet.axis_left - 14, y), 13, HPos::Right)?;
    write(area, &rate.text, (sheet.value_left, y), 13, HPos::Left)?;
    let Some([value, low, high]) = rate.share else { return Ok(()) };
    let (low, high, centre) = (sheet.x_of(low), sheet.x_of(high), (sheet.x_of(value), y));
    line(area, (low, y), (high, y), colour, 2)?;
    for end in [low, high] {
        line(area, (end, y - 4), (end, y + 4), colour, 2)?;
    }
    if colour == BLUE {
        area.draw(&Circle::new(centre, DOT_RADIUS, colour.filled()))
    } else {
        area.draw(&Circle::new(centre, DOT_RADIUS, WHITE.filled()))?;
        area.draw(&Circle::new(centre, DOT_RADIUS, colour.stroke_width(2)))
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
    use super::*;

    fn figure(names: &[&str]) -> Intervals {
        let rate = |name, share| Rate { name, share: Some(share), text: "60.0 % (41.2 to 75.0)".to_owned() };
        let rates = || [rate("GSR", [0.6, 0.412, 0.75]), rate("cleared", [0.75, 0.5, 1.0])];
        let nothing = || ["GSR", "cleared"].map(|name| Rate { name, share: None, text: "–".to_owned() });
        let row = |name: &&str| {
            let rates = if name.starts_with("nothing") { nothing() } else { rates() };
            Row { name: (*name).to_owned(), rates }
        };
        Intervals { title: "Rates".to_owned(), axis: "share".to_owned(), rows: names.iter().map(row).collect() }
    }

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
        let both = self::figure(&["pile & <packed> (4 rounds)", "nothing\u{7} (0 rounds)"]);
        let figure = both.svg().unwrap();
        assert!(figure.starts_with("<svg") && figure.ends_with("</svg>\n"), "{figure}");
        assert_balanced(&figure);
        for words in ["pile &amp; &lt;packed&gt; (4 rounds", "nothing  (0 rounds", "60.0 % (41.2 to 75.0)", "100 %"] {
            assert!(figure.contains(words), "{words} is not in {figure}");
        }
        assert_eq!(figure, both.svg().unwrap());
        assert_balanced(&self::figure(&[]).svg().unwrap());
    }

    #[test]
    fn dots_stand_where_the_shares_are() {
        let figure = figure(&["pile"]).svg().unwrap();
        let circles: Vec<&str> = figure.lines().filter(|line| line.starts_with("<circle")).collect();
        // 100 + 480 · 0.6, and twice (a white disc in a ring) 100 + 480 · 0.75.
        let places = ["cx=\"388\" cy=\"80\"", "cx=\"460\" cy=\"98\"", "cx=\"460\" cy=\"98\""];
        assert_eq!(circles.len(), places.len(), "{figure}");
        assert!(circles.iter().zip(places).all(|(circle, place)| circle.contains(place)), "{circles:?}");
        // The interval of the success rate: from 100 + 480 · 0.412 to 100 + 480 · 0.75.
        assert!(figure.contains("points=\"298,80 460,80 \""), "{figure}");
    }
}
