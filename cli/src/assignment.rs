//! Selects the shards of this process from its options or from the scheduler's environment. Schedulers give only an
//! index; the number of shards is a property of the dataset and not read from the environment.

use std::collections::BTreeSet;
use std::ffi::OsString;

use program::{ExitCode, Failure};
use shards::SHARDS_MAX;

/// Variables that hold the index of a task: our own, Slurm's arrays, Kubernetes' Indexed Jobs, AWS Batch's arrays.
const VARIABLES: [&str; 4] =
    ["SHARD_INDEX", "SLURM_ARRAY_TASK_ID", "JOB_COMPLETION_INDEX", "AWS_BATCH_JOB_ARRAY_INDEX"];

/// The shards of this process, in order, of a dataset of so many, and the variable that names them, if one does: those
/// of the flags, otherwise of the first variable that is there, otherwise all.
pub(crate) fn assigned(
    indices: Option<&BTreeSet<u32>>,
    task: Option<Task>,
    environment: impl Fn(&str) -> Option<OsString>,
    shard_count: u32,
) -> Result<(Vec<u32>, Option<&'static str>), Failure> {
    let refused = |text: String| Failure::new(ExitCode::Config, text);
    let (indices, variable) = match (indices, task) {
        (_, Some([task, tasks])) => return Ok(((task..shard_count).step_by(tasks as usize).collect(), None)),
        (Some(indices), None) => (indices.clone(), None),
        (None, None) => {
            let Some((name, value)) = VARIABLES.into_iter().find_map(|name| Some((name, environment(name)?))) else {
                return Ok(((0..shard_count).collect(), None));
            };
            let value = value.to_string_lossy();
            let what = format!("{name} must be a shard index, got {value:?}; --shard-index or --task takes precedence");
            (shard_indices(&value).map_err(|_| refused(what))?, Some(name))
        }
    };
    if let Some(index) = indices.last().filter(|index| **index >= shard_count) {
        let source = variable.unwrap_or("--shard-index");
        let text = format!("shard index must be below the number of shards, {shard_count}, got {index} from {source}");
        return Err(refused(text));
    }
    Ok((indices.into_iter().collect(), variable))
}

/// Shard indices from text such as `0,4,8-11`.
pub(crate) fn shard_indices(text: &str) -> Result<BTreeSet<u32>, String> {
    let number = |part: &str| part.trim().parse::<u32>().map_err(|_| format!("`{part}` is no shard index"));
    let mut indices = BTreeSet::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last) = (number(first)?, number(last)?);
        if first > last {
            return Err(format!("the range `{part}` is empty"));
        }
        if last >= SHARDS_MAX {
            return Err(format!("a shard index must be below {SHARDS_MAX}, got {last}"));
        }
        indices.extend(first..=last);
    }
    Ok(indices)
}

/// Task `t` of `T`: the shards t, t + T, t + 2T, ...
pub(crate) type Task = [u32; 2];

/// A task from text such as `3/100`.
pub(crate) fn task(text: &str) -> Result<Task, String> {
    let parsed = text.split_once('/').and_then(|(task, tasks)| Some([task.parse().ok()?, tasks.parse().ok()?]));
    match parsed {
        Some([task, tasks]) if task < tasks => Ok([task, tasks]),
        Some([task, tasks]) => Err(format!("a task's number must be below the number of tasks, {tasks}, got {task}")),
        None => Err("must be a task's number and how many there are, such as 3/100".to_owned()),
    }
}

/// Indices as `--shard-index` and schedulers' arrays take them: `0-2,5`.
pub(crate) fn index_list(indices: &[u32]) -> String {
    let shown = |run: &[u32]| match run {
        [first, .., last] => format!("{first}-{last}"),
        run => run[0].to_string(),
    };
    indices.chunk_by(|a, b| a + 1 == *b).map(shown).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Vec<u32>, String> {
        shard_indices(text).map(|indices| indices.into_iter().collect())
    }

    fn assigned(flags: (Option<&str>, Option<&str>), variables: &[(&str, &str)]) -> Result<Vec<u32>, String> {
        let indices = flags.0.map(|text| shard_indices(text).unwrap());
        let task = flags.1.map(|text| task(text).unwrap());
        let variable = |name: &str| variables.iter().find(|v| v.0 == name).map(|v| OsString::from(v.1));
        super::assigned(indices.as_ref(), task, variable, 10).map(|(shards, _)| shards).map_err(|e| e.to_string())
    }

    #[test]
    fn indices_come_alone_in_lists_and_in_ranges() {
        assert_eq!(parse("3"), Ok(vec![3]));
        assert_eq!(parse("0,4, 8-10,9"), Ok(vec![0, 4, 8, 9, 10]));
        for bad in ["", "x", "3-1", "1,,2", "-1", "0-4294967295"] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn lists_of_indices_are_folded_into_ranges() {
        assert_eq!(index_list(&[0, 1, 2, 5, 7, 8]), "0-2,5,7-8");
        assert_eq!(index_list(&[]), "");
    }

    #[test]
    fn flags_go_before_the_environment_and_without_either_all_is_made() {
        let array = [("SLURM_ARRAY_TASK_ID", "4"), ("SLURM_ARRAY_TASK_COUNT", "2")];
        assert_eq!(assigned((None, None), &[]), Ok((0..10).collect()));
        assert_eq!(assigned((None, None), &array), Ok(vec![4]));
        assert_eq!(assigned((Some("1-2"), None), &array), Ok(vec![1, 2]));
        assert_eq!(assigned((None, Some("4/100")), &array), Ok(vec![4]));
        for name in VARIABLES {
            assert_eq!(assigned((None, None), &[(name, "9")]), Ok(vec![9]), "{name}");
        }
        assert_eq!(assigned((None, None), &[("JOB_COMPLETION_INDEX", "4"), ("SHARD_INDEX", "3")]), Ok(vec![3]));
    }

    #[test]
    fn tasks_share_the_shards_out() {
        let of = |task: &str| assigned((None, Some(task)), &[]).unwrap();
        assert_eq!(of("1/4"), [1, 5, 9]);
        let mut all: Vec<u32> = ["0/3", "1/3", "2/3"].into_iter().flat_map(of).collect();
        all.sort_unstable();
        assert_eq!(all, (0..10).collect::<Vec<_>>());
        assert!(of("11/12").is_empty());
        for bad in ["3", "3/3", "4/3", "-1/3", "0/0", "x/3", "1/"] {
            assert!(task(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn what_cannot_be_is_told_with_its_names() {
        let error = |variables: &[_]| assigned((None, None), variables).unwrap_err();
        for value in ["", "-1", "3.0", "all", "99999999999"] {
            let told = error(&[("SHARD_INDEX", value)]);
            assert!(told.starts_with("SHARD_INDEX must be a shard index") && told.contains(value), "{told}");
        }
        let told = error(&[("SLURM_ARRAY_TASK_ID", "10")]);
        assert_eq!(told, "shard index must be below the number of shards, 10, got 10 from SLURM_ARRAY_TASK_ID");
    }
}
