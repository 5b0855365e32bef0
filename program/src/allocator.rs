//! The allocator of every program.
#![expect(unsafe_code, reason = "an allocator implements an unsafe trait; it passes its arguments on as they are")]

use std::alloc::{GlobalAlloc, Layout};
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use mimalloc::MiMalloc;

use crate::ExitCode;

/// mimalloc, and in a program an end where memory ends.
///
/// Every attempt builds and drops a world, every training step and every plan frees volumes of megabytes. The system's
/// allocator returns them to the kernel and takes them again: with mimalloc, two threads make 3 to 12 % more attempts,
/// and a training step of eight scenes takes 75 ms instead of 150 ms.
///
/// The standard library's handler of a failed allocation allocates for its backtrace, fails again, and then waits for
/// its own lock for ever. So a program ends here instead, with [`ExitCode::TryAgain`] and one line. What was committed
/// is safe, as after a kill. A process that only calls the library, such as a Python interpreter, is not ours to end:
/// it gets the null pointer, which `try_reserve` reports.
struct Allocator;

/// Whether this process is a program of ours.
static IS_PROGRAM: AtomicBool = AtomicBool::new(false);

/// From now on the process ends where memory ends.
pub(crate) fn end_where_memory_ends() {
    IS_PROGRAM.store(true, Ordering::Relaxed);
}

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

// SAFETY: all four functions are mimalloc's, with the same arguments.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the trait's contract.
        or_exit(unsafe { MiMalloc.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        or_exit(unsafe { MiMalloc.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: as above.
        or_exit(unsafe { MiMalloc.realloc(pointer, layout, new_size) }, new_size)
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { MiMalloc.dealloc(pointer, layout) }
    }
}

#[inline]
fn or_exit(pointer: *mut u8, size: usize) -> *mut u8 {
    if pointer.is_null() && IS_PROGRAM.load(Ordering::Relaxed) {
        out_of_memory(size);
    }
    pointer
}

#[cold]
fn out_of_memory(size: usize) -> ! {
    // Neither the line nor the exit allocates.
    let _ = writeln!(io::stderr(), "error: out of memory: {size} bytes could not be allocated");
    signal_hook::low_level::exit(ExitCode::TryAgain as i32)
}
