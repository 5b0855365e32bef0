//! The grippers of a dataset: one, or several that take turns from scene to scene.

use settings::{Reader, Setting, Value, settings};

use crate::{Gripper, Purpose, Stream};

/// Maximum number of grippers of a dataset.
pub const GRIPPERS_MAX: usize = 4096;

/// One gripper, or several, each of which has every n-th scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Grippers(
    /// Never empty; the names differ.
    Vec<Gripper>,
);

settings! {
    /// Grippers that are drawn: the opening log-uniform in its range, all else uniform.
    #[derive(Debug, Clone, PartialEq)]
    pub struct RandomGrippers {
        /// How many.
        pub count: usize where 2..=GRIPPERS_MAX,
        /// Seed of the draw; the dataset's own seed does not change the grippers.
        pub seed: u64; or 1,
        /// Distance between the fingers' inner faces when open.
        pub opening_m_max: [f32; 2] where 0.005..=0.5,
        /// Finger length along z.
        pub finger_length_m: [f32; 2] where 0.005..=0.5,
        /// Finger width along x.
        pub finger_width_m: [f32; 2] where 0.001..=0.2,
        /// Finger thickness along y.
        pub finger_thickness_m: [f32; 2] where 0.001..=0.1,
        /// Palm length along z.
        pub palm_length_m: [f32; 2] where 0.001..=0.5,
        /// Palm width along x.
        pub palm_width_m: [f32; 2] where 0.001..=0.5,
        /// Palm breadth along y; at least the opening.
        pub palm_breadth_m: [f32; 2] where 0.001..=0.5,
        /// Mass of a finger.
        pub finger_mass_kg: [f32; 2] where 0.005..=5.0,
        /// Closing force of a finger.
        pub finger_force_n: [f32; 2] where 0.1..=500.0,
        /// The time in which a gripper closes without an object; the speed follows.
        pub closing_time_s: [f32; 2] where 0.01..=10.0,
        /// Friction coefficient of the fingers and palm.
        pub friction: [f32; 2] where 0.0..=5.0,
        /// The approaching gripper collides with what comes nearer than this.
        pub clearance_m: [f32; 2] where 0.0..=0.02,
    }
}

impl RandomGrippers {
    /// The name of the built-in ranges, and their file.
    const BUILT_IN: (&'static str, &'static str) =
        ("any_jaw", include_str!("../../configs/grippers/ranges/any_jaw.toml"));

    /// The text of ranges that a setting names, if it does: built-in, or a file with the key `count`.
    fn text<'v>(value: &'v Value, reader: &Reader<'_>) -> Option<(&'v str, String)> {
        let name = value.as_str()?;
        if name == Self::BUILT_IN.0 {
            return Some((name, Self::BUILT_IN.1.to_owned()));
        }
        let text = name.ends_with(".toml").then(|| reader.text_of(name).ok())??;
        let has_count = text.lines().any(|line| line.trim_start().starts_with("count"));
        has_count.then_some((name, text))
    }

    /// The grippers, named `hand_0000` and so on.
    fn draw(&self) -> Vec<Gripper> {
        let gripper = |number: usize| {
            let mut stream = Stream::new(self.seed, number as u64, Purpose::Grippers, 0);
            // A gripper that opens 40 mm differs more from one of 50 than one of 140 from one of 150.
            let opening_m_max = stream.log_uniform(self.opening_m_max);
            let mut within = |[low, high]: [f32; 2]| stream.uniform(low, high);
            Gripper {
                name: format!("hand_{number:04}"),
                opening_m_max,
                finger_length_m: within(self.finger_length_m),
                finger_width_m: within(self.finger_width_m),
                finger_thickness_m: within(self.finger_thickness_m),
                palm_length_m: within(self.palm_length_m),
                palm_width_m: within(self.palm_width_m),
                palm_breadth_m: within(self.palm_breadth_m).max(opening_m_max),
                finger_mass_kg: within(self.finger_mass_kg),
                finger_force_n: within(self.finger_force_n),
                closing_speed_m_s: 0.5 * opening_m_max / within(self.closing_time_s),
                friction: within(self.friction),
                clearance_m: within(self.clearance_m),
                finger_tip: None,
                jaws: Vec::new(),
                flange_from_grasp: None,
                joint: None,
            }
        };
        (0..self.count).map(gripper).collect()
    }
}

/// Read from the name or the path of a gripper, a list of them, or a table of ranges, each number drawn from its own.
impl Setting for Grippers {
    type Limits = ();

    fn kind((): &()) -> String {
        "a gripper's name, a path that ends in .toml, or any_jaw; a list of names and paths; a table of a gripper's file; or a table of ranges"
            .to_owned()
    }

    fn read(value: &Value, (): &(), reader: &mut Reader<'_>) -> Option<Self> {
        let grippers = match value {
            Value::Table(table) if table.contains_key("name") => vec![Gripper::read(value, &(), reader)?],
            Value::Table(_) => RandomGrippers::read(value, &(), reader)?.draw(),
            Value::Array(values) => {
                let read: Vec<_> = values.iter().map(|value| Gripper::read_named(value, &(), reader)).collect();
                read.into_iter().collect::<Option<_>>()?
            }
            _ => match RandomGrippers::text(value, reader) {
                Some((name, text)) => reader.in_file::<RandomGrippers>(name, &text)?.draw(),
                None => vec![Gripper::read_named(value, &(), reader)?],
            },
        };
        let problem = Self::problem(&grippers);
        if let Some(problem) = &problem {
            reader.fault(problem);
        }
        problem.is_none().then_some(Self(grippers))
    }
}

impl Grippers {
    /// Why these cannot be the grippers of a dataset.
    #[must_use]
    pub fn problem(grippers: &[Gripper]) -> Option<String> {
        if !(1..=GRIPPERS_MAX).contains(&grippers.len()) {
            return Some(format!("must be between 1 and {GRIPPERS_MAX} grippers, got {}", grippers.len()));
        }
        let mut names: Vec<&str> = grippers.iter().map(|gripper| gripper.name.as_str()).collect();
        names.sort_unstable();
        let twice = names.windows(2).find(|pair| pair[0] == pair[1])?;
        Some(format!("must be grippers of different names, got two of {}", twice[0]))
    }

    /// All of them.
    #[must_use]
    pub fn all(&self) -> &[Gripper] {
        &self.0
    }

    /// The gripper of a scene.
    #[must_use]
    pub fn of_scene(&self, scene_id: u64) -> &Gripper {
        gripper_of(&self.0, scene_id)
    }

    /// The gripper, if there is only one.
    #[must_use]
    pub fn only(&self) -> Option<&Gripper> {
        if let [gripper] = self.all() { Some(gripper) } else { None }
    }
}

impl From<Gripper> for Grippers {
    fn from(gripper: Gripper) -> Self {
        Self(vec![gripper])
    }
}

/// The gripper of a scene: grippers take turns.
///
/// # Panics
/// Without a gripper.
#[must_use]
pub fn gripper_of(grippers: &[Gripper], scene_id: u64) -> &Gripper {
    &grippers[(scene_id % grippers.len() as u64) as usize]
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use settings::Document;

    use super::*;

    settings! {
        struct Held {
            gripper: Grippers,
        }
    }

    fn read(text: &str) -> Result<Grippers, settings::Error> {
        Document::parse(text, Path::new("test.toml")).unwrap().read::<Held>().map(|held| held.gripper)
    }

    const RANGES: &str = "gripper = { count = 300, opening_m_max = [0.05, 0.14], finger_length_m = [0.03, 0.08], \
        finger_width_m = [0.01, 0.03], finger_thickness_m = [0.005, 0.02], palm_length_m = [0.03, 0.1], \
        palm_width_m = [0.02, 0.08], palm_breadth_m = [0.06, 0.22], finger_mass_kg = [0.03, 0.2], \
        finger_force_n = [10.0, 40.0], closing_time_s = [0.7, 0.95], friction = [0.6, 1.0], \
        clearance_m = [0.001, 0.001] }";

    #[test]
    fn one_gripper_a_list_and_ranges() {
        let one = read("gripper = \"wsg_50\"").unwrap();
        assert_eq!(one.only().unwrap().name, "wsg_50");
        let (_, file) = Gripper::BUILT_IN.iter().find(|(name, _)| *name == "wsg_50").unwrap();
        assert_eq!(read(&format!("[gripper]\n{file}")).unwrap(), one, "what a file has may stand in its place");
        let two = read("gripper = [\"wsg_50\", \"franka_hand\"]").unwrap();
        assert_eq!([0, 1, 2].map(|scene| two.of_scene(scene).name.as_str()), ["wsg_50", "franka_hand", "wsg_50"]);
        assert!(two.only().is_none());
        let drawn = read(RANGES).unwrap();
        assert_eq!((drawn.all().len(), &drawn), (300, &read(RANGES).unwrap()));
        let openings: Vec<f32> = drawn.all().iter().map(|gripper| gripper.opening_m_max).collect();
        let mean = openings.iter().sum::<f32>() / 300.0;
        assert!(openings.iter().all(|opening| (0.05..=0.14).contains(opening)) && (mean - 0.0874).abs() < 0.005);
        for gripper in drawn.all() {
            let closing_time_s = 0.5 * gripper.opening_m_max / gripper.closing_speed_m_s;
            assert!((0.6999..=0.9501).contains(&closing_time_s), "{gripper:?}");
            assert!(gripper.palm_breadth_m >= gripper.opening_m_max);
            assert!(settings::faults_of(gripper, "").is_empty());
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let told = |text: &str| read(text).unwrap_err().to_string();
        assert!(told("gripper = []").contains("gripper must be between 1 and 4096 grippers, got 0"));
        let twice = told("gripper = [\"wsg_50\", \"wsg_50\"]");
        assert!(twice.contains("gripper must be grippers of different names, got two of wsg_50"), "{twice}");
        let ranges = told(&RANGES.replace("[0.05, 0.14]", "[0.14, 0.05]").replace("count = 300, ", ""));
        for part in ["gripper.count is missing", "gripper.opening_m_max must be a range [low, high]"] {
            assert!(ranges.contains(part), "{ranges}");
        }
        assert!(told("gripper = 3").contains("gripper must be a text"));
    }
}
