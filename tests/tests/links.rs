//! Links of the pages lead somewhere: to a file of the repository and, after `#`, to a heading in it.

use std::path::{Component, Path, PathBuf};

use workspace_tests::{SourceFile, assert_none, files, read, root};

/// The lines of a page that are not code.
fn prose(page: &SourceFile) -> Vec<&str> {
    let mut code = false;
    let lines = page.text.lines().filter(|line| {
        let fence = line.starts_with("```");
        code ^= fence;
        !code && !fence
    });
    lines.collect()
}

/// The targets of `](target)` on a page.
fn targets(page: &SourceFile) -> impl Iterator<Item = &str> {
    let links = prose(page).into_iter().flat_map(|line| line.split("](").skip(1));
    links.filter_map(|rest| rest.split([')', ' ']).next())
}

/// What `#…` calls a heading: its words in small letters, joined by hyphens, without marks.
fn anchor(heading: &str) -> String {
    // Of a link in a heading the text counts.
    let mut words = heading.split("](");
    let mut text = words.next().unwrap_or_default().to_owned();
    words.for_each(|rest| text.push_str(rest.split_once(')').map_or("", |(_, rest)| rest)));
    let kept = text.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).flat_map(char::to_lowercase).collect()
}

fn headings(page: &SourceFile) -> impl Iterator<Item = String> {
    prose(page).into_iter().filter(|line| line.starts_with('#')).map(|line| anchor(line.trim_start_matches('#')))
}

/// A path from the root, without `.` and `..`; none if it leaves the repository.
fn tidy(path: &Path) -> Option<PathBuf> {
    let mut tidy = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => tidy.pop().then_some(())?,
            Component::CurDir => {}
            part => tidy.push(part),
        }
    }
    Some(tidy)
}

#[test]
fn links_lead_somewhere() {
    let pages = files(|path| path.ends_with(".md"));
    let mut problems = Vec::new();
    for page in &pages {
        let here = Path::new(&page.path).parent().expect("a page lies in a folder");
        for target in targets(page).filter(|target| !target.contains(':')) {
            let (path, heading) =
                target.split_once('#').map_or((target, None), |(path, heading)| (path, Some(heading)));
            let file = if path.is_empty() { Some(PathBuf::from(&page.path)) } else { tidy(&here.join(path)) };
            let Some(file) = file.filter(|file| root().join(file).exists()) else {
                problems.push(format!("{}: there is no {target}", page.path));
                continue;
            };
            let linked = heading.zip(pages.iter().find(|other| Path::new(&other.path) == file));
            if linked.is_some_and(|(heading, other)| !headings(other).any(|found| found == heading)) {
                problems.push(format!("{}: {} has no heading for {target}", page.path, file.display()));
            }
        }
    }
    assert_none("links", &problems);
}

/// As `scripts/site.py check` finds, which takes a site that is made.
#[test]
fn the_site_shows_every_page() {
    let site = read("docs/zensical.toml");
    let pages = files(|path| path.ends_with(".md") && (path.starts_with("docs/") || path.starts_with("models/")));
    let hidden = pages.iter().filter(|page| !site.contains(&format!("\"{}\"", page.path)));
    assert_none("docs/zensical.toml must name", &hidden.map(|page| page.path.clone()).collect::<Vec<_>>());
}

#[test]
fn a_heading_is_called_as_forges_call_it() {
    assert_eq!(anchor(" One noisy side view: GIGA's protocol"), "one-noisy-side-view-gigas-protocol");
    assert_eq!(anchor(" Beyond: [the `x` page](x.md), now"), "beyond-the-x-page-now");
}
