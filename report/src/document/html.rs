//! Documents as pages.

use maud::{DOCTYPE, Markup, PreEscaped, html};
use program::text::grouped;
use schema::Outcome;

use crate::assets::{OUTCOMES, PAGE_STYLE};
use crate::view::folder;

use super::{Block, Card, Cell, Document, Table};

/// The longest name that stays in one line, in bytes.
const SHORT_MAX: usize = 32;

/// Everything that all pages have; those of a folder name their style themselves.
pub(crate) fn whole(title: &str, css: Option<&str>, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                link rel="icon" href="data:,";
                title { (title) }
                @if let Some(css) = css { style { (PreEscaped(OUTCOMES)) (PreEscaped(css)) } }
            }
            body { (body) }
        }
    };
    page.into_string() + "\n"
}

impl Document {
    /// The document as a page in one file. The same document always has the same bytes.
    #[must_use]
    pub fn html(&self) -> String {
        let blocks: Vec<Markup> = self.blocks.iter().enumerate().map(|(at, block)| block.markup(at)).collect();
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
        whole(&self.title, Some(PAGE_STYLE), &body)
    }
}

impl Block {
    fn markup(&self, at: usize) -> Markup {
        match self {
            Self::Heading(text) => html! { h2 id={ "s" (at) } { (text) } },
            Self::Text(text) => html! { p { (text) } },
            Self::Tiles(tiles) => html! {
                div.tiles { @for (value, what) in tiles { div { b { (value) } span { (what) } } } }
            },
            Self::Warnings(none) if none.is_empty() => html! { p class="fine" { "Nothing to worry about was found." } },
            Self::Warnings(all) => html! {
                div class="warnings" role="note" { ul { @for warning in all { li { (warning) } } } }
            },
            Self::Table(table) => table.markup(),
            Self::Gallery(cards) => html! { div.gallery { @for card in cards { (card.markup()) } } },
            Self::Links(links) => {
                html! { p class="links" { @for (words, file) in links { a href=(file) { (words) } " " } } }
            }
            Self::Filter => filter(),
            Self::Code(language, code) => html! {
                details { summary { (language) } pre { code { (code.trim_end()) } } }
            },
        }
    }
}

/// A choice that the page's scripts act on; nothing without scripts, for then all is shown.
fn filter() -> Markup {
    html! {
        form #filter hidden {
            label { "outcome " select name="outcome" {
                option value="" { "all" }
                @for outcome in Outcome::ALL { option { (outcome.name()) } }
            } }
            output #found {}
        }
        script src=(folder::LISTING) {}
        script src=(folder::BROWSE) defer {}
    }
}

/// As people read it.
pub(crate) fn in_words(outcome: Outcome) -> String {
    outcome.name().replace('_', " ")
}

impl Card {
    fn markup(&self) -> Markup {
        html! { figure { figcaption { b { a href=(self.link) { (self.title) } } (self.caption) } } }
    }
}

impl Table {
    fn markup(&self) -> Markup {
        html! {
            div.wide {
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
            Self::Code(text) => {
                html! { td { code class=[(text.len() <= SHORT_MAX).then_some("short")] { (text) } } }
            }
            Self::Outcome(outcome) => {
                html! { td { i class={ "swatch " (outcome.name()) } {} code.short { (outcome.name()) } } }
            }
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
        let html = page().html();
        assert!(html.contains("&lt;script&gt;") && !html.contains("<script"), "{html}");
        assert!(html.contains("<code class=\"short\">&lt;b&gt;</code>") && html.contains("A &amp; B"), "{html}");
    }

    #[test]
    fn numbers_stand_right_and_bars_end_at_their_frame() {
        let html = page().html();
        assert!(html.contains("<th scope=\"col\" class=\"number\">attempts</th>"), "{html}");
        assert!(html.contains("<td class=\"number\">1,200</td>") && html.contains("width:100.0%"), "{html}");
    }

    #[test]
    fn a_card_leads_to_its_page() {
        let [title, caption, link] = ["Scene 7", "three objects", "scene-7.html"].map(str::to_owned);
        let html = Card { title, caption, link }.markup().into_string();
        assert!(html.contains("<a href=\"scene-7.html\">Scene 7</a></b>three objects"), "{html}");
    }

    #[test]
    fn every_outcome_has_a_colour_of_its_own_in_the_light_and_in_the_dark() {
        for outcome in Outcome::ALL {
            assert_eq!(OUTCOMES.matches(&format!("--{}: #", outcome.name())).count(), 2, "{outcome:?}");
            assert!(OUTCOMES.contains(&format!(".{} {{ stroke: var(--{0}); }}", outcome.name())), "{outcome:?}");
        }
        let mut colours: Vec<&str> = OUTCOMES.split(": #").skip(1).map(|rest| &rest[..6]).collect();
        colours.sort_unstable();
        colours.dedup();
        assert_eq!(colours.len(), 12, "{colours:?}");
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
        let mut worried = page();
        worried.blocks[0] = Block::Warnings(vec!["no positives".to_owned()]);
        let worried = worried.html();
        assert!(worried.contains("<li>no positives</li>") && !worried.contains("Nothing to worry"));
    }

    #[test]
    fn the_list_of_sections_leads_to_each() {
        let html = page().html();
        assert!(html.contains("<nav><a href=\"#s1\">A &amp; B</a></nav><h2 id=\"s1\">A &amp; B</h2>"), "{html}");
    }
}
