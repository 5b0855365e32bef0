//! Curves in axes, as SVG. Nothing is measured with a font, so the bytes are the same wherever they are drawn.

use maud::{Markup, html};

/// Lines in axes.
#[derive(Debug, Clone)]
pub struct Figure {
    /// The horizontal axis.
    pub x: Scale,
    /// The vertical axis.
    pub y: Scale,
    /// The lines, the first on top; named ones appear in the legend, in this order.
    pub lines: Vec<Line>,
}

/// An axis: what it measures, from its first mark to its last.
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
    pub name: &'static str,
    /// Its colour.
    pub colour: &'static str,
    /// Whether it is drawn in dashes, or through, with a dot at each point.
    pub is_dashed: bool,
    /// Its points.
    pub points: Vec<[f64; 2]>,
}

// Colours that stay apart for the colour-blind and in grey (Okabe and Ito, 2008).
/// Blue.
pub const BLUE: &str = "#0072b2";
/// Vermilion.
pub const ORANGE: &str = "#d55e00";
/// Green.
pub const GREEN: &str = "#009e73";
const LIGHT: &str = "#e1e1e1";

/// How the font is called in an SVG: as those call it who have it, then one of the same widths, then any.
const FONT: &str = "DejaVu Sans, Verdana, sans-serif";

// Where the axes end, in pixels.
const LEFT: f64 = 56.0;
const RIGHT: f64 = 464.0;
const TOP: f64 = 56.0;
const BOTTOM: f64 = 252.0;

impl Scale {
    /// From a round number at or below the first to one at or above the second, with up to about eight marks, which are
    /// at least `step_min` apart.
    #[must_use]
    pub fn around(label: &str, [low, high]: [f64; 2], step_min: f64) -> Self {
        let width = (high - low).max(1e-6);
        let exponent = libm::log10(width / 7.0).floor();
        let power = 10.0_f64.powi(exponent as i32);
        let factor = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * power * 7.0 >= width * (1.0 - 1e-9));
        let step = (factor.unwrap_or(10.0) * power).max(step_min);
        let (first, last) = ((low / step + 1e-9).floor(), (high / step - 1e-9).ceil());
        let count = (last - first).max(1.0) as usize;
        let marks = (0..=count).map(|at| (first + at as f64) * step).collect();
        let decimals = if step >= 1.0 { 0 } else { (-libm::log10(step) - 1e-9).ceil() as usize };
        Self { label: label.to_owned(), marks, decimals }
    }

    /// The pixel of a value between those of the first and the last mark.
    fn place(&self, value: f64, first_px: f64, last_px: f64) -> f64 {
        let [low, high] = [self.marks[0], self.marks[self.marks.len() - 1]];
        (first_px + (last_px - first_px) * (value - low) / (high - low)).round()
    }

    fn words(&self, mark: f64) -> String {
        format!("{mark:.*}", self.decimals)
    }
}

impl Figure {
    /// The figure as SVG.
    #[must_use]
    pub fn svg(&self) -> String {
        let x_at = |value: f64| self.x.place(value, LEFT, RIGHT);
        let y_at = |value: f64| self.y.place(value, BOTTOM, TOP);
        let shown = |line: &Line| -> Vec<[f64; 2]> { line.points.iter().map(|[x, y]| [x_at(*x), y_at(*y)]).collect() };
        let svg = html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 480 300" font-family=(FONT) font-size="12" {
                rect width="480" height="300" fill="#fff" {}
                @for mark in &self.x.marks {
                    @let at = x_at(*mark);
                    (stroke(&[[at, TOP], [at, BOTTOM]], LIGHT, false))
                    text x=(at) y=(BOTTOM + 18.0) text-anchor="middle" { (self.x.words(*mark)) }
                }
                @for mark in &self.y.marks {
                    @let at = y_at(*mark);
                    (stroke(&[[LEFT, at], [RIGHT, at]], LIGHT, false))
                    text x=(LEFT - 8.0) y=(at + 4.0) text-anchor="end" { (self.y.words(*mark)) }
                }
                text x="260" y="290" text-anchor="middle" { (self.x.label) }
                text x="16" y="44" { (self.y.label) }
                @for line in self.lines.iter().rev() {
                    @let points = shown(line);
                    (stroke(&points, line.colour, line.is_dashed))
                    @if !line.is_dashed {
                        @for [x, y] in &points { circle cx=(x) cy=(y) r="3" fill=(line.colour) {} }
                    }
                }
                @for (number, line) in self.lines.iter().filter(|line| !line.name.is_empty()).enumerate() {
                    @let left = 16.0 + 112.0 * number as f64;
                    (stroke(&[[left, 16.0], [left + 24.0, 16.0]], line.colour, line.is_dashed))
                    text x=(left + 30.0) y="20" { (line.name) }
                }
            }
        };
        svg.into_string() + "\n"
    }
}

fn stroke(points: &[[f64; 2]], colour: &str, is_dashed: bool) -> Markup {
    let points: Vec<String> = points.iter().map(|[x, y]| format!("{x},{y}")).collect();
    let (points, dashes) = (points.join(" "), is_dashed.then_some("7 5"));
    html! { polyline points=(points) fill="none" stroke=(colour) stroke-width="2" stroke-dasharray=[dashes] {} }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_round_numbers_that_hold_the_values() {
        for (low, high) in [(0.31, 0.87), (0.0, 1.0), (0.2, 0.2), (3.0, 1234.5), (0.6721, 0.6722), (-3.0, 2.0)] {
            let scale = Scale::around("", [low, high], 0.0);
            assert!(scale.marks[0] <= low && scale.marks[scale.marks.len() - 1] >= high, "{low} {high}: {scale:?}");
            assert!((2..=10).contains(&scale.marks.len()), "{low} {high}: {:?}", scale.marks);
            let texts: std::collections::BTreeSet<String> = scale.marks.iter().map(|mark| scale.words(*mark)).collect();
            assert_eq!(texts.len(), scale.marks.len(), "{texts:?}");
        }
        assert_eq!(Scale::around("", [0.0, 1.0], 0.0).marks.len(), 6);
        assert_eq!(Scale::around("", [0.0, 3.0], 1.0).marks, [0.0, 1.0, 2.0, 3.0]);
        assert_eq!(Scale::around("", [0.0, 1.0], 1.0).marks, [0.0, 1.0]);
    }

    #[test]
    fn an_svg_holds_its_words_as_text_that_xml_allows_and_points_stand_where_they_should() {
        let points = vec![[1.0, 0.4], [2.0, 0.5], [5.0, 1.0]];
        let one = Line { name: "one", colour: BLUE, is_dashed: false, points: points.clone() };
        let two = Line { name: "two & <three>", colour: ORANGE, is_dashed: true, points };
        let (x, y) = (Scale::around("epoch", [0.0, 5.0], 1.0), Scale::around("share", [0.0, 1.0], 0.0));
        let svg = Figure { x, y, lines: vec![one, two] }.svg();
        for words in ["epoch", "share", "one", "two &amp; &lt;three&gt;", ">0.4<", "<circle cx=\"464\" cy=\"56\""] {
            assert!(svg.contains(words), "{words} is not in {svg}");
        }
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
        // From 56 to 464 for 0 to 5, and from 252 to 56 for 0 to 1.
        let curve = "<polyline points=\"138,174 219,154 464,56\" fill=\"none\" stroke=\"#0072b2\" stroke-width=\"2\">";
        assert!(svg.contains(curve), "{svg}");
        assert_eq!(svg.matches("stroke-dasharray=\"7 5\"").count(), 2, "the line and its piece in the legend");
    }
}
