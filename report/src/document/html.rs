//! Documents as pages.

use maud::{DOCTYPE, Markup, PreEscaped, html};
use program::Failure;
use program::text::grouped;

use super::{Block, Cell, Document, Drawing, Picture, Table};

const CSS: &str = include_str!("../page.css");

/// Everything that all pages have.
pub(crate) fn whole(title: &str, css: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                link rel="icon" href="data:,";
                title { (title) }
                style { (PreEscaped(css)) }
            }
            body { (body) }
        }
    };
    page.into_string() + "\n"
}

impl Document {
    /// The document as a page in one file. The same document always has the same bytes.
    ///
    /// # Errors
    /// [`program::ExitCode::Internal`] if a figure cannot be drawn.
    pub fn html(&self) -> Result<String, Failure> {
        let blocks = self.blocks.iter().enumerate().map(|(at, block)| block.markup(at));
        let blocks = blocks.collect::<Result<Vec<_>, _>>()?;
        let first = self.blocks.iter().position(|block| matches!(block, Block::Heading(_))).unwrap_or(blocks.len());
        let body = html! {
            main {
                h1 { (self.title) }
                @for block in &blocks[..first] { (block) }
                nav {
                    @for (at, block) in self.blocks.iter().enumerate() {
                        @if let Block::Heading(text) = block { a href={ "#s" (at) } { (text) } }
                    }
                }
                @for block in &blocks[first..] { (block) }
                footer { (self.footer) }
            }
        };
        Ok(whole(&self.title, CSS, &body))
    }
}

impl Block {
    fn markup(&self, at: usize) -> Result<Markup, Failure> {
        Ok(match self {
            Self::Heading(text) => html! { h2 id={ "s" (at) } { (text) } },
            Self::Subheading(text) => html! { h3 { (text) } },
            Self::Text(text) => html! { p { (text) } },
            Self::List(lines) => html! { ul { @for line in lines { li { (line) } } } },
            Self::Tiles(tiles) => html! {
                div class="tiles" { @for (value, what) in tiles { div { b { (value) } span { (what) } } } }
            },
            Self::Warnings(none) if none.is_empty() => html! { p class="fine" { "Nothing to worry about was found." } },
            Self::Warnings(all) => html! {
                div class="warnings" role="note" { ul { @for warning in all { li { (warning) } } } }
            },
            Self::Table(table) => table.markup(),
            Self::Figures(pictures) => gallery("figures", pictures)?,
            Self::Gallery(pictures) => gallery("figures gallery", pictures)?,
            Self::Code(language, code) => html! {
                details { summary { (language) } pre { code { (code.trim_end()) } } }
            },
        })
    }
}

fn gallery(class: &str, pictures: &[Picture]) -> Result<Markup, Failure> {
    let pictures = pictures.iter().map(Picture::markup).collect::<Result<Vec<_>, _>>()?;
    Ok(html! { div class=(class) { @for one in pictures { (one) } } })
}

impl Picture {
    fn markup(&self) -> Result<Markup, Failure> {
        let svg = match &self.drawing {
            Drawing::Figure(figure) => &figure.svg_for_page()?,
            Drawing::Intervals(figure) => &figure.svg_for_page()?,
            Drawing::Svg(svg) => svg,
        };
        Ok(html! {
            figure {
                (PreEscaped(svg))
                figcaption { b { (self.title) } (self.caption) }
                @if let Some(table) = &self.numbers { details { summary { "numbers" } (table.markup()) } }
            }
        })
    }
}

impl Table {
    fn markup(&self) -> Markup {
        html! {
            div class="wide" {
                table {
                    thead { tr {
                        @for (at, head) in self.head.iter().enumerate() {
                            th scope="col" class=[self.has_numbers(at).then_some("number")] { (head) }
                        }
                    } }
                    tbody { @for row in &self.rows { tr { @for cell in row { (cell.markup()) } } } }
                }
            }
        }
    }

    fn has_numbers(&self, column: usize) -> bool {
        let first = self.rows.first().and_then(|row| row.get(column));
        matches!(first, Some(Cell::Number(_) | Cell::Count(_)))
    }
}

impl Cell {
    fn markup(&self) -> Markup {
        match self {
            Self::Text(text) | Self::Note(text) => html! { td { (text) } },
            // Names stay in one line; hashes, which are longer, may not.
            Self::Code(text) => html! { td { code class=[(text.len() <= 32).then_some("short")] { (text) } } },
            Self::Number(text) => html! { td class="number" { (text) } },
            Self::Count(count) => html! { td class="number" { (grouped(*count)) } },
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

    fn page() -> Document {
        let row = vec![Cell::code("<b>"), Cell::Count(1200), Cell::Bar(1.7, "170 %".to_owned())];
        let table = Table::new(["rule", "attempts", "held"], [row]);
        let blocks = vec![Block::Warnings(Vec::new()), Block::Heading("A & B".to_owned()), Block::Table(table)];
        Document { title: "<script>".to_owned(), blocks, footer: String::new() }
    }

    #[test]
    fn words_are_words_and_never_markup() {
        let html = page().html().unwrap();
        assert!(html.contains("&lt;script&gt;") && !html.contains("<script"), "{html}");
        assert!(html.contains("<code class=\"short\">&lt;b&gt;</code>") && html.contains("A &amp; B"), "{html}");
    }

    #[test]
    fn numbers_stand_right_and_bars_end_at_their_frame() {
        let html = page().html().unwrap();
        assert!(html.contains("<th scope=\"col\" class=\"number\">attempts</th>"), "{html}");
        assert!(html.contains("<td class=\"number\">1,200</td>") && html.contains("width:100.0%"), "{html}");
    }

    #[test]
    fn a_page_asks_nobody_for_anything() {
        let html = page().html().unwrap();
        for word in ["http:", "https:", "src=", "@import", "url("] {
            assert!(!html.contains(word), "{word} is in {html}");
        }
    }

    #[test]
    fn what_is_worrying_is_said_and_so_is_that_nothing_is() {
        assert!(page().html().unwrap().contains("Nothing to worry about"));
        let mut worried = page();
        worried.blocks[0] = Block::Warnings(vec!["no positives".to_owned()]);
        let worried = worried.html().unwrap();
        assert!(worried.contains("<li>no positives</li>") && !worried.contains("Nothing to worry"));
    }

    #[test]
    fn the_list_of_sections_leads_to_each() {
        let html = page().html().unwrap();
        assert!(html.contains("<nav><a href=\"#s1\">A &amp; B</a></nav><h2 id=\"s1\">A &amp; B</h2>"), "{html}");
    }
}
