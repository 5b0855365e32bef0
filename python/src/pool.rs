//! The threads that share work. They are this module's own and not the process's: threads do not outlive a fork, as of
//! PyTorch's workers, so a child makes new ones.

use std::collections::BTreeMap;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};

use program::{Failure, thread_pool};
use rayon::ThreadPool;

/// Pools by process and number of threads.
static POOLS: Mutex<BTreeMap<(u32, usize), Arc<ThreadPool>>> = Mutex::new(BTreeMap::new());

/// Runs work on so many threads; 0 for one per core.
pub(crate) fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T, Failure> {
    let threads = if threads == 0 { std::thread::available_parallelism().map_or(1, usize::from) } else { threads };
    let pool = {
        let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
        match pools.get(&(process::id(), threads)) {
            Some(pool) => Arc::clone(pool),
            None => {
                let pool = Arc::new(thread_pool(threads)?);
                pools.insert((process::id(), threads), Arc::clone(&pool));
                pool
            }
        }
    };
    Ok(pool.install(work))
}
