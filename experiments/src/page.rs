//! Experiments that were run as a page: rates with their intervals, why attempts failed, pictures of scenes with the
//! grasps that were executed; several of them side by side.

mod differences;
mod pictures;
mod sections;
mod warnings;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use program::text::grouped;
use program::{Exit, ExitCode};
use report::page::{Block, Page, Picture, Section};

use crate::report::{About, FigureError, Row, comparison_of_rates, read_whole, share, svg_for_page};
use crate::round::Round;
use crate::run::{JOURNAL, journalled};
use crate::statistics::{DRAWS, Results};

use pictures::Stage;

/// An experiment that was run, as its folder tells of it.
#[derive(Debug)]
pub struct Played {
    folder: PathBuf,
    results: Results,
    about: About,
    /// None where the journal was not kept.
    rounds: Option<Vec<Round>>,
    /// `None` where `run.json` was not kept.
    stage: Option<Stage>,
}

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// There is no experiment, or it is not done.
    #[error("no experiment that is done here, report.json comes after the last round: {}", .0.display())]
    Missing(PathBuf),
    /// A file is not what a run writes.
    #[error("damaged {}: {reason}", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The system refused.
    #[error("failed to {action}: {source}: {}", .path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The library that draws failed.
    #[error(transparent)]
    Figure(#[from] FigureError),
}

impl Exit for PageError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Missing(_) => ExitCode::Config,
            Self::Damaged { .. } => ExitCode::Data,
            Self::Io { .. } => ExitCode::TryAgain,
            Self::Figure(_) => ExitCode::Internal,
        }
    }
}

impl Played {
    /// Reads the folder of an experiment: `report.json` and, for the pictures, `journal.jsonl`, `run.json` and
    /// `bodies.json`.
    ///
    /// # Errors
    /// [`PageError`].
    pub fn read(folder: &Path) -> Result<Self, PageError> {
        let path = folder.join("report.json");
        let text = read_text(&path)?.ok_or_else(|| PageError::Missing(folder.to_owned()))?;
        let (results, about) = read_whole(&text).map_err(|e| PageError::Damaged { path, reason: e.to_string() })?;
        let path = folder.join(JOURNAL);
        let rounds = journalled(folder).map_err(|source| unread(&path, source))?;
        // A run that was made shorter keeps the rounds that it does not count any more.
        let counted = |rounds: Vec<Round>| rounds.into_iter().filter(|r| r.record.round < results.rounds).collect();
        let rounds = rounds.map(counted);
        let stage = Stage::read(folder)?;
        Ok(Self { folder: folder.to_owned(), results, about, rounds, stage })
    }
}

fn unread(path: &Path, source: io::Error) -> PageError {
    let path = path.to_owned();
    match source.kind() {
        io::ErrorKind::InvalidData => PageError::Damaged { path, reason: source.to_string() },
        _ => PageError::Io { action: "read", path, source },
    }
}

/// A file's text; `None` if there is no such file.
fn read_text(path: &Path) -> Result<Option<String>, PageError> {
    match fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(source) => Err(unread(path, source)),
    }
}

/// One or several experiments as a page. The same folders give the same bytes.
///
/// # Errors
/// [`PageError`].
pub fn page(all: &[Played]) -> Result<String, PageError> {
    let names = names(all);
    let mut sections = vec![rates(all, &names)?];
    if all.len() > 1 {
        sections.push(side_by_side(all, &names));
    }
    for (one, name) in all.iter().zip(&names) {
        let own = sections::of(one);
        if all.len() > 1 { sections.push(sections::folded(name, own)) } else { sections.extend(own) }
    }
    let [single] = all else {
        let attempts: u64 = all.iter().map(|one| one.results.attempts).sum();
        let lead = format!("{} experiments, {} grasps executed in physics.", all.len(), grouped(attempts));
        return Ok(whole(
            "Experiments side by side".to_owned(),
            lead,
            Vec::new(),
            warnings::warnings(all, &names),
            sections,
        ));
    };
    let results = &single.results;
    let lead = format!(
        "{} rounds: a table of objects is seen, planned on and grasped from until nothing is left or it is no use. {} grasps were executed \
         in physics.",
        grouped(results.rounds),
        grouped(results.attempts)
    );
    let title = format!("Experiment: {}", results.protocol);
    Ok(whole(title, lead, sections::tiles(results), warnings::warnings(all, &names), sections))
}

fn whole(
    title: String,
    lead: String,
    tiles: Vec<(String, String)>,
    warnings: Vec<String>,
    sections: Vec<Section>,
) -> String {
    let footer = format!("experiments report, Graspmill {}", env!("CARGO_PKG_VERSION"));
    Page { title, lead, tiles, warnings, sections, footer }.html()
}

/// What experiments are called: by their protocols; where two have the same, by their folders too.
fn names(all: &[Played]) -> Vec<String> {
    let name = |one: &Played| {
        let protocol = &one.results.protocol;
        if all.iter().filter(|other| other.results.protocol == *protocol).count() > 1 {
            format!("{protocol} ({})", one.folder.display())
        } else {
            protocol.clone()
        }
    };
    all.iter().map(name).collect()
}

fn rates(all: &[Played], names: &[String]) -> Result<Section, FigureError> {
    let row = |name: String, rates: &crate::statistics::Rates| Row {
        name,
        success_rate: rates.success_rate,
        cleared_share: rates.cleared_share,
    };
    let mut rows: Vec<Row> = all.iter().zip(names).map(|(one, name)| row(name.clone(), &one.results.rates)).collect();
    let mut pictures = vec![Picture {
        svg: svg_for_page(&rows)?,
        title: "Grasp success rate (GSR) and share of objects cleared".to_owned(),
        caption: "Disc: attempts that held, of all attempts. Ring: objects removed, of those at the beginning."
            .to_owned(),
    }];
    if let [one] = all {
        for (title, groups) in [("By scene", &one.results.by_group), ("By seed", &one.results.by_seed)] {
            if groups.len() > 1 {
                rows = groups.iter().map(|group| row(group.name.clone(), &group.rates)).collect();
                pictures.push(Picture {
                    svg: svg_for_page(&rows)?,
                    title: title.to_owned(),
                    caption: "The same of parts of the rounds; their intervals are wider, for they are fewer."
                        .to_owned(),
                });
            }
        }
    }
    Ok(Section {
        title: "Rates".to_owned(),
        text: format!(
            "Lines are 95 % intervals by bootstrap over whole rounds ({DRAWS} draws), for grasps of one round fail together. Where two \
             lines do not overlap, the difference is hardly chance."
        ),
        blocks: vec![Block::Figures(pictures), Block::Table(sections::headline(all, names))],
    })
}

fn side_by_side(all: &[Played], names: &[String]) -> Section {
    let rate = |at: usize| format!("{}, {}", names[at], share(all[at].results.rates.success_rate));
    let rates: Vec<_> = all.iter().map(|one| one.results.rates.success_rate).collect();
    let apart = comparison_of_rates(&rates);
    let mut blocks: Vec<Block> =
        apart.iter().map(|(high, low)| Block::Text(format!("{} is above {}.", rate(*high), rate(*low)))).collect();
    if blocks.is_empty() {
        blocks.push(Block::Text("No GSR interval is above another.".to_owned()));
    }
    blocks.extend(sections::by_scene_side_by_side(all, names));
    blocks.extend(differences::blocks(all, names));
    Section {
        title: "Side by side".to_owned(),
        text: "Which success rates are apart, and what was different: a rate without its protocol is a rumour."
            .to_owned(),
        blocks,
    }
}
