//! Styles and scripts of pages.

/// The style of documents.
pub(crate) const PAGE_STYLE: &str = include_str!("page.css");
/// The colours of outcomes, in every page.
pub(crate) const OUTCOMES: &str = include_str!("outcomes.css");
/// The style of a view's page.
pub(crate) const VIEWER_STYLE: &str = include_str!("viewer.css");
/// The program that draws a view.
pub(crate) const VIEWER: &str = include_str!("viewer.js");
/// The program that chooses among a folder's scenes.
pub(crate) const BROWSE: &str = include_str!("browse.js");
