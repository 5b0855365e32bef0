//! From a gripper to a judge's weights: the steps, and what is written about them.
//!
//! For a gripper that the judge of many grippers answers for, one round of "plan, execute, train" (docs/judge.md): the
//! dataset has some of that judge's choices, and training goes on from its weights. For others two rounds: the second
//! dataset has some choices of the judge that learned from the first. Every step can be repeated at any time, because
//! each program goes on where it was stopped; so a pipeline needs no state of its own.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use network::checkpoint::{self, Checkpoint};
use program::{Failure, command_line};
use schema::{Grid, Gripper, Grippers};
use settings::{Document, settings};
use toml::{Table, Value};
use trainer::config::JUDGE;

/// The settings that a pipeline changes.
const GENERATE: [&str; 2] = [include_str!("../../../configs/generate/judge.toml"), "configs/generate/judge.toml"];
const PLAN: [&str; 2] = [include_str!("../../../configs/plan/judge.toml"), "configs/plan/judge.toml"];
/// The experiments of a pipeline.
const EXPERIMENTS: [(&str, &str); 4] = [
    ("pile", include_str!("../../../configs/experiment/pile.toml")),
    ("packed", include_str!("../../../configs/experiment/packed.toml")),
    ("giga-pile", include_str!("../../../configs/experiment/giga-pile.toml")),
    ("bin", include_str!("../../../configs/experiment/bin.toml")),
];

/// The judge of many grippers, and its path in the source tree.
pub(crate) const MANY_GRIPPERS: (&[u8], &str) =
    (include_bytes!("../../../models/judge-any-jaw.safetensors"), "models/judge-any-jaw.safetensors");

/// The test set, and the generator's settings for it and for experiments with the objects besides the primitives.
const TEST: &str = "test";
const TRIED: &str = "tried-objects.toml";

/// Share of the attempts in the first of two rounds.
const FIRST_SHARE: f64 = 1.0 / 3.0;
/// Epochs of the first round; it need not be trained to the end.
const FIRST_EPOCHS: u32 = 6;
/// Epochs of the judge, which learns from all rounds.
const EPOCHS: u32 = 10;
/// Attempts of the test set.
const TEST_ATTEMPTS: u64 = 60_000;
/// Attempts of a scene in the generator's settings, and shards of a dataset, if it has so many scenes.
const ATTEMPTS_PER_SCENE: u64 = 120;
const SHARDS_MAX: u64 = 64;
/// In three quarters of a round's scenes with choices lies what the gripper can span. Of objects of all sizes, a
/// gripper that opens 40 mm holds a quarter as many as one of 100.
const SPANNED: &str = "spanned_share=0.75";
/// In experiments lies what the gripper can span.
const VIABLE: &str = "objects.viable_only=true";
/// Rounds of an experiment, on a seed that nothing is tuned on.
const ROUNDS: u32 = 100;

settings! {
    struct Held {
        gripper: Grippers,
    }
}

/// Flags of a command with their values.
type Flags = Vec<(&'static str, OsString)>;

/// One step, which can be repeated at any time: it goes on where it was stopped.
#[derive(Debug)]
pub(crate) struct Step {
    /// What it does.
    pub(crate) what: String,
    /// The folder of its results.
    pub(crate) out: PathBuf,
    /// The words of its command.
    pub(crate) words: Vec<OsString>,
}

impl Step {
    fn new(what: String, out: PathBuf, command: &str, flags: Flags) -> Self {
        let flags = flags.into_iter().flat_map(|(flag, value)| [flag.into(), value]);
        Self { what, out, words: ["graspmill".into(), command.into()].into_iter().chain(flags).collect() }
    }

    /// Whether it is one of this command.
    pub(crate) fn is(&self, command: &str) -> bool {
        self.words[1] == command
    }

    /// Its command as a person would type it.
    pub(crate) fn command(&self) -> String {
        command_line(&self.words)
    }
}

/// What is wanted.
#[derive(Debug)]
pub(crate) struct Pipeline {
    /// A gripper's name, or the absolute path of its file.
    pub(crate) gripper: String,
    /// The folder of all results.
    pub(crate) out: PathBuf,
    /// Seed of the first dataset; those of the others and of the experiments follow it.
    pub(crate) seed: u64,
    /// Attempts of all rounds.
    pub(crate) attempts: u64,
    /// Weights of a judge that answers for the gripper, by their absolute path: there is one round with its choices,
    /// and training goes on from them. Without them there are two rounds, and training begins with random weights.
    pub(crate) from: Option<PathBuf>,
    /// Objects to which half of the attempts go.
    pub(crate) objects: Option<Objects>,
}

/// Objects besides the four primitive shapes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Objects {
    /// Household objects of the kinds to learn from; tried with those of the kinds that are held out.
    Household,
    /// A catalogue, by its absolute path; tried with its own objects.
    File(PathBuf),
}

impl Objects {
    /// `objects.catalogue` of the generator's settings, to learn from or to be tried with.
    fn catalogue(&self, split: &str) -> Value {
        Value::String(match self {
            Self::File(path) => path.display().to_string(),
            Self::Household => format!("household-{split}"),
        })
    }
}

impl Pipeline {
    /// The weights.
    #[must_use]
    pub(crate) fn weights(&self) -> PathBuf {
        self.out.join("judge/best.safetensors")
    }

    /// The grippers with which experiments are run: the gripper itself, or all built-in ones if it is a file of ranges.
    ///
    /// # Errors
    /// If there is no such gripper.
    pub(crate) fn tried_grippers(&self) -> Result<Vec<String>, Failure> {
        let one = || vec![self.gripper.clone()];
        let grippers = grippers(&self.gripper)?;
        Ok(grippers.only().map_or_else(|| Gripper::BUILT_IN.map(|(name, _)| name.to_owned()).to_vec(), |_| one()))
    }

    /// The names and texts of the settings that the steps use.
    ///
    /// # Errors
    /// If the gripper's file cannot be read.
    pub(crate) fn settings(&self) -> Result<Vec<(String, String)>, Failure> {
        let mut files = vec![
            ("generate.toml".to_owned(), self.generate(None)?.to_string()),
            ("train.toml".to_owned(), JUDGE.to_owned()),
        ];
        if let Some(objects) = &self.objects {
            let generate = |split| self.generate(Some(objects.catalogue(split))).map(|table| table.to_string());
            files.push(("generate-objects.toml".to_owned(), generate("train")?));
            files.push((TRIED.to_owned(), generate("held-out")?));
        }
        files.extend(EXPERIMENTS.map(|(name, text)| (format!("{name}.toml"), text.to_owned())));
        for gripper in self.tried_grippers()? {
            let mut plan = Document::parse(PLAN[0], Path::new(PLAN[1]))?;
            plan.table_mut().insert("gripper".to_owned(), Value::String(gripper.clone()));
            files.push((format!("plan-{}.toml", short(&gripper)), plan.table().to_string()));
        }
        Ok(files)
    }

    /// The generator's settings, with objects of a catalogue or with primitives.
    fn generate(&self, catalogue: Option<Value>) -> Result<Table, Failure> {
        let mut document = Document::parse(GENERATE[0], Path::new(GENERATE[1]))?;
        let table = document.table_mut();
        table.insert("gripper".to_owned(), Value::String(self.gripper.clone()));
        if let Some(catalogue) = catalogue {
            // A catalogue of somebody may have nothing of these sizes.
            if self.objects != Some(Objects::Household) {
                table.remove("packed");
            }
            let own = ["counts", "count_weights", "drop_height_m", "room_m"];
            if let Some(Value::Table(objects)) = table.get_mut("objects") {
                objects.retain(|key, _| own.contains(&key));
                objects.insert("catalogue".to_owned(), catalogue);
            }
            // The rules are those of primitives.
            let share = |name: &str| table["shares"][name].as_float().unwrap_or_default();
            let proposals = share("proposals") + share("rules");
            if let Some(Value::Table(shares)) = table.get_mut("shares") {
                shares.insert("rules".to_owned(), Value::Float(0.0));
                shares.insert("proposals".to_owned(), Value::Float(proposals));
            }
        }
        Ok(document.table().clone())
    }

    /// The steps, in their order.
    ///
    /// # Errors
    /// If there is no such gripper.
    pub(crate) fn steps(&self) -> Result<Vec<Step>, Failure> {
        let first = self.first_attempts();
        let mut steps = self.generated("round-1", first, self.seed, self.from.as_deref());
        if self.from.is_some() {
            steps.push(self.trained("judge", &["round-1"], EPOCHS));
        } else {
            steps.push(self.trained("first", &["round-1"], FIRST_EPOCHS));
            let policy = self.out.join("first/best.safetensors");
            steps.extend(self.generated("round-2", self.attempts - first, self.seed + 1, Some(&policy)));
            steps.push(self.trained("judge", &["round-1", "round-2"], EPOCHS));
        }
        steps.extend(self.generated(TEST, TEST_ATTEMPTS, self.seed + 2, None));
        for (name, ..) in self.parts(TEST, 0) {
            let report = self.at(&format!("{name}-report"));
            let flags = vec![
                ("--run", self.at("judge").into()),
                ("--data", self.at(&name).into()),
                ("--split", "all".into()),
                ("--report", report.clone().into()),
            ];
            steps.push(Step::new(format!("evaluate on {name}"), report, "evaluate", flags));
        }
        let objects_too = self.objects.iter().map(|_| "pile-objects");
        for gripper in self.tried_grippers()?.iter().map(|gripper| short(gripper)) {
            for name in EXPERIMENTS.map(|(name, _)| name).into_iter().chain(objects_too.clone()) {
                let set = |key: &str, path: PathBuf| ("--set", format!("{key}={}", path.display()).into());
                let (file, out) = (name.trim_end_matches("-objects"), self.at(&format!("{name}-{gripper}")));
                let mut flags: Flags = vec![
                    ("run", self.at(&format!("{file}.toml")).into()),
                    ("--out", out.clone().into()),
                    ("--seed", (self.seed + 3).to_string().into()),
                    ("--rounds", ROUNDS.to_string().into()),
                    set("plan", self.at(&format!("plan-{gripper}.toml"))),
                    set("model", self.weights()),
                    ("--set", VIABLE.into()),
                ];
                flags.extend((file != name).then(|| set("scene", self.at(TRIED))));
                steps.push(Step::new(format!("{ROUNDS} rounds of {name} with {gripper}"), out, "experiment", flags));
            }
        }
        Ok(steps)
    }

    /// Attempts of the first round, which is the only one if there are weights to begin with.
    fn first_attempts(&self) -> u64 {
        if self.from.is_some() { self.attempts } else { (self.attempts as f64 * FIRST_SHARE).round() as u64 }
    }

    /// The datasets of a name, with their settings and attempts: one of primitives, and one of the catalogue's objects.
    fn parts(&self, name: &str, attempts: u64) -> Vec<(String, &'static str, u64)> {
        match self.objects {
            None => vec![(name.to_owned(), "generate.toml", attempts)],
            Some(_) => {
                let objects = if name == TEST { TRIED } else { "generate-objects.toml" };
                vec![
                    (name.to_owned(), "generate.toml", attempts - attempts / 2),
                    (format!("{name}-objects"), objects, attempts / 2),
                ]
            }
        }
    }

    fn generated(&self, name: &str, attempts: u64, seed: u64, policy: Option<&Path>) -> Vec<Step> {
        let step = |(name, config, attempts): (String, &str, u64)| {
            let (shards, out) = ((attempts / ATTEMPTS_PER_SCENE).clamp(1, SHARDS_MAX), self.at(&name));
            let mut flags: Flags = vec![
                ("--config", self.at(config).into()),
                ("--attempts", attempts.to_string().into()),
                ("--shards", shards.to_string().into()),
                // All of them, also as a task of a scheduler.
                ("--task", "0/1".into()),
                ("--seed", seed.to_string().into()),
                ("--out", out.clone().into()),
            ];
            if let Some(policy) = policy {
                flags.extend([("--policy", policy.into()), ("--set", SPANNED.into())]);
            }
            Step::new(format!("execute {attempts} attempts, {name}"), out, "generate", flags)
        };
        self.parts(name, attempts).into_iter().map(step).collect()
    }

    fn trained(&self, run: &str, rounds: &[&str], epochs: u32) -> Step {
        let parts = rounds.iter().flat_map(|round| self.parts(round, 0));
        let names: Vec<String> = parts.map(|(name, ..)| name).collect();
        let mut flags: Flags = vec![
            ("--config", self.at("train.toml").into()),
            ("--epochs", epochs.to_string().into()),
            ("--run", self.at(run).into()),
        ];
        flags.extend(names.iter().map(|name| ("--data", self.at(name).into())));
        flags.extend(self.from.iter().map(|from| ("--from", from.into())));
        let mut step = Step::new(format!("train {epochs} epochs on {}", names.join(", ")), self.at(run), "fit", flags);
        step.words.push("--resume".into());
        step
    }

    fn at(&self, name: &str) -> PathBuf {
        self.out.join(name)
    }
}

/// The grippers of a name or a file.
fn grippers(named: &str) -> Result<Grippers, Failure> {
    let text = Table::from_iter([("gripper".to_owned(), Value::String(named.to_owned()))]).to_string();
    let Held { gripper } = Document::parse(&text, Path::new("GRIPPER"))?.read()?;
    Ok(gripper)
}

/// Whether the built-in judge of many grippers answers for a gripper. For several grippers it is a peer, not a
/// beginning.
///
/// # Errors
/// If there is no such gripper.
pub(crate) fn is_known(gripper: &str) -> Result<bool, Failure> {
    let judge = checkpoint::from_bytes(MANY_GRIPPERS.0, Path::new(MANY_GRIPPERS.1))?;
    Ok(grippers(gripper)?.only().is_some() && must_answer_for(&judge, gripper).is_ok())
}

/// Whether a judge answers for a gripper, or for all of a file of ranges.
///
/// # Errors
/// If it does not, these are another network's weights, or there is no such gripper.
pub(crate) fn must_answer_for(weights: &Checkpoint, gripper: &str) -> Result<(), Failure> {
    let scope = weights.architecture.scope("a pipeline")?;
    grippers(gripper)?.all().iter().try_for_each(|gripper| scope.must_match(gripper, &Grid::PAPER))
}

/// A gripper's name, also of a file.
fn short(gripper: &str) -> String {
    Path::new(gripper).file_stem().map_or_else(|| gripper.to_owned(), |stem| stem.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::Parser;

    use super::*;
    use crate::Graspmill;

    fn pipeline(gripper: &str, objects: Option<Objects>) -> Pipeline {
        Pipeline {
            gripper: gripper.to_owned(),
            out: PathBuf::from("/out"),
            seed: 7,
            attempts: 90_000,
            from: None,
            objects,
        }
    }

    fn file(pipeline: &Pipeline, name: &str) -> Table {
        let files = pipeline.settings().unwrap();
        files.into_iter().find(|(file, _)| file == name).unwrap().1.parse().unwrap()
    }

    #[test]
    fn a_pipeline_is_two_rounds_a_test_and_experiments() {
        let steps = pipeline("wsg_50", None).steps().unwrap();
        assert_eq!(
            kinds(&steps),
            [&["generate", "fit", "generate", "fit", "generate", "evaluate"][..], &["experiment"; 4]].concat()
        );
        let datasets = [0, 2, 4].map(|at| ["--attempts", "--seed", "--policy"].map(|flag| value(&steps[at], flag)));
        let policy = Some("/out/first/best.safetensors");
        let expected =
            [[Some("30000"), Some("7"), None], [Some("60000"), Some("8"), policy], [Some("60000"), Some("9"), None]];
        assert_eq!(datasets, expected);
        let experiments = steps.iter().filter(|step| step.is("experiment"));
        let seeds: BTreeSet<_> = experiments.map(|step| value(step, "--seed")).collect();
        assert_eq!(Vec::from_iter(seeds), [Some("10")], "every dataset and the experiments have seeds of their own");
        let judge = &steps[3];
        assert_eq!((judge.words.iter().filter(|word| *word == "--data").count(), value(judge, "--from")), (2, None));
    }

    #[test]
    fn steps_are_commands_of_this_program() {
        let objects = Objects::File(PathBuf::from("/my things.toml"));
        for step in pipeline("wsg_50", Some(objects)).steps().unwrap() {
            if let Err(error) = Graspmill::try_parse_from(&step.words) {
                panic!("{}: {error}", step.command());
            }
        }
    }

    fn kinds(steps: &[Step]) -> Vec<&str> {
        steps.iter().map(|step| step.words[1].to_str().unwrap()).collect()
    }

    fn value<'a>(step: &'a Step, flag: &str) -> Option<&'a str> {
        let at = step.words.iter().position(|word| word == flag)?;
        step.words[at + 1].to_str()
    }

    #[test]
    fn from_the_judge_of_many_grippers_there_is_one_round_with_its_choices() {
        assert!(is_known("wsg_50").unwrap());
        assert!(!is_known("any_jaw").unwrap(), "for several grippers it is a peer");
        let from = PathBuf::from("/out/from.safetensors");
        let pipeline = Pipeline { from: Some(from.clone()), ..pipeline("wsg_50", None) };
        let steps = pipeline.steps().unwrap();
        assert_eq!(kinds(&steps), [&["generate", "fit", "generate", "evaluate"][..], &["experiment"; 4]].concat());
        let first = steps[0].command();
        assert!(first.contains("--attempts 90000") && first.contains("--set spanned_share=0.75"), "{first}");
        assert!(first.contains("--policy /out/from.safetensors"), "{first}");
        assert_eq!(value(&steps[1], "--from"), from.to_str());
        assert_eq!(value(&steps[2], "--policy"), None, "the test set has no judge's choices");
    }

    #[test]
    fn weights_to_begin_with_answer_for_the_gripper() {
        let judge = checkpoint::from_bytes(MANY_GRIPPERS.0, Path::new(MANY_GRIPPERS.1)).unwrap();
        assert!(must_answer_for(&judge, "robotiq_hand_e").is_ok());
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("wide.toml");
        let text = Gripper::BUILT_IN[0].1.replace("opening_m_max = 0.08", "opening_m_max = 0.2");
        std::fs::write(&file, text).unwrap();
        let gripper = file.display().to_string();
        let refused = must_answer_for(&judge, &gripper).unwrap_err().to_string();
        assert!(refused.contains("opening_m_max must be"), "{refused}");
        assert!(!is_known(&gripper).unwrap());
        let paper = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/paper-200k.safetensors");
        let refused = must_answer_for(&checkpoint::read(Path::new(paper)).unwrap(), "wsg_50").unwrap_err().to_string();
        assert!(refused.contains("which answers for voxels"), "{refused}");
    }

    #[test]
    fn a_judge_of_many_grippers_is_tried_with_each_built_in_one() {
        let pipeline = pipeline("any_jaw", None);
        assert_eq!(pipeline.tried_grippers().unwrap().len(), Gripper::BUILT_IN.len());
        assert_eq!(pipeline.steps().unwrap().len(), 6 + 4 * Gripper::BUILT_IN.len());
        assert_eq!(file(&pipeline, "plan-wsg_50.toml")["gripper"].as_str(), Some("wsg_50"));
    }

    #[test]
    fn objects_are_those_asked_for() {
        let pipeline = pipeline("wsg_50", Some(Objects::File(PathBuf::from("/things.toml"))));
        let [plain, things] = ["generate.toml", "generate-objects.toml"].map(|name| file(&pipeline, name));
        for generate in [&plain, &things] {
            let shares = generate["shares"].as_table().unwrap().values().filter_map(Value::as_float);
            assert!((shares.sum::<f64>() - 1.0).abs() < 1e-9);
        }
        assert!(plain.contains_key("packed") && !things.contains_key("packed"));
        assert_eq!(things["objects"]["catalogue"].as_str(), Some("/things.toml"));
        assert!(things["objects"].get("size_m").is_none());
        assert_eq!(things["shares"]["rules"].as_float(), Some(0.0));
        assert_eq!(kinds(&pipeline.steps().unwrap()).iter().filter(|kind| **kind == "generate").count(), 6);
        let household = Pipeline { objects: Some(Objects::Household), ..pipeline };
        assert!(file(&household, "generate-objects.toml").contains_key("packed"));
        let split = |name: &str| file(&household, name)["objects"]["catalogue"].as_str().map(str::to_owned);
        assert_eq!(split("generate-objects.toml").as_deref(), Some("household-train"));
        assert_eq!(split("tried-objects.toml").as_deref(), Some("household-held-out"));
        let steps = household.steps().unwrap();
        assert!(steps.last().unwrap().command().ends_with("--set scene=/out/tried-objects.toml"));
        assert_eq!(kinds(&steps).iter().filter(|kind| **kind == "experiment").count(), 5);
        let pipeline = household;
        let wrong = Pipeline { gripper: "three_fingers".to_owned(), ..pipeline };
        assert!(wrong.steps().unwrap_err().to_string().contains("three_fingers"));
    }
}
