//! A result as an ordered list of blocks, which is described once and becomes a page, Markdown or a terminal's text.
//!
//! A page is one file (a folder's pages share their scripts): no network, light and dark, from a phone's width to a
//! wall's. Pages show everything; Markdown and terminals leave out what only a page has room for: cards and columns of
//! notes.

pub(crate) mod html;
mod plain;

use schema::Outcome;

/// A result that is described.
#[derive(Debug, Clone, Default)]
pub struct Document {
    /// Its title; empty for none.
    pub title: String,
    /// What it says, in order.
    pub blocks: Vec<Block>,
    /// The last line of a page: what made it of what.
    pub footer: String,
}

/// A part of a document.
#[derive(Debug, Clone)]
pub enum Block {
    /// The heading of a section, in a page's list of sections too.
    Heading(String),
    /// A paragraph.
    Text(String),
    /// What a reader wants to know first: numbers, and what they are.
    Tiles(Vec<(String, String)>),
    /// What a reader should be worried about; a page also says if there is nothing.
    Warnings(Vec<String>),
    /// A table.
    Table(Table),
    /// Cards side by side that lead to pages; on pages only.
    Gallery(Vec<Card>),
    /// Pages beside this one: words and file; on pages only.
    Links(Vec<(String, String)>),
    /// A choice of outcomes, by which the cards in the gallery below are shown; on pages of a folder only.
    Filter,
    /// A program's input in the language that is named.
    Code(&'static str, String),
}

/// What is to be known of a page.
#[derive(Debug, Clone)]
pub struct Card {
    /// What the page shows, in bold.
    pub title: String,
    /// What else there is to say.
    pub caption: String,
    /// The page's file.
    pub link: String,
}

/// A table. A column's cells are of one kind, which decides how it is aligned.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// Heads of the columns.
    pub head: Vec<String>,
    /// Rows of as many cells.
    pub rows: Vec<Vec<Cell>>,
}

/// A cell of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Words.
    Text(String),
    /// Something from a program: a name, a hash, a path.
    Code(String),
    /// An outcome, beside the colour that it has in views.
    Outcome(Outcome),
    /// A number, as it is to be read.
    Number(String),
    /// A count: `1,234` where people read it, `1234` in Markdown.
    Count(u64),
    /// A share from 0 to 1 as a bar, and in words beside it.
    Bar(f64, String),
    /// An explanation, which only a page has room for.
    Note(String),
}

impl Table {
    /// A table from its heads and rows.
    pub fn new<T: Into<String>>(head: impl IntoIterator<Item = T>, rows: impl IntoIterator<Item = Vec<Cell>>) -> Self {
        Self { head: head.into_iter().map(Into::into).collect(), rows: rows.into_iter().collect() }
    }

    fn is_right(&self, column: usize) -> bool {
        let first = self.rows.first().and_then(|row| row.get(column));
        matches!(first, Some(Cell::Number(_) | Cell::Count(_) | Cell::Bar(..)))
    }

    /// The columns that are shown without a page.
    fn plain_columns(&self) -> Vec<usize> {
        let is_note = |column: &usize| self.rows.iter().any(|row| matches!(row.get(*column), Some(Cell::Note(_))));
        (0..self.head.len()).filter(|column| !is_note(column)).collect()
    }
}

impl Cell {
    /// A name or anything else from a program.
    pub fn code(text: impl Into<String>) -> Self {
        Self::Code(text.into())
    }

    /// An explanation.
    pub fn note(text: impl Into<String>) -> Self {
        Self::Note(text.into())
    }
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self::Text(text.into())
    }
}
