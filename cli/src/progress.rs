//! Progress bars. Without a terminal indicatif draws nothing.

use indicatif::ProgressStyle;

/// How many of how many of these there are, what is told besides, and the time that is left.
pub(crate) fn style(of: &str) -> ProgressStyle {
    let template = format!("{{bar:32}} {{human_pos}}/{{human_len}} {of} · {{msg}} · {{eta}} left");
    ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar())
}
