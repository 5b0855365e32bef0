//! From a hand to a judge's weights: the steps that the programs beside this one take, and what is written about them.
//!
//! For a hand that the judge of many hands answers for, one round of "plan, execute, train" (docs/judge.md): the
//! dataset has some of that judge's choices, and training goes on from its weights. For others two rounds: the second
//! dataset has some choices of the judge that learned from the first. Every step can be repeated at any time, because
//! each program goes on where it was stopped; so a recipe needs no state of its own.

use std::path::{Path, PathBuf};
use std::time::Duration;

use network::checkpoint::{self, Checkpoint};
use program::{Context, ExitCode, Failure, read};
use report::document::{Block, Cell, Document as Page, Table as PageTable};
use schema::{Grid, Gripper, Hands};
use settings::{Document, settings, words};
use shards::Dataset;
use toml::{Table, Value};

use crate::config::JUDGE;

/// The parts that a recipe changes.
const GENERATE: [&str; 2] = [include_str!("../../configs/generate/judge.toml"), "configs/generate/judge.toml"];
const PLAN: [&str; 2] = [include_str!("../../configs/plan/judge.toml"), "configs/plan/judge.toml"];
/// The experiments of a recipe.
const EXPERIMENTS: [(&str, &str); 3] = [
    ("pile", include_str!("../../configs/experiment/pile.toml")),
    ("packed", include_str!("../../configs/experiment/packed.toml")),
    ("giga-pile", include_str!("../../configs/experiment/giga-pile.toml")),
];

/// The judge of many hands, and its path in the source tree.
pub const MANY_HANDS: (&[u8], &str) =
    (include_bytes!("../../models/judge-any-jaw.safetensors"), "models/judge-any-jaw.safetensors");

/// The test set, and the generator's settings for it and for experiments with the objects besides the primitives.
const TEST: &str = "test";
const TRIED: &str = "tried-objects.toml";

/// Share of the attempts in the first of two rounds.
const FIRST_SHARE: f64 = 1.0 / 3.0;
/// Epochs of the first round; it need not be trained to the end.
const FIRST_EPOCHS: u32 = 6;
/// Household objects to learn from: thirty of each kind. Of the kinds that are held out there are as many.
const HOUSEHOLD_COUNT: i64 = 540;
/// Epochs of the judge, which learns from all rounds.
const EPOCHS: u32 = 10;
/// Attempts of the test set.
const TEST_ATTEMPTS: u64 = 60_000;
/// Largest report of a step, in bytes.
const REPORT_BYTES_MAX: u64 = 64 << 20;
/// Attempts of a scene in the generator's settings, and shards of a dataset, if it has so many scenes.
const ATTEMPTS_PER_SCENE: u64 = 60;
const SHARDS_MAX: u64 = 64;
/// In experiments lies what the hand can span, and so it does in three quarters of a round's scenes with choices. Of
/// objects of all sizes, a hand that opens 40 mm holds a quarter as many as one of 100.
const VIABLE: &str = "objects.viable_only=true";
const SPANNED: &str = "spanned_share=0.75";
/// Attempts from whose recipe the time is estimated.
const PILOT_ATTEMPTS: u64 = 6_000;
/// Rounds of an experiment, on a seed that nothing is tuned on, and the time that one takes.
const ROUNDS: u32 = 100;
const ROUND: Duration = Duration::from_millis(600);

words! {
    /// From where scenes are seen.
    pub enum Seen {
        /// From everywhere, by one to six cameras: `configs/generate/judge.toml`.
        Anywhere = "anywhere",
        /// By one camera from the side.
        Side = "side",
        /// By one camera from above.
        Above = "above",
        /// By one camera at the wrist.
        Wrist = "wrist",
        /// By three to six cameras around.
        Ring = "ring",
    }
}

settings! {
    struct Held {
        gripper: Hands,
    }
}

/// What is wanted.
#[derive(Debug)]
pub struct Recipe {
    /// A hand's name, or the absolute path of its file.
    pub hand: String,
    /// The folder of all results.
    pub out: PathBuf,
    /// Seed of the first dataset; those of the others and of the experiments follow it.
    pub seed: u64,
    /// Attempts of all rounds.
    pub attempts: u64,
    /// Weights of a judge that answers for the hand, by their absolute path: there is one round with its choices, and
    /// training goes on from them. Without them there are two rounds, and training begins with random weights.
    pub from: Option<PathBuf>,
    /// Where the cameras are.
    pub seen: Seen,
    /// Objects to which half of the attempts go.
    pub objects: Option<Things>,
}

/// Objects besides the four primitive shapes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Things {
    /// Household objects of the kinds to learn from; tried with those of the kinds that are held out.
    Household,
    /// A catalogue, by its absolute path; tried with its own objects.
    File(PathBuf),
}

impl Things {
    /// `objects.catalogue` of the generator's settings, to learn from or to be tried with.
    fn catalogue(&self, split: &str) -> Value {
        match self {
            Self::File(path) => Value::String(path.display().to_string()),
            Self::Household => Value::Table(Table::from_iter([
                ("split".to_owned(), Value::String(split.to_owned())),
                ("count".to_owned(), Value::Integer(HOUSEHOLD_COUNT)),
                ("seed".to_owned(), Value::Integer(1)),
            ])),
        }
    }
}

/// A command of one of the programs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// What it does.
    pub what: String,
    /// The program.
    pub program: &'static str,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// A file that is there when it is done.
    pub done: PathBuf,
}

impl Recipe {
    /// The weights.
    #[must_use]
    pub fn weights(&self) -> PathBuf {
        self.out.join("judge/best.safetensors")
    }

    /// The hands on which experiments are run: the hand itself, or all built-in ones if it is a file of ranges.
    ///
    /// # Errors
    /// If there is no such hand.
    pub fn tried_hands(&self) -> Result<Vec<String>, Failure> {
        let one = || vec![self.hand.clone()];
        let hands = hands(&self.hand)?;
        Ok(hands.only().map_or_else(|| Gripper::BUILT_IN.map(|(name, _)| name.to_owned()).to_vec(), |_| one()))
    }

    /// The names and texts of the settings that the steps use.
    ///
    /// # Errors
    /// If the hand's file cannot be read.
    pub fn settings(&self) -> Result<Vec<(String, String)>, Failure> {
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
        for hand in self.tried_hands()? {
            let mut plan = Document::parse(PLAN[0], Path::new(PLAN[1]))?;
            plan.table_mut().insert("gripper".to_owned(), Value::String(hand.clone()));
            files.push((format!("plan-{}.toml", short(&hand)), plan.table().to_string()));
        }
        Ok(files)
    }

    /// The generator's settings, with objects of a catalogue or with primitives.
    fn generate(&self, catalogue: Option<Value>) -> Result<Table, Failure> {
        let mut document = Document::parse(GENERATE[0], Path::new(GENERATE[1]))?;
        let table = document.table_mut();
        table.insert("gripper".to_owned(), Value::String(self.hand.clone()));
        if let Some(kind) = self.seen.view_kind(table) {
            table.insert("view_kinds".to_owned(), Value::Array(vec![Value::Table(kind)]));
        }
        if let Some(catalogue) = catalogue {
            table.remove("packed");
            let own = ["counts", "count_weights", "drop_height_m"];
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
    /// If there is no such hand.
    pub fn steps(&self) -> Result<Vec<Step>, Failure> {
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
        steps.extend(self.parts(TEST, 0).into_iter().map(|(name, ..)| {
            let report = self.at(&format!("{name}-report"));
            Step {
                what: format!("evaluate on {name}"),
                program: "trainer",
                arguments: [
                    "evaluate",
                    "--run",
                    &self.at("judge"),
                    "--data",
                    &self.at(&name),
                    "--split",
                    "all",
                    "--report",
                    &report,
                ]
                .map(str::to_owned)
                .to_vec(),
                done: Path::new(&report).join("evaluation.json"),
            }
        }));
        for hand in self.tried_hands()? {
            let plan = format!("plan={}", self.at(&format!("plan-{}.toml", short(&hand))));
            let step = |name: &str, of: &str, set: Option<String>| {
                let out = self.at(&format!("{name}-{}", short(&hand)));
                let (seed, rounds) = ((self.seed + 3).to_string(), ROUNDS.to_string());
                let (model, config) = (format!("model={}", self.weights().display()), self.at(&format!("{of}.toml")));
                let fixed = ["run", &config, "--out", &out, "--seed", &seed, "--rounds", &rounds];
                let set = [plan.clone(), model, VIABLE.to_owned()].into_iter().chain(set);
                let mut arguments: Vec<String> = fixed.map(str::to_owned).to_vec();
                arguments.extend(set.flat_map(|setting| ["--set".to_owned(), setting]));
                let what = format!("{ROUNDS} rounds of {name} with {}", short(&hand));
                Step { what, program: "experiments", arguments, done: Path::new(&out).join("report.json") }
            };
            steps.extend(EXPERIMENTS.map(|(name, _)| step(name, name, None)));
            let scene = format!("scene={}", self.at(TRIED));
            steps.extend(self.objects.iter().map(|_| step("pile-objects", "pile", Some(scene.clone()))));
        }
        Ok(steps)
    }

    /// The same recipe with few attempts, up to the judge, from whose times [`Self::time`] estimates the whole.
    ///
    /// # Errors
    /// If there is no such hand.
    pub fn pilot(&self, folder: &Path) -> Result<(Self, Vec<Step>), Failure> {
        let pilot = Self {
            hand: self.hand.clone(),
            out: folder.to_owned(),
            attempts: PILOT_ATTEMPTS,
            objects: self.objects.clone(),
            from: self.from.clone(),
            ..*self
        };
        let mut steps = pilot.steps()?;
        let judge = pilot.weights();
        steps.truncate(1 + steps.iter().position(|step| step.done == judge).unwrap_or(0));
        Ok((pilot, steps))
    }

    /// How long all steps take if the pilot's took this long.
    #[must_use]
    pub fn time(&self, pilot: &[Duration]) -> Duration {
        let times = |share: f64, part: &[Duration]| part.iter().sum::<Duration>().mul_f64(share);
        // The test set is drawn as the first round, without a judge's choices: where that has some, this is too much.
        let first = &pilot[..self.parts(TEST, 0).len().min(pilot.len())];
        let hands = self.tried_hands().map_or(1, |hands| hands.len());
        let tried = EXPERIMENTS.len() + usize::from(self.objects.is_some());
        times(self.attempts as f64 / PILOT_ATTEMPTS as f64, pilot)
            + times(
                TEST_ATTEMPTS as f64 * self.attempts as f64 / (self.first_attempts() * PILOT_ATTEMPTS) as f64,
                first,
            )
            + ROUND * (hands * tried) as u32 * ROUNDS
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
            let shards = (attempts / ATTEMPTS_PER_SCENE).clamp(1, SHARDS_MAX).to_string();
            let (attempts, seed, config, out) =
                (attempts.to_string(), seed.to_string(), self.at(config), self.at(&name));
            let fixed =
                ["--config", &config, "--attempts", &attempts, "--shards", &shards, "--seed", &seed, "--out", &out];
            let mut arguments: Vec<String> = fixed.map(str::to_owned).to_vec();
            let second =
                |policy: &Path| ["--policy", &policy.display().to_string(), "--set", SPANNED].map(str::to_owned);
            arguments.extend(policy.into_iter().flat_map(second));
            let done = Path::new(&out).join("_SUCCESS");
            Step { what: format!("execute {attempts} attempts, {name}"), program: "generator", arguments, done }
        };
        self.parts(name, attempts).into_iter().map(step).collect()
    }

    fn trained(&self, run: &str, rounds: &[&str], epochs: u32) -> Step {
        let (config, epochs, out) = (self.at("train.toml"), epochs.to_string(), self.at(run));
        let fixed = ["fit", "--resume", "--config", &config, "--epochs", &epochs, "--run", &out];
        let mut arguments: Vec<String> = fixed.map(str::to_owned).to_vec();
        let parts = rounds.iter().flat_map(|round| self.parts(round, 0));
        let names: Vec<String> = parts.map(|(name, ..)| name).collect();
        arguments.extend(names.iter().flat_map(|name| ["--data".to_owned(), self.at(name)]));
        let from = self.from.iter().map(|from| from.display().to_string());
        arguments.extend(from.flat_map(|from| ["--from".to_owned(), from]));
        let done = Path::new(&out).join("best.safetensors");
        Step { what: format!("train {epochs} epochs on {}", names.join(", ")), program: "trainer", arguments, done }
    }

    fn at(&self, name: &str) -> String {
        self.out.join(name).display().to_string()
    }
}

impl Seen {
    /// The kind of views in the generator's settings, for all scenes; none for all kinds.
    fn view_kind(self, table: &Table) -> Option<Table> {
        let number = match self {
            Self::Anywhere => return None,
            Self::Side => 0,
            Self::Above => 1,
            Self::Wrist => 2,
            Self::Ring => 4,
        };
        let mut kind = table.get("view_kinds")?.as_array()?.get(number)?.as_table()?.clone();
        kind.insert("share".to_owned(), Value::Float(1.0));
        Some(kind)
    }
}

/// The hands of a name or a file.
fn hands(hand: &str) -> Result<Hands, Failure> {
    let text = Table::from_iter([("gripper".to_owned(), Value::String(hand.to_owned()))]).to_string();
    let Held { gripper } = Document::parse(&text, Path::new("HAND"))?.read()?;
    Ok(gripper)
}

/// Whether the built-in judge of many hands answers for a hand. For several hands it is a peer, not a beginning.
///
/// # Errors
/// If there is no such hand.
pub fn is_known(hand: &str) -> Result<bool, Failure> {
    let judge = checkpoint::from_bytes(MANY_HANDS.0, Path::new(MANY_HANDS.1))?;
    Ok(hands(hand)?.only().is_some() && must_answer_for(&judge, hand).is_ok())
}

/// Whether a judge answers for a hand, or for all of a file of ranges.
///
/// # Errors
/// If it does not, these are another network's weights, or there is no such hand.
pub fn must_answer_for(weights: &Checkpoint, hand: &str) -> Result<(), Failure> {
    let scope = weights.architecture.scope("a recipe")?;
    hands(hand)?.all().iter().try_for_each(|hand| scope.must_match(hand, &Grid::PAPER))
}

/// A hand's name, also of a file.
fn short(hand: &str) -> String {
    Path::new(hand).file_stem().map_or_else(|| hand.to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// The card of the weights: what they learned from, and how they fare.
///
/// # Errors
/// If a result of a step cannot be read.
pub fn card(recipe: &Recipe, steps: &[Step]) -> Result<String, Failure> {
    let row = |key: &str, value: String| vec![Cell::from(key), Cell::from(value)];
    let digest = checkpoint::read_digested(&recipe.weights())?.1;
    let mut rows = vec![
        row("hand", recipe.hand.clone()),
        row("seen from", recipe.seen.name().to_owned()),
        row("SHA-256 of judge.safetensors", digest),
    ];
    for step in steps.iter().filter(|step| step.program == "generator") {
        let folder = step.done.parent().unwrap_or(&recipe.out);
        let dataset = Dataset::open(folder)?;
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        rows.push(row(&name, format!("{} attempts, {}", dataset.info().attempt_count, dataset.id())));
    }
    let mut scores = PageTable::new(["set", "accuracy", "average precision", "calibration error"], []);
    let mut rounds = PageTable::new(["experiment", "grasps that held", "cleared"], []);
    for step in steps {
        let name = step.done.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
        let number = |value: &serde_json::Value| value.as_f64().map_or("–".to_owned(), |value| format!("{value:.3}"));
        if step.done.ends_with("evaluation.json") {
            let found = &json_of(&step.done)?["hands"]["table_free"];
            let values = [&found["all"]["accuracy"], &found["average_precision"], &found["calibration_error"]];
            scores.rows.push([name].into_iter().chain(values.map(number)).map(Cell::from).collect());
        } else if step.program == "experiments" {
            let rates = json_of(&step.done)?["results"]["rates"].clone();
            let rate = |key: &str| {
                let [value, low, high] = ["value", "low", "high"].map(|part| rates[key][part].as_f64());
                let shown =
                    |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{:.1}", 100.0 * value));
                format!("{} % ({} to {})", shown(value), shown(low), shown(high))
            };
            rounds.rows.push([name, rate("success_rate"), rate("cleared_share")].map(Cell::from).to_vec());
        }
    }
    let commands = steps.iter().map(|step| format!("{} {}\n", step.program, step.arguments.join(" ")));
    let blocks = vec![
        Block::Text("Weights of a judge: they say of a hand in a scene how the attempt would end.".to_owned()),
        Block::Table(PageTable::new(["", ""], rows)),
        Block::Heading("On attempts that it never saw".to_owned()),
        Block::Text("Of hands that do not hit the table; 1,000 scenes of another seed.".to_owned()),
        Block::Table(scores),
        Block::Heading("In simulated rounds".to_owned()),
        Block::Text(format!("{ROUNDS} rounds each, with 95 % intervals by bootstrap over rounds.")),
        Block::Table(rounds),
        Block::Heading("Made by".to_owned()),
        Block::Code("bash", commands.collect()),
    ];
    Ok(Page { title: "A judge of hands".to_owned(), blocks, ..Page::default() }.markdown())
}

fn json_of(path: &Path) -> Result<serde_json::Value, Failure> {
    let text = read(path, REPORT_BYTES_MAX).context(format_args!("failed to read {}", path.display()))?;
    serde_json::from_slice(&text)
        .map_err(|e| Failure::new(ExitCode::Data, format!("damaged results: {e}: {}", path.display())))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    fn recipe(hand: &str, objects: Option<Things>, seen: Seen) -> Recipe {
        Recipe {
            hand: hand.to_owned(),
            out: PathBuf::from("/out"),
            seed: 7,
            attempts: 90_000,
            from: None,
            seen,
            objects,
        }
    }

    fn file(recipe: &Recipe, name: &str) -> Table {
        let files = recipe.settings().unwrap();
        files.into_iter().find(|(file, _)| file == name).unwrap().1.parse().unwrap()
    }

    #[test]
    fn a_recipe_is_two_rounds_a_test_and_experiments() {
        let steps = recipe("wsg_50", None, Seen::Anywhere).steps().unwrap();
        let told: Vec<(&str, &str)> = steps.iter().map(|step| (step.program, step.arguments[0].as_str())).collect();
        let expected = [
            ("generator", "--config"),
            ("trainer", "fit"),
            ("generator", "--config"),
            ("trainer", "fit"),
            ("generator", "--config"),
            ("trainer", "evaluate"),
            ("experiments", "run"),
            ("experiments", "run"),
            ("experiments", "run"),
        ];
        assert_eq!(told, expected);
        let of = |step: usize, key: &str| {
            let at = steps[step].arguments.iter().position(|part| part == key)?;
            steps[step].arguments.get(at + 1).cloned()
        };
        let attempts = [0, 2, 4].map(|step| of(step, "--attempts").unwrap().parse::<u64>().unwrap());
        assert_eq!(attempts, [30_000, 60_000, 60_000]);
        let seeds: BTreeMap<_, _> = [0, 2, 4, 6].map(|step| (of(step, "--seed").unwrap(), step)).into();
        assert_eq!(seeds.len(), 4, "every dataset and the experiments have seeds of their own");
        assert_eq!(of(2, "--policy").unwrap(), "/out/first/best.safetensors");
        assert_eq!(of(0, "--policy"), None);
        assert_eq!([0, 2, 4].map(|step| of(step, "--set")), [None, Some(SPANNED.to_owned()), None]);
        assert_eq!(steps[3].arguments.iter().filter(|part| *part == "--data").count(), 2);
    }

    #[test]
    fn from_the_judge_of_many_hands_there_is_one_round_with_its_choices() {
        assert!(is_known("wsg_50").unwrap());
        assert!(!is_known("any_jaw").unwrap(), "for several hands it is a peer");
        let from = PathBuf::from("/out/from.safetensors");
        let recipe = Recipe { from: Some(from.clone()), ..recipe("wsg_50", None, Seen::Anywhere) };
        let steps = recipe.steps().unwrap();
        let told: Vec<&str> = steps.iter().map(|step| step.program).collect();
        let tried = ["experiments"; 3];
        assert_eq!(told, [["generator", "trainer", "generator", "trainer"].as_slice(), &tried].concat());
        let has = |step: usize, pair: [&str; 2]| steps[step].arguments.windows(2).any(|window| window == pair);
        assert!(has(0, ["--attempts", "90000"]) && has(0, ["--policy", "/out/from.safetensors"]));
        assert!(has(0, ["--set", SPANNED]) && has(1, ["--from", "/out/from.safetensors"]));
        assert!(!steps[2].arguments.contains(&"--policy".to_owned()), "the test set has no judge's choices");
        // 15 times a pilot of 20 s, 10 times its first step, and 3 experiments of a minute.
        let (pilot, steps) = recipe.pilot(Path::new("/pilot")).unwrap();
        assert_eq!((steps.len(), pilot.from), (2, Some(from)));
        assert_eq!(recipe.time(&[Duration::from_secs(10); 2]).as_secs(), 15 * 20 + 10 * 10 + 3 * 60);
    }

    #[test]
    fn weights_to_begin_with_answer_for_the_hand() {
        let judge = checkpoint::from_bytes(MANY_HANDS.0, Path::new(MANY_HANDS.1)).unwrap();
        assert!(must_answer_for(&judge, "robotiq_hand_e").is_ok());
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("wide.toml");
        let text = Gripper::BUILT_IN[0].1.replace("opening_m_max = 0.08", "opening_m_max = 0.2");
        std::fs::write(&file, text).unwrap();
        let hand = file.display().to_string();
        let refused = must_answer_for(&judge, &hand).unwrap_err().to_string();
        assert!(refused.contains("opening_m_max must be"), "{refused}");
        assert!(!is_known(&hand).unwrap());
        let paper = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/paper-200k.safetensors");
        let refused = must_answer_for(&checkpoint::read(Path::new(paper)).unwrap(), "wsg_50").unwrap_err().to_string();
        assert!(refused.contains("which answers for voxels"), "{refused}");
    }

    #[test]
    fn a_judge_of_many_hands_is_tried_with_each_built_in_one() {
        let recipe = recipe("any_jaw", None, Seen::Anywhere);
        assert_eq!(recipe.tried_hands().unwrap().len(), Gripper::BUILT_IN.len());
        assert_eq!(recipe.steps().unwrap().len(), 6 + 3 * Gripper::BUILT_IN.len());
        assert_eq!(file(&recipe, "plan-wsg_50.toml")["gripper"].as_str(), Some("wsg_50"));
        // 15 times a pilot of 40 s, 30 times its first step, and 21 experiments of a minute.
        let (_, steps) = recipe.pilot(Path::new("/pilot")).unwrap();
        let spent = [Duration::from_secs(10); 4];
        assert_eq!(steps.len(), spent.len());
        assert_eq!(recipe.time(&spent).as_secs(), 15 * 40 + 30 * 10 + 21 * 60);
    }

    #[test]
    fn views_and_objects_are_those_asked_for() {
        let recipe = recipe("wsg_50", Some(Things::File(PathBuf::from("/things.toml"))), Seen::Side);
        let [plain, things] = ["generate.toml", "generate-objects.toml"].map(|name| file(&recipe, name));
        for generate in [&plain, &things] {
            let kinds = generate["view_kinds"].as_array().unwrap();
            assert_eq!(
                (kinds.len(), kinds[0]["share"].as_float(), kinds[0]["counts"].to_string()),
                (1, Some(1.0), "[1, 1]".to_owned())
            );
            let shares = generate["shares"].as_table().unwrap().values().filter_map(Value::as_float);
            assert!((shares.sum::<f64>() - 1.0).abs() < 1e-9);
        }
        assert!(plain.contains_key("packed") && !things.contains_key("packed"));
        assert_eq!(things["objects"]["catalogue"].as_str(), Some("/things.toml"));
        assert!(things["objects"].get("size_m").is_none());
        assert_eq!(things["shares"]["rules"].as_float(), Some(0.0));
        assert_eq!(recipe.steps().unwrap().iter().filter(|step| step.program == "generator").count(), 6);
        let household = Recipe { objects: Some(Things::Household), ..recipe };
        let split = |name: &str| file(&household, name)["objects"]["catalogue"]["split"].as_str().map(str::to_owned);
        assert_eq!(split("generate-objects.toml").as_deref(), Some("train"));
        assert_eq!(split("tried-objects.toml").as_deref(), Some("held-out"));
        let steps = household.steps().unwrap();
        assert_eq!(steps.last().unwrap().arguments.last().unwrap(), "scene=/out/tried-objects.toml");
        assert_eq!(steps.iter().filter(|step| step.program == "experiments").count(), 4);
        let recipe = household;
        let wrong = Recipe { hand: "three_fingers".to_owned(), ..recipe };
        assert!(wrong.steps().unwrap_err().to_string().contains("three_fingers"));
    }
}
