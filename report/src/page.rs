//! A page in one file: no script, no network, light and dark, from a phone's width to a wall's.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::figure::{Figure, FigureError};

const CSS: &str = include_str!("page.css");

/// A page.
#[derive(Debug, Clone, Default)]
pub struct Page {
    /// Its title.
    pub title: String,
    /// What it is about, in a sentence or two.
    pub lead: String,
    /// A headline number with its label.
    pub tiles: Vec<(String, String)>,
    /// What a reader should be worried about.
    pub warnings: Vec<String>,
    /// What it says, in order.
    pub sections: Vec<Section>,
    /// The last line: who made the page of what.
    pub footer: String,
}

/// A part of a page.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// Its heading.
    pub title: String,
    /// What is shown and how to read it.
    pub text: String,
    /// What it shows, in order.
    pub blocks: Vec<Block>,
}

/// Something that is shown.
#[derive(Debug, Clone)]
pub enum Block {
    /// Figures side by side.
    Figures(Vec<Picture>),
    /// Small pictures, more of them side by side.
    Gallery(Vec<Picture>),
    /// A table.
    Table(Table),
    /// A paragraph.
    Text(String),
}

/// A picture with its caption.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Markup of our own making: an `<svg>`.
    pub svg: String,
    /// What it shows, in bold.
    pub title: String,
    /// What else there is to say.
    pub caption: String,
}

/// A table.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Heads of the columns.
    pub head: Vec<&'static str>,
    /// Rows of as many cells.
    pub rows: Vec<Vec<Cell>>,
}

/// A cell of a table.
#[derive(Debug, Clone)]
pub enum Cell {
    /// Words.
    Text(String),
    /// Something from a program: a name, a hash, a path.
    Code(String),
    /// The number as text.
    Number(String),
    /// A share from 0 to 1 as a bar, and in words beside it.
    Bar(f64, String),
}

impl Picture {
    /// A figure; its title becomes the caption's.
    ///
    /// # Errors
    /// [`FigureError`] if it cannot be drawn.
    pub fn of(figure: &Figure, caption: &str) -> Result<Self, FigureError> {
        Ok(Self { svg: figure.svg_for_page()?, title: figure.title.clone(), caption: caption.to_owned() })
    }
}

impl Page {
    /// The page as HTML. The same page always has the same bytes.
    #[must_use]
    pub fn html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    link rel="icon" href="data:,";
                    title { (self.title) }
                    style { (PreEscaped(CSS)) }
                }
                body {
                    main {
                        h1 { (self.title) }
                        p class="lead" { (self.lead) }
                        (self.warnings())
                        @if !self.tiles.is_empty() {
                            div class="tiles" {
                                @for (value, what) in &self.tiles { div { b { (value) } span { (what) } } }
                            }
                        }
                        nav {
                            @for (at, section) in self.sections.iter().enumerate() {
                                a href={ "#s" (at) } { (section.title) }
                            }
                        }
                        @for (at, section) in self.sections.iter().enumerate() { (section.markup(at)) }
                        footer { (self.footer) }
                    }
                }
            }
        };
        page.into_string() + "\n"
    }

    fn warnings(&self) -> Markup {
        html! {
            @if self.warnings.is_empty() {
                p class="fine" { "Nothing to worry about was found." }
            } @else {
                div class="warnings" role="note" { ul { @for warning in &self.warnings { li { (warning) } } } }
            }
        }
    }
}

impl Section {
    fn markup(&self, at: usize) -> Markup {
        html! {
            section id={ "s" (at) } {
                h2 { (self.title) }
                @if !self.text.is_empty() { p { (self.text) } }
                @for block in &self.blocks { (block.markup()) }
            }
        }
    }
}

impl Block {
    fn markup(&self) -> Markup {
        match self {
            Self::Figures(pictures) => html! { div class="figures" { @for one in pictures { (one.markup()) } } },
            Self::Gallery(pictures) => {
                html! { div class="figures gallery" { @for one in pictures { (one.markup()) } } }
            }
            Self::Table(table) => table.markup(),
            Self::Text(text) => html! { p { (text) } },
        }
    }
}

impl Picture {
    fn markup(&self) -> Markup {
        html! {
            figure {
                (PreEscaped(&self.svg))
                figcaption { b { (self.title) } (self.caption) }
            }
        }
    }
}

impl Table {
    fn markup(&self) -> Markup {
        let is_number = |at: usize| self.rows.first().is_some_and(|row| matches!(row.get(at), Some(Cell::Number(_))));
        html! {
            div class="wide" {
                table {
                    thead { tr {
                        @for (at, head) in self.head.iter().enumerate() {
                            th scope="col" class=[is_number(at).then_some("number")] { (head) }
                        }
                    } }
                    tbody { @for row in &self.rows { tr { @for cell in row { (cell.markup()) } } } }
                }
            }
        }
    }
}

impl Cell {
    fn markup(&self) -> Markup {
        match self {
            Self::Text(text) => html! { td { (text) } },
            // Names stay in one line; hashes, which are longer, may not.
            Self::Code(text) => html! { td { code class=[(text.len() <= 32).then_some("short")] { (text) } } },
            Self::Number(text) => html! { td class="number" { (text) } },
            Self::Bar(share, text) => {
                let width = format!("width:{:.1}%", 100.0 * share.clamp(0.0, 1.0));
                html! { td class="bar" { i { u style=(width) {} } (text) } }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page() -> Page {
        let table = Table {
            head: vec!["rule", "attempts", "held"],
            rows: vec![vec![
                Cell::Code("<b>".to_owned()),
                Cell::Number("12".to_owned()),
                Cell::Bar(1.7, "170 %".to_owned()),
            ]],
        };
        let section = Section { title: "A & B".to_owned(), text: String::new(), blocks: vec![Block::Table(table)] };
        Page { title: "<script>".to_owned(), sections: vec![section], ..Page::default() }
    }

    #[test]
    fn words_are_words_and_never_markup() {
        let html = page().html();
        assert!(html.contains("&lt;script&gt;") && !html.contains("<script"), "{html}");
        assert!(html.contains("<code class=\"short\">&lt;b&gt;</code>") && html.contains("A &amp; B"), "{html}");
    }

    #[test]
    fn numbers_stand_right_and_bars_end_at_their_frame() {
        let html = page().html();
        assert!(html.contains("<th scope=\"col\" class=\"number\">attempts</th>"), "{html}");
        assert!(html.contains("width:100.0%"), "{html}");
    }

    #[test]
    fn a_page_asks_nobody_for_anything() {
        let html = page().html();
        for word in ["http:", "https:", "src=", "@import", "url("] {
            assert!(!html.contains(word), "{word} is in {html}");
        }
    }

    #[test]
    fn what_is_worrying_is_said_and_so_is_that_nothing_is() {
        assert!(page().html().contains("Nothing to worry about"));
        let worried = Page { warnings: vec!["no positives".to_owned()], ..page() }.html();
        assert!(worried.contains("<li>no positives</li>") && !worried.contains("Nothing to worry"));
    }
}
