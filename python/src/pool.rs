//! The threads that share work. They are this module's own and not the process's: threads do not outlive a fork, as of
//! PyTorch's workers, so a child makes new ones.

use std::collections::BTreeMap;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};

use program::{Failure, thread_pool};
use rayon::ThreadPool;

/// Pools by process and number of threads.
static POOLS: Mutex<BTreeMap<(u32, usize), Arc<ThreadPool>>> = Mutex::new(BTreeMap::new());

/// Runs work on so many threads; 0 for one per core. More than cores would change nothing.
pub(crate) fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T, Failure> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let key = (process::id(), if threads == 0 { cores } else { threads.min(cores) });
    let pools = || POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let found = pools().get(&key).map(Arc::clone);
    let pool = match found {
        Some(pool) => pool,
        // Made without the lock, which a fork at that moment would leave locked in the child.
        None => {
            let made = Arc::new(thread_pool(key.1)?);
            Arc::clone(pools().entry(key).or_insert(made))
        }
    };
    Ok(pool.install(work))
}
