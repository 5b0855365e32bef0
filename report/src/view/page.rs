//! The page of a view: one file, or one of a folder's; no network, no library.

use maud::{Markup, PreEscaped, html};

use super::folder::{BROWSE, LISTING, Place, VIEWER, VIEWER_STYLE};
use super::{EventKind, View};
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

    /// Its page in a folder, which has the style and the scripts.
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
                @if self.moves() { (player()) }
            }
            aside {
                section { h2 { "Shown" } div #legend {} }
                section #depth hidden {
                    h2 { "Depth images" }
                    div {}
                    p { "As its cameras see the scene, without a sensor's noise; near is light." }
                }
                @if let Some(place) = place.filter(|place| !place.attempts.is_empty()) { (attempts(place)) }
                @if !self.events.is_empty() { (self.event_list()) }
                @if !self.facts.is_empty() { (self.fact_list()) }
            }
            script #view type="application/json" { (PreEscaped(in_script(&self.to_json()))) }
            @if let Some(place) = place {
                @let opens = serde_json::to_string(&place.opens).expect("numbers and strings are always JSON");
                script #opens type="application/json" { (PreEscaped(in_script(&opens))) }
                script src=(VIEWER) {}
                script src=(LISTING) {}
                script src=(BROWSE) {}
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
            section {
                h2 { "What happens" }
                ol #events {
                    @for event in &self.events {
                        @let time_s = self.frames.get(event.frame).map_or(0.0, |frame| frame.time_s);
                        li class=(kind(event.kind)) {
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
                dl { @for fact in &self.facts { div { dt { (fact.key) } dd { (fact.value) } } } }
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
            @for (words, file) in &place.links { a href=(file) { (words) } }
        }
    }
}

fn attempts(place: &Place) -> Markup {
    html! {
        section {
            h2 { "Attempts " span #chosen {} }
            ol #attempts {
                @for one in &place.attempts {
                    li data-attempt=(one.attempt) {
                        i class={ "swatch " (one.outcome.name()) } {}
                        @if let Some(file) = &one.link { a href=(file) title="replay" { (one.id) " ▶" } } @else { (one.id) }
                        span { (in_words(one.outcome)) } small { (one.words) }
                    }
                }
            }
        }
    }
}

fn player() -> Markup {
    html! {
        div #player {
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

fn kind(kind: EventKind) -> &'static str {
    match kind {
        EventKind::Phase => "phase",
        EventKind::Note => "note",
        EventKind::Held => "held",
        EventKind::Failed => "failed",
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
    use super::*;

    fn view() -> View {
        let mut view = View::new("</script><script>alert(1)</script> & co");
        view.points.push(Line {
            class: Class::Contact,
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
        view.lines.push(Line::workspace(0.3));
        let attempt = ListedAttempt {
            attempt: 19,
            id: "7/19".to_owned(),
            outcome: schema::Outcome::HitOther,
            words: "cuboid_x".to_owned(),
            link: Some("replay-7-19.html".to_owned()),
        };
        let place = Place {
            next: Some("scene-9.html".to_owned()),
            links: vec![("all scenes".to_owned(), "index.html".to_owned())],
            opens: [(0, "replay-7-19.html".to_owned())].into(),
            attempts: vec![attempt],
            ..Place::default()
        };
        let page = view.page_in(&place);
        assert!(!page.contains("getContext") && page.contains("<script src=\"viewer.js\"></script>"), "{page}");
        assert!(page.contains("{\"0\":\"replay-7-19.html\"}"), "{page}");
        for link in [
            "<a id=\"previous\" hidden>",
            "<a id=\"next\" href=\"scene-9.html\">",
            "<a href=\"index.html\">all scenes</a>",
        ] {
            assert!(page.contains(link), "{link}: {page}");
        }
        assert!(
            page.contains("<a href=\"replay-7-19.html\" title=\"replay\">7/19 ▶</a><span>hit other</span>"),
            "{page}"
        );
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
