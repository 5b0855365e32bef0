//! Documents as a terminal's text.

use program::text::grouped;

use super::{Block, Cell, Document, Table};

impl Document {
    /// The document as aligned text.
    #[must_use]
    pub fn text(&self) -> String {
        let title = (!self.title.is_empty()).then(|| format!("{}\n", self.title));
        let blocks = self.blocks.iter().map(Block::text).filter(|text| !text.is_empty());
        title.into_iter().chain(blocks).collect::<Vec<_>>().join("\n")
    }
}

impl Block {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_aligned_and_has_no_blanks_at_its_ends() {
        let row = |name: &str, count, share: f64| {
            let bar = Cell::Bar(share, format!("{:.0} %", 100.0 * share));
            vec![Cell::code(name), Cell::Count(count), bar, Cell::note("why")]
        };
        let table = Table::new(["what", "count", "share", "meaning"], [row("long name", 1200, 0.5), row("d", 7, 0.0)]);
        let blocks = vec![Block::Text("Words.".to_owned()), Block::Heading("Counts".to_owned()), Block::Table(table)];
        let document = Document { title: "Title".to_owned(), blocks, footer: String::new() };
        let expected = "Title\n\nWords.\n\nCounts\n\n\
                        what       count  share\n\
                        long name  1,200   50 %\n\
                        d              7    0 %\n";
        assert_eq!(document.text(), expected);
    }
}
