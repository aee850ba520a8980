//! What can be wrong with a call, as a status code and as words.
//!
//! The words of the last failure are kept for each thread, so that two threads with a handle each do not read one
//! another's.

use crate::types::AhStatus;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};

/// Why a call failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Error {
    /// A null pointer where one to something is needed.
    #[error("{what} is null")]
    Null {
        /// Name of the argument.
        what: &'static str,
    },
    /// A pointer to something else than it says.
    #[error("{what} is not aligned as its type demands; it cannot point to one")]
    Misaligned {
        /// Name of the argument.
        what: &'static str,
    },
    /// A count that no array in memory has.
    #[error("{what} is said to have {n} elements, more than memory can hold")]
    TooLong {
        /// Name of the argument.
        what: &'static str,
        /// Its length.
        n: usize,
    },
    /// A path that is no text.
    #[error("{what} is not UTF-8")]
    NotUtf8 {
        /// Name of the argument.
        what: &'static str,
    },
    /// A number out of its range.
    #[error("{what} is {value}; it must be {expected}")]
    Value {
        /// Name of the argument.
        what: &'static str,
        /// What was given.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A matrix that does more than turn and move.
    #[error(
        "the matrix scales, shears or mirrors (its rotation is off by {by}); poses are rigid: bake scale into the solid"
    )]
    NotRigid {
        /// Largest deviation of the columns' products from those of unit vectors.
        by: f64,
    },
    /// A solid that was never given.
    #[error("solid {solid} does not exist; the hair was created with {n_solids}")]
    UnknownSolid {
        /// The index.
        solid: u32,
        /// Solids there are.
        n_solids: usize,
    },
    /// A model that cannot be read.
    #[error("the skinning model cannot be loaded")]
    Model(#[source] io_formats::Error),
    /// A solid that cannot be baked.
    #[error("the solid cannot be used")]
    Solid(#[source] collision::Error),
    /// A runtime that cannot be built.
    #[error("the hair cannot be created")]
    Runtime(#[source] adaptive_runtime::Error),
    /// No worker threads.
    #[error("the worker threads cannot be started")]
    Threads(#[source] rayon::ThreadPoolBuildError),
    /// A defect met before.
    #[error("this hair met a defect of the library before and cannot be used any more; destroy it")]
    Broken,
    /// A defect of the library.
    #[error("the library has a defect: {message}")]
    Panicked {
        /// Where and what.
        message: String,
    },
}

impl Error {
    /// The code a host sees.
    pub(crate) fn status(&self) -> AhStatus {
        match self {
            Self::Null { .. }
            | Self::Misaligned { .. }
            | Self::TooLong { .. }
            | Self::NotUtf8 { .. }
            | Self::Value { .. }
            | Self::NotRigid { .. }
            | Self::UnknownSolid { .. } => AhStatus::BadArgument,
            Self::Model(_) => AhStatus::BadModel,
            Self::Solid(_) => AhStatus::BadSolid,
            Self::Runtime(_) => AhStatus::CannotCreate,
            Self::Threads(_) => AhStatus::NoThreads,
            Self::Broken => AhStatus::Broken,
            Self::Panicked { .. } => AhStatus::Panicked,
        }
    }

    /// The error and what caused it, outermost first.
    fn in_words(&self) -> String {
        let mut words = self.to_string();
        let mut cause = std::error::Error::source(self);
        while let Some(error) = cause {
            words.push_str(": ");
            words.push_str(&error.to_string());
            cause = error.source();
        }
        words
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::new(CString::default());
}

/// Keeps an error for [`last`].
pub(crate) fn remember(error: &Error) {
    // A zero byte would end the text for the host.
    let words = CString::new(error.in_words().replace('\0', " ")).unwrap_or_default();
    // While a thread ends its locals may be gone: the status alone then tells.
    let _ = LAST.try_with(|last| last.replace(words));
}

/// Words of the last failure on this thread, empty if there was none; valid until the next one.
pub(crate) fn last() -> *const c_char {
    const NONE: &CStr = c"";
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(NONE.as_ptr())
}

/// [`last`] as text.
#[cfg(test)]
pub(crate) fn last_words() -> String {
    LAST.with(|last| last.borrow().to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_told_in_one_line() {
        let error = Error::Runtime(adaptive_runtime::Error::SolidCount { given: 1, expected: 2 });
        assert_eq!(
            error.in_words(),
            "the hair cannot be created: the step names 1 solid poses, but the runtime has 2 solids"
        );
    }

    #[test]
    fn the_last_error_is_that_of_the_thread() {
        remember(&Error::Null { what: "here" });
        std::thread::spawn(|| remember(&Error::Null { what: "there" })).join().unwrap();
        assert_eq!(last_words(), "here is null");
    }
}
