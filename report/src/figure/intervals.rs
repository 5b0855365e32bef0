//! Rates as dots on their intervals, one below the other.
//!
//! They are drawn in pixels, without a chart in between: nothing has to be measured with a font, so the bytes are the
//! same wherever they are drawn. A disc is the first rate of a row and a ring the second, so they can be read in grey.

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use program::Failure;

use super::{Area, BLUE, Colour, Drawn, GREY, LIGHT, ORANGE, svg, words};

/// A figure of intervals.
#[derive(Debug, Clone)]
pub struct Intervals {
    /// What it shows.
    pub title: String,
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

// Where things stand, in pixels.
const TOP: i32 = 8;
const AXIS_LEFT: i32 = 70;
const AXIS_WIDTH: i32 = 180;
const VALUE_LEFT: i32 = 268;
const ROW: i32 = 64;
const BOTTOM: i32 = 56;
const DOT_RADIUS: i32 = 5;

impl Intervals {
    /// The figure as SVG, without its title.
    ///
    /// # Errors
    /// [`program::ExitCode::Internal`] if the library fails.
    pub fn svg(&self) -> Result<String, Failure> {
        let bottom = TOP + ROW * self.rows.len() as i32;
        svg(&self.title, (bottom + BOTTOM) as u32, |area| {
            draw_axis(area, bottom)?;
            (0..).zip(&self.rows).try_for_each(|(at, row)| draw_row(area, row, TOP + ROW * at))
        })
    }
}

fn draw_axis(area: &Area<'_>, bottom: i32) -> Drawn<()> {
    for percent in [0, 50, 100] {
        let x = x_of(f64::from(percent) / 100.0);
        line(area, (x, TOP), (x, bottom), LIGHT, 1)?;
        write(area, &format!("{percent} %"), (x, bottom + 14), 13, HPos::Center)?;
    }
    line(area, (AXIS_LEFT, bottom), (AXIS_LEFT + AXIS_WIDTH, bottom), GREY, 1)?;
    write(area, "share, with its 95 % interval", (x_of(0.5), bottom + 38), 14, HPos::Center)
}

/// A name, and below it a line for each rate.
fn draw_row(area: &Area<'_>, row: &Row, top: i32) -> Drawn<()> {
    write(area, &row.name.replace(char::is_control, " "), (16, top + 12), 14, HPos::Left)?;
    let [disc, ring] = &row.rates;
    draw_rate(area, disc, BLUE, top + 32)?;
    draw_rate(area, ring, ORANGE, top + 50)
}

fn draw_rate(area: &Area<'_>, rate: &Rate, colour: Colour, y: i32) -> Drawn<()> {
    write(area, rate.name, (AXIS_LEFT - 14, y), 13, HPos::Right)?;
    write(area, &rate.text, (VALUE_LEFT, y), 13, HPos::Left)?;
    let Some(share) = rate.share else { return Ok(()) };
    let [x, low, high] = share.map(x_of);
    let centre = (x, y);
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

fn x_of(share: f64) -> i32 {
    AXIS_LEFT + (f64::from(AXIS_WIDTH) * share.clamp(0.0, 1.0)).round() as i32
}

fn line(area: &Area<'_>, from: (i32, i32), to: (i32, i32), colour: Colour, width: u32) -> Drawn<()> {
    area.draw(&PathElement::new([from, to], colour.stroke_width(width)))
}

/// Text on one line, its middle at the height of `at`.
fn write(area: &Area<'_>, text: &str, at: (i32, i32), size: i32, anchor: HPos) -> Drawn<()> {
    area.draw(&Text::new(text, at, words(size, anchor)))
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
        Intervals { title: "Rates".to_owned(), rows: names.iter().map(row).collect() }
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
        // 70 + 180 · 0.6, and twice (a white disc in a ring) 70 + 180 · 0.75.
        let places = ["cx=\"178\" cy=\"40\"", "cx=\"205\" cy=\"58\"", "cx=\"205\" cy=\"58\""];
        assert_eq!(circles.len(), places.len(), "{figure}");
        assert!(circles.iter().zip(places).all(|(circle, place)| circle.contains(place)), "{circles:?}");
        // The interval of the success rate: from 70 + 180 · 0.412 to 70 + 180 · 0.75.
        assert!(figure.contains("points=\"144,40 205,40 \""), "{figure}");
    }
}
