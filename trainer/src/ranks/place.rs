//! Which rank a process is: by flags, or by the variables of torchrun, Slurm or Open MPI.

/// Where rank 0 listens if nobody says: this machine, at torchrun's port.
const ADDRESS: &str = "127.0.0.1";
const PORT: &str = "29500";
/// Most ranks.
const RANKS_MAX: usize = 1024;

/// A process among those that train together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Its number, from 0.
    pub rank: usize,
    /// How many there are.
    pub ranks: usize,
    /// Where rank 0 listens, `host:port`.
    pub address: String,
    /// Longest wait for another rank, in seconds.
    pub timeout_s: u64,
}

/// What the command line says of it.
#[derive(Debug, Clone, Default)]
pub struct Flags {
    /// `auto`, or how many ranks there are.
    pub ranks: Option<String>,
    /// Which one this is.
    pub rank: Option<usize>,
    /// Where rank 0 listens, `host:port`.
    pub master: Option<String>,
    /// Longest wait for another rank, in seconds.
    pub timeout_s: u64,
}

/// Why a process does not know its place.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("{0}")]
pub struct PlaceError(String);

/// A launcher and its variables: rank, and number of ranks.
const LAUNCHERS: [(&str, &str, &str); 3] = [
    ("torchrun", "RANK", "WORLD_SIZE"),
    ("Slurm", "SLURM_PROCID", "SLURM_NTASKS"),
    ("Open MPI", "OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"),
];

impl Place {
    /// The place that flags and variables give; `None` without `--ranks`: a process alone, whatever the variables say (in
    /// a Slurm job they are there even for a single program).
    ///
    /// # Errors
    /// [`PlaceError`] if something is missing, or two launchers say different things. Flags overrule variables.
    pub fn find(flags: &Flags, variable: &dyn Fn(&str) -> Option<String>) -> Result<Option<Self>, PlaceError> {
        let error = |text: String| Err(PlaceError(text));
        let (rank, ranks) = match (flags.ranks.as_deref(), flags.rank) {
            (None, None) => return Ok(None),
            (None, Some(_)) => return error("--rank needs --ranks".to_owned()),
            (Some("auto"), Some(_)) => return error("--ranks auto takes no --rank".to_owned()),
            (Some("auto"), None) => launched(variable)?,
            (Some(ranks), rank) => match (ranks.parse(), rank) {
                (Ok(ranks), Some(rank)) => (rank, ranks),
                (Ok(_), None) => return error(format!("--ranks {ranks} needs --rank")),
                (Err(_), _) => return error(format!("--ranks must be auto or a number, got {ranks:?}")),
            },
        };
        if !(1..=RANKS_MAX).contains(&ranks) {
            return error(format!("the number of ranks must be between 1 and {RANKS_MAX}, got {ranks}"));
        }
        if rank >= ranks {
            return error(format!("the rank must be below the number of ranks, {ranks}, got {rank}"));
        }
        let address = flags.master.clone().unwrap_or_else(|| {
            let part = |name, default: &str| variable(name).unwrap_or_else(|| default.to_owned());
            let port = part("MASTER_PORT", PORT);
            // torchrun says so when it listens at that port itself; the next one is then ours.
            let is_taken = variable("TORCHELASTIC_USE_AGENT_STORE").is_some_and(|value| value == "True");
            let next = port.parse::<u16>().ok().and_then(|port| port.checked_add(1)).filter(|_| is_taken);
            format!("{}:{}", part("MASTER_ADDR", ADDRESS), next.map_or(port, |port| port.to_string()))
        });
        Ok(Some(Self { rank, ranks, address, timeout_s: flags.timeout_s.max(1) }))
    }
}

/// Rank and number of ranks, from variables.
fn launched(variable: &dyn Fn(&str) -> Option<String>) -> Result<(usize, usize), PlaceError> {
    let mut found: Option<(&str, (usize, usize))> = None;
    for (launcher, rank_name, ranks_name) in LAUNCHERS {
        let number = |name: &str| -> Result<usize, PlaceError> {
            let text = variable(name).ok_or_else(|| PlaceError(format!("{launcher}'s {name} is not set")))?;
            text.parse().map_err(|_| PlaceError(format!("{launcher}'s {name} must be a number, got {text:?}")))
        };
        if variable(rank_name).is_none() && variable(ranks_name).is_none() {
            continue;
        }
        let place = (number(rank_name)?, number(ranks_name)?);
        match found {
            Some((other, before)) if before != place => {
                let text = |(rank, ranks): (usize, usize)| format!("rank {rank} of {ranks}");
                return Err(PlaceError(format!(
                    "{other} says {}, {launcher} says {}: give --rank and --ranks",
                    text(before),
                    text(place)
                )));
            }
            Some(_) => {}
            None => found = Some((launcher, place)),
        }
    }
    found.map(|(_, place)| place).ok_or_else(|| {
        let names: Vec<String> = LAUNCHERS.map(|(launcher, rank, _)| format!("{rank} ({launcher})")).into();
        PlaceError(format!("--ranks auto finds none of {}", names.join(", ")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(flags: [Option<&str>; 3], variables: &[(&str, &str)]) -> Result<Option<Place>, String> {
        let [ranks, rank, master] = flags.map(|flag| flag.map(str::to_owned));
        let flags = Flags { ranks, rank: rank.map(|rank| rank.parse().unwrap()), master, timeout_s: 7 };
        let value = |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned());
        Place::find(&flags, &value).map_err(|error| error.to_string())
    }

    fn place(rank: usize, ranks: usize, address: &str) -> Result<Option<Place>, String> {
        Ok(Some(Place { rank, ranks, address: address.to_owned(), timeout_s: 7 }))
    }

    const AUTO: [Option<&str>; 3] = [Some("auto"), None, None];
    const TORCHRUN: [(&str, &str); 4] =
        [("RANK", "1"), ("WORLD_SIZE", "4"), ("MASTER_ADDR", "node7"), ("MASTER_PORT", "1234")];

    #[test]
    fn flags_overrule_and_launchers_are_known() {
        let loopback = "127.0.0.1:29500";
        assert_eq!(find([None, None, None], &TORCHRUN), Ok(None));
        assert_eq!(find(AUTO, &TORCHRUN), place(1, 4, "node7:1234"));
        let agent = [&TORCHRUN[..], &[("TORCHELASTIC_USE_AGENT_STORE", "True")]].concat();
        assert_eq!(find(AUTO, &agent), place(1, 4, "node7:1235"));
        assert_eq!(find([Some("2"), Some("0"), Some("here:9")], &TORCHRUN), place(0, 2, "here:9"));
        assert_eq!(find([Some("auto"), None, Some("here:9")], &TORCHRUN), place(1, 4, "here:9"));
        assert_eq!(find(AUTO, &[("SLURM_PROCID", "3"), ("SLURM_NTASKS", "8")]), place(3, 8, loopback));
        let mpi = [("OMPI_COMM_WORLD_RANK", "0"), ("OMPI_COMM_WORLD_SIZE", "2")];
        assert_eq!(find(AUTO, &mpi), place(0, 2, loopback));
        let both = [&mpi[..], &[("SLURM_PROCID", "0"), ("SLURM_NTASKS", "2")]].concat();
        assert_eq!(find(AUTO, &both), place(0, 2, loopback));
    }

    #[test]
    fn contradictions_and_gaps_are_told() {
        for (flags, variables, message) in [
            (AUTO, &[][..], "finds none of RANK (torchrun)"),
            (AUTO, &[("RANK", "0")], "torchrun's WORLD_SIZE is not set"),
            (AUTO, &[("RANK", "x"), ("WORLD_SIZE", "2")], "must be a number, got \"x\""),
            (AUTO, &[("RANK", "2"), ("WORLD_SIZE", "2")], "below the number of ranks, 2, got 2"),
            (
                AUTO,
                &[("RANK", "1"), ("WORLD_SIZE", "4"), ("SLURM_PROCID", "0"), ("SLURM_NTASKS", "1")],
                "torchrun says rank 1 of 4, Slurm says rank 0 of 1: give --rank and --ranks",
            ),
            ([Some("99999999999"), Some("0"), None], &[], "must be between 1 and 1024, got 99999999999"),
            ([Some("2"), None, None], &[], "--ranks 2 needs --rank"),
            ([None, Some("0"), None], &[], "--rank needs --ranks"),
            ([Some("auto"), Some("0"), None], &[], "takes no --rank"),
            ([Some("two"), Some("0"), None], &[], "auto or a number, got \"two\""),
        ] {
            let error = find(flags, variables).unwrap_err();
            assert!(error.contains(message), "{message:?} is not in {error:?}");
        }
    }
}
