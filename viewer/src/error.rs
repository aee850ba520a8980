//! The error type of this crate.

use std::path::PathBuf;

/// Why a picture could not be made, written or compared.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No driver can draw.
    #[error(
        "no Vulkan driver found ({reason}); install that of the graphics card, or Mesa's for the processor alone \
         (Debian: apt-get install mesa-vulkan-drivers libvulkan1)"
    )]
    NoDriver {
        /// What was looked for, and not found.
        reason: String,
    },
    /// A driver was found but would not start or draw.
    #[error("the driver of {adapter} failed: {reason}")]
    Driver {
        /// The device as it names itself.
        adapter: String,
        /// What it said.
        reason: String,
    },
    /// The program that draws could not.
    #[error("no picture by the program that draws: {why}")]
    Process {
        /// What it said, or how it ended.
        why: String,
    },
    /// More than a device can hold.
    #[error("{what} needs {needed}, but the driver allows {limit}; draw fewer strands or a smaller picture")]
    TooLarge {
        /// What does not fit.
        what: &'static str,
        /// How much it is.
        needed: u64,
        /// How much there may be.
        limit: u64,
    },
    /// An array of a scene has not the length that others give it.
    #[error("{what} has {found} entries, but {expected} are needed")]
    Length {
        /// The array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// What it should be.
        expected: usize,
    },
    /// A triangle names a vertex that is not there.
    #[error("triangle {triangle} of a solid names vertex {vertex}, but it has only {n_vertices}")]
    UnknownVertex {
        /// The triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Vertices there are.
        n_vertices: usize,
    },
    /// A number that a picture depends on makes no sense.
    #[error("{what} is {value}, but must be {must}")]
    BadValue {
        /// The number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// Two pictures of different size have no common measure.
    #[error("pictures of {}x{} and {}x{} pixels cannot be compared", a[0], a[1], b[0], b[1])]
    SizesDiffer {
        /// Width and height of the first.
        a: [usize; 2],
        /// Width and height of the second.
        b: [usize; 2],
    },
    /// There is no program that encodes videos.
    #[error("cannot start ffmpeg to write {path}: {source}; install it (Debian: apt-get install ffmpeg)", path = path.display())]
    NoEncoder {
        /// The file that was to be.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The program that encodes videos gave up.
    #[error("ffmpeg could not write {path}: {said}", path = path.display())]
    Encoder {
        /// The file.
        path: PathBuf,
        /// Its last words.
        said: String,
    },
    /// A picture could not be written.
    #[error("cannot write {path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A picture could not be encoded.
    #[error("cannot encode {path}: {source}", path = path.display())]
    Png {
        /// The file.
        path: PathBuf,
        /// The encoder's reason.
        source: png::EncodingError,
    },
}
