//! The page of a view: one file, or one of a folder's; no network, no library.

use maud::{Markup, PreEscaped, html};

use super::View;
use super::folder::{BROWSE, INDEX, LISTING, Place, REPORT, Shelf, VIEWER, VIEWER_STYLE};
use crate::assets;
use crate::document::html::{in_words, whole};

const PICTURE: &str = "a picture in space that can be turned about";
const HINT: &str = "drag to turn · wheel or pinch to zoom · right button or two fingers to shift · double click to go back · c copies the id under the \
     mouse";

impl View {
    /// One HTML file that shows it and lets it be turned about. Without a script only what is known besides can be
    /// read.
    #[must_use]
    pub fn page(&self) -> String {
        whole(&self.title, Some(assets::VIEWER_STYLE), &self.body(None))
    }

    /// The page of a scene in a folder, which has the style and the scripts. Where the address names an attempt, the
    /// scripts show its replay there.
    #[must_use]
    pub fn page_in(&self, place: &Place) -> String {
        whole(&self.title, None, &self.body(Some(place)))
    }

    fn body(&self, place: Option<&Place>) -> Markup {
        html! {
            header {
                h1 { (self.title) }
                @if let Some(place) = place { (navigation(place)) }
            }
            main {
                div #stage {
                    canvas #canvas tabindex="0" role="img" aria-label=(PICTURE) {}
                    p #hint { (HINT) }
                    div #tip role="status" hidden {}
                    noscript { p { "The picture is drawn by a script in this file, and scripts are off." } }
                }
                @if self.moves() || place.is_some() { (player(self.moves())) }
            }
            aside {
                section { h2 { "Shown" } div #legend {} }
                section #depth hidden {
                    h2 { "Depth images" }
                    div {}
                    p { "As its cameras see the scene, without a sensor's noise; near is light." }
                }
                @if let Some(place) = place.filter(|place| !place.attempts.is_empty()) { (attempts(place)) }
                @if !self.events.is_empty() || place.is_some() { (self.event_list()) }
                @if !self.facts.is_empty() { (self.fact_list()) }
            }
            script #view type="application/json" { (PreEscaped(in_script(&self.to_json()))) }
            @if let Some(place) = place {
                @for (attempt, packed) in &place.replays {
                    script id={ "replay-" (attempt) } type="text/plain" { (packed) }
                }
                script src=(LISTING) {}
                script src=(BROWSE) {}
                script src=(VIEWER) {}
            } @else {
                script { (PreEscaped(assets::VIEWER)) }
            }
        }
    }

    fn moves(&self) -> bool {
        self.frames.len() > 1
    }

    fn event_list(&self) -> Markup {
        html! {
            section #happens hidden[self.events.is_empty()] {
                h2 { "What happens" }
                ol #events {
                    @for event in &self.events {
                        @let time_s = self.frames.get(event.frame).map_or(0.0, |frame| frame.time_s);
                        li class=(event.kind.name()) {
                            button type="button" data-frame=(event.frame) {
                                @if self.moves() { span.time { (format!("{time_s:.2} s")) } " " }
                                (event.text)
                            }
                        }
                    }
                }
            }
        }
    }

    fn fact_list(&self) -> Markup {
        html! {
            section {
                h2 { "Known" }
                dl #facts { @for fact in &self.facts { div { dt { (fact.key) } dd { (fact.value) } } } }
            }
        }
    }
}

fn navigation(place: &Place) -> Markup {
    let way = |id: &str, words: &str, file: &Option<String>| {
        html! { a id=(id) href=[file.as_ref()] hidden[file.is_none()] { (words) } }
    };
    html! {
        link rel="stylesheet" href=(VIEWER_STYLE);
        nav {
            (way("previous", "← previous", &place.previous))
            (way("next", "next →", &place.next))
            (way("scene", "scene", &None))
            a href=(INDEX) { "all " (place.shelf.words()[0]) }
            @if place.shelf == Shelf::Scenes { a href=(REPORT) { "report" } }
        }
    }
}

fn attempts(place: &Place) -> Markup {
    html! {
        section #list {
            h2 { (capital(place.shelf.words()[1])) " " span #chosen {} }
            ol #attempts {
                @for one in &place.attempts {
                    li data-attempt=(one.attempt) {
                        i class={ "swatch " (one.outcome.name()) } {}
                        @if place.replays.is_empty() { (one.id) } @else {
                            a href={ "#attempt=" (one.attempt) } title="replay" { (one.id) " ▶" }
                        }
                        span { (in_words(one.outcome)) } small { (one.words) }
                    }
                }
            }
        }
    }
}

fn capital(word: &str) -> String {
    let (first, rest) = word.split_at(1);
    first.to_uppercase() + rest
}

fn player(is_shown: bool) -> Markup {
    html! {
        div #player hidden[!is_shown] {
            button #play type="button" aria-label="play or pause (space)" { "▶" }
            div #track { div #marks {} input #scrub type="range" min="0" step="1" value="0" aria-label="frame"; }
            output #clock {}
            label { "speed " select #speed {
                option value="0.1" { "1/10" } option value="0.25" { "1/4" }
                option value="0.5" { "1/2" } option value="1" selected { "1" }
            } }
            output #phase {}
        }
    }
}

/// JSON in which no text can end the script element early: `<` occurs only in JSON strings, where it may be escaped.
fn in_script(json: &str) -> String {
    json.replace('<', "\\u003c")
}

#[cfg(test)]
mod tests {
    use super::super::folder::ListedAttempt;
    use super::super::{Class, Fact, Frame, Line};
    use schema::Vec3;

    use super::*;

    fn view() -> View {
        let mut view = View::new("</script><script>alert(1)</script> & co");
        view.points.push(Line {
            class: Class::Surface,
            label: "<b>".to_owned(),
            points_m: vec![[0.1, 0.2, 0.3]],
            frames: Some([0, 1]),
        });
        view.fact("<i>key", "value & more");
        view.frames = vec![Frame { time_s: 0.0 }, Frame { time_s: 0.5 }];
        view
    }

    #[test]
    fn what_stands_in_a_page_s_json_is_the_view() {
        let page = view().page();
        let start = page.find("type=\"application/json\">").unwrap() + "type=\"application/json\">".len();
        let json = page[start..].split("</script>").next().unwrap();
        let back: View = serde_json::from_str(json).unwrap();
        assert_eq!(back, view());
    }

    #[test]
    fn text_stays_text() {
        let page = view().page();
        assert!(!page.contains("<script>alert") && !page.contains("<b>") && !page.contains("<i>key"), "{page}");
        assert_eq!(page.matches("<script").count(), 2, "the view and the program");
        assert!(page.contains("&lt;i&gt;key") && page.contains("value &amp; more"));
        assert_eq!(view().facts[0], Fact { key: "<i>key".to_owned(), value: "value & more".to_owned() });
    }

    #[test]
    fn a_page_asks_nobody_for_anything() {
        let page = view().page();
        for word in ["http:", "https:", "src=", "@import", "url(", "fetch(", "XMLHttpRequest", "import("] {
            assert!(!page.contains(word), "{word}");
        }
        assert!(page.contains("<noscript>"));
    }

    #[test]
    fn a_page_of_a_folder_shares_its_scripts_and_leads_on() {
        let mut view = View::new("Scene 7");
        view.lines.push(Line::workspace([Vec3::ZERO, Vec3::splat(0.3)]));
        let attempt = ListedAttempt {
            attempt: 19,
            id: "7/19".to_owned(),
            outcome: schema::Outcome::HitOther,
            words: "cuboid_x".to_owned(),
        };
        let place = Place {
            next: Some("scene-9.html".to_owned()),
            attempts: vec![attempt],
            replays: vec![(19, "eJw=".to_owned())],
            ..Place::default()
        };
        let page = view.page_in(&place);
        assert!(!page.contains("getContext") && page.contains("<script src=\"viewer.js\"></script>"), "{page}");
        assert!(page.contains("<script id=\"replay-19\" type=\"text/plain\">eJw=</script>"), "{page}");
        assert!(page.contains("<div id=\"player\" hidden>"), "the scene itself does not move: {page}");
        for link in [
            "<a id=\"previous\" hidden>",
            "<a id=\"next\" href=\"scene-9.html\">",
            "<a href=\"index.html\">all scenes</a>",
        ] {
            assert!(page.contains(link), "{link}: {page}");
        }
        assert!(page.contains("<a href=\"#attempt=19\" title=\"replay\">7/19 ▶</a><span>hit other</span>"), "{page}");
        let without = view.page_in(&Place { replays: Vec::new(), ..place });
        assert!(!without.contains("#attempt=") && without.contains("</i>7/19<span>"), "{without}");
        for word in ["http:", "https:", "@import", "url(", "fetch(", "XMLHttpRequest"] {
            assert!(!page.contains(word), "{word}");
        }
    }

    #[test]
    fn who_does_not_move_has_no_player() {
        let mut still = view();
        assert!(still.page().contains("id=\"scrub\""));
        still.frames.truncate(1);
        assert!(!still.page().contains("id=\"scrub\""));
    }
}
