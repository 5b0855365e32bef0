//! A folder of pages that lead to each other: all scenes, a page for each scene, a page for each replay. They share
//! their style and scripts, which are files of the folder; nothing else is asked for, so a browser opens it from a
//! disk.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::assets;

/// The page of all scenes.
pub const INDEX: &str = "index.html";
/// The page of statistics.
pub const REPORT: &str = "report.html";
/// What [`Listing`] becomes.
pub const LISTING: &str = "scenes.js";
/// What chooses among the scenes of the listing.
pub const BROWSE: &str = "browse.js";
pub(crate) const VIEWER: &str = "viewer.js";
pub(crate) const VIEWER_STYLE: &str = "viewer.css";

/// The page of a scene.
#[must_use]
pub fn scene_file(scene: u64) -> String {
    format!("scene-{scene}.html")
}

/// The page of an attempt that was executed again.
#[must_use]
pub fn replay_file(scene: u64, attempt: u32) -> String {
    format!("replay-{scene}-{attempt}.html")
}

/// Whether a file of the folder is the page of a scene or of a replay.
#[must_use]
pub fn is_scene_or_replay(name: &str) -> bool {
    let of = |prefix: &str| name.strip_prefix(prefix).and_then(|rest| rest.strip_suffix(".html"));
    of("scene-").or(of("replay-")).is_some_and(|id| id.bytes().all(|byte| byte.is_ascii_digit() || byte == b'-'))
}

/// The files that the pages share: name and text.
#[must_use]
pub fn shared_files() -> [(&'static str, String); 3] {
    [
        (VIEWER, assets::VIEWER.to_owned()),
        (VIEWER_STYLE, format!("{}{}", assets::OUTCOMES, assets::VIEWER_STYLE)),
        (BROWSE, assets::BROWSE.to_owned()),
    ]
}

/// A property of attempts that they can be chosen by.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Facet {
    /// Its name.
    pub name: String,
    /// Its values.
    pub choices: Vec<String>,
}

/// The scenes of a folder with their attempts, for its scripts.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Listing {
    /// Properties of attempts.
    pub facets: Vec<Facet>,
    /// The scenes in the order of their pages.
    pub scenes: Vec<ListedScene>,
}

/// A scene of a listing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ListedScene {
    /// Its number.
    pub id: u64,
    /// For each attempt its number, then for each facet the place of its value among the choices.
    pub attempts: Vec<Vec<u32>>,
}

impl Listing {
    /// The listing as a script.
    #[must_use]
    pub fn script(&self) -> String {
        let json = serde_json::to_string(self).expect("strings, numbers and lists are always JSON");
        format!("const listing = {json};\n")
    }
}

/// Where a view's page stands in a folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Place {
    /// The pages before and after it.
    pub previous: Option<String>,
    /// See `previous`.
    pub next: Option<String>,
    /// Other pages: words and file.
    pub links: Vec<(String, String)>,
    /// The pages that clicks on lines of the view open: place among the lines, and file.
    pub opens: BTreeMap<usize, String>,
    /// The view's attempts, beside it.
    pub attempts: Vec<ListedAttempt>,
}

/// An attempt in the list beside a view.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListedAttempt {
    /// Its number in its scene.
    pub attempt: u32,
    /// Its id: `7/19`.
    pub id: String,
    /// How it ended.
    pub outcome: schema::Outcome,
    /// What else there is to say.
    pub words: String,
    /// Its replay.
    pub link: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pages_of_scenes_and_replays_are_taken_for_such() {
        assert!(is_scene_or_replay(&scene_file(7)) && is_scene_or_replay(&replay_file(7, 19)));
        for name in ["scene-a.html", "index.html", "replay-7-19.htm", "my-scene-7.html", "scene-7.html.bak"] {
            assert!(!is_scene_or_replay(name), "{name}");
        }
    }

    #[test]
    fn a_listing_is_a_script_of_one_constant() {
        let facets = vec![Facet { name: "outcome".to_owned(), choices: vec!["held".to_owned()] }];
        let scenes = vec![ListedScene { id: 7, attempts: vec![vec![19, 0]] }];
        let script = Listing { facets, scenes }.script();
        let json = script.strip_prefix("const listing = ").and_then(|rest| rest.strip_suffix(";\n")).unwrap();
        let back: serde_json::Value = serde_json::from_str(json).unwrap();
        assert_eq!(back["scenes"][0]["attempts"][0], serde_json::json!([19, 0]));
    }
}
