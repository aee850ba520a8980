//! The border that no panic crosses.
//!
//! A panic is a defect of the library, and unwinding into C is undefined: every entry runs in [`guarded`], which turns
//! it into a status. Nor does it print: the hook of the process is kept for all threads but those at work for an entry,
//! whose panics are kept for the message.

use crate::error::{Error, remember};
use crate::types::AhStatus;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, Once, PoisonError};

thread_local! {
    /// Whether this thread works for an entry at present.
    static AT_WORK: Cell<bool> = const { Cell::new(false) };
}

/// Where and why a thread at work panicked last.
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

static HOOK: Once = Once::new();

/// Runs an entry; a failure or a panic becomes a status and the words of the last error.
pub(crate) fn guarded(work: impl FnOnce() -> Result<(), Error>) -> AhStatus {
    guarded_or((), work).0
}

/// As [`guarded`], for entries that answer with a value: `fallback` where they fail.
pub(crate) fn guarded_or<T>(fallback: T, work: impl FnOnce() -> Result<T, Error>) -> (AhStatus, T) {
    install_hook();
    let before = AT_WORK.replace(true);
    // Handles that a panic left half changed are marked, and refused from then on.
    let result = catch_unwind(AssertUnwindSafe(work));
    AT_WORK.set(before);
    let error = match result {
        Ok(Ok(value)) => return (AhStatus::Ok, value),
        Ok(Err(error)) => error,
        Err(payload) => {
            let mut message = std::mem::take(&mut *LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner));
            if message.is_empty() {
                // The host has set a hook of its own since.
                let words = payload.downcast_ref::<&str>().copied().map(str::to_owned);
                let words = words.or_else(|| payload.downcast_ref::<String>().cloned());
                message = words.unwrap_or_else(|| "a panic without words".to_owned());
            }
            // A payload whose destructor panics in its turn must not get through either.
            std::mem::forget(payload);
            Error::Panicked { message }
        }
    };
    remember(&error);
    (error.status(), fallback)
}

/// Worker threads that belong to the library; zero for as many as the machine has cores.
pub(crate) fn workers(n_threads: usize) -> Result<rayon::ThreadPool, Error> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(n_threads)
        .thread_name(|k| format!("hair {k}"))
        .start_handler(|_| AT_WORK.set(true))
        .build()
        .map_err(Error::Threads)
}

fn install_hook() {
    HOOK.call_once(|| {
        let others = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if AT_WORK.try_with(Cell::get).unwrap_or(false) {
                *LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner) = info.to_string();
            } else {
                others(info);
            }
        }));
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::last_words as words;

    #[test]
    fn a_panic_becomes_a_status_with_its_words() {
        assert_eq!(guarded(|| panic!("a planted defect")), AhStatus::Panicked);
        assert!(words().contains("a planted defect"));
    }

    #[test]
    fn a_panic_of_a_worker_becomes_a_status_too() {
        let status = guarded(|| {
            workers(2)?.join(|| (), || panic!("a planted defect of a worker"));
            Ok(())
        });
        assert_eq!(status, AhStatus::Panicked);
        assert!(words().contains("defect"));
    }
}
