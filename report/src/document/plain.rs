//! Documents as Markdown and as a terminal's text.

use program::text::{grouped, markdown_table};

use super::{Block, Cell, Document, Table};

impl Document {
    /// The document as Markdown, for files and for what is printed as such.
    #[must_use]
    pub fn markdown(&self) -> String {
        let title = (!self.title.is_empty()).then(|| format!("# {}\n", one_line(&self.title)));
        self.joined(title, Block::markdown)
    }

    /// The document as aligned text.
    #[must_use]
    pub fn text(&self) -> String {
        let title = (!self.title.is_empty()).then(|| format!("{}\n", self.title));
        self.joined(title, Block::text)
    }

    /// The title and what the blocks become, without blocks that become nothing.
    fn joined(&self, title: Option<String>, plain: impl Fn(&Block) -> String) -> String {
        let blocks = self.blocks.iter().map(plain).filter(|text| !text.is_empty());
        title.into_iter().chain(blocks).collect::<Vec<_>>().join("\n")
    }
}

impl Block {
    fn markdown(&self) -> String {
        match self {
            Self::Heading(text) => format!("## {}\n", one_line(text)),
            Self::Text(text) => format!("{text}\n"),
            Self::Warnings(lines) => lines.iter().map(|line| format!("- {line}\n")).collect(),
            Self::Tiles(tiles) => tiles.iter().map(|(value, what)| format!("- {value}: {what}\n")).collect(),
            Self::Table(table) => table.markdown(),
            Self::Gallery(_) | Self::Links(_) | Self::Filter => String::new(),
            Self::Code(language, code) => fenced(language, code),
        }
    }

    fn text(&self) -> String {
        match self {
            Self::Heading(text) | Self::Text(text) => format!("{text}\n"),
            Self::Warnings(lines) => lines.iter().map(|line| format!("warning: {line}\n")).collect(),
            Self::Tiles(tiles) => {
                let row = |(value, what): &(String, String)| vec![Cell::Number(value.clone()), Cell::from(what)];
                Table::new(["", ""], tiles.iter().map(row)).text()
            }
            Self::Table(table) => table.text(),
            Self::Gallery(_) | Self::Links(_) | Self::Filter => String::new(),
            Self::Code(_, code) => format!("{}\n", code.trim_end()),
        }
    }
}

impl Table {
    fn markdown(&self) -> String {
        let columns = self.plain_columns();
        let head: Vec<_> = columns.iter().map(|at| (self.head[*at].as_str(), self.is_right(*at))).collect();
        let cells = |row: &Vec<Cell>| columns.iter().filter_map(|at| row.get(*at)).map(Cell::markdown).collect();
        markdown_table(&head, self.rows.iter().map(cells))
    }

    /// Columns as wide as they must be, two blanks between them; a bar stands beside its words.
    fn text(&self) -> String {
        let mut lines = vec![String::new(); self.rows.len() + 1];
        for column in self.plain_columns() {
            let (head, empty) = (Cell::from(self.head[column].as_str()), Cell::from(""));
            let own = self.rows.iter().map(|row| row.get(column).unwrap_or(&empty));
            let cells: Vec<&Cell> = [&head].into_iter().chain(own).collect();
            let width = cells.iter().map(|cell| cell.words().chars().count()).max().unwrap_or(0);
            for (line, cell) in lines.iter_mut().zip(cells) {
                let words = cell.words();
                *line +=
                    &if self.is_right(column) { format!("{words:>width$}  ") } else { format!("{words:<width$}  ") };
            }
        }
        let has_head = self.head.iter().any(|head| !head.is_empty());
        lines.iter().skip(usize::from(!has_head)).map(|line| format!("{}\n", line.trim_end())).collect()
    }
}

impl Cell {
    fn words(&self) -> String {
        match self {
            Self::Text(text) | Self::Code(text) | Self::Number(text) | Self::Note(text) | Self::Bar(_, text) => {
                text.clone()
            }
            Self::Outcome(outcome) => outcome.name().to_owned(),
            Self::Count(count) => grouped(*count),
        }
    }

    fn markdown(&self) -> String {
        if let Self::Count(count) = self { count.to_string() } else { self.words() }
    }
}

/// Text that stands in a heading or a cell, whatever it is made of.
fn one_line(text: &str) -> String {
    text.replace(char::is_control, " ")
}

/// A code block, fenced with more backticks than the code has in a row.
fn fenced(language: &str, code: &str) -> String {
    let longest = code.split(|letter| letter != '`').map(str::len).max().unwrap_or(0);
    let fence = "`".repeat(3.max(longest + 1));
    format!("{fence}{language}\n{}\n{fence}\n", code.trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document() -> Document {
        let row = |name: &str, count, share: f64| {
            vec![
                Cell::code(name),
                Cell::Count(count),
                Cell::Bar(share, format!("{:.0} %", 100.0 * share)),
                Cell::note("why"),
            ]
        };
        let table = Table::new(["what", "count", "share", "meaning"], [row("a|b\nc", 1200, 0.5), row("d", 7, 0.0)]);
        let blocks = vec![Block::Text("Words.".to_owned()), Block::Heading("Counts".to_owned()), Block::Table(table)];
        Document { title: "Title".to_owned(), blocks, footer: String::new() }
    }

    #[test]
    fn names_cannot_break_a_table() {
        let expected = "# Title\n\nWords.\n\n## Counts\n\n| what | count | share |\n|---|---:|---:|\n\
                        | a\\|b c | 1200 | 50 % |\n| d | 7 | 0 % |\n";
        assert_eq!(document().markdown(), expected);
        assert_eq!(fenced("sh", "x"), "```sh\nx\n```\n");
        assert_eq!(fenced("toml", "a = \"```\""), "````toml\na = \"```\"\n````\n");
    }

    #[test]
    fn text_is_aligned_and_has_no_blanks_at_its_ends() {
        let mut document = document();
        document.blocks.truncate(2);
        document.blocks.push(Block::Table(Table::new(
            ["what", "count", "share"],
            [
                vec![Cell::from("long name"), Cell::Count(1200), Cell::Bar(0.5, "50 %".to_owned())],
                vec![Cell::from("d"), Cell::Count(7), Cell::Bar(0.0, "0 %".to_owned())],
            ],
        )));
        let expected = "Title\n\nWords.\n\nCounts\n\n\
                        what       count  share\n\
                        long name  1,200   50 %\n\
                        d              7    0 %\n";
        assert_eq!(document.text(), expected);
    }
}
