//! Recorded frames: the trait the trainer reads through, frames in memory for tests, and a store on disk larger than memory.
//!
//! Positions are those of all particles in the head frame (cm), strand-major, root first. A store is a 64-byte header and
//! then one chunk per frame: 24 bytes with the checksum of all that follows in it, time, sequence and length, and the positions
//! to half of [`STEP_CM`], packed. After the last chunk stands where each one ends, so that a damaged frame does not hide the
//! others. Writing streams to `<path>.tmp`, renamed by `finish`: a store that exists is
//! complete. An unfinished one can be taken up again after its last whole frame.

mod joined;
mod packing;

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use crate::envelope::{Kind, MAGIC, check_tag, publish, temporary_path, u64_at};
use crate::error::{Error, Result};

pub use joined::JoinedFrames;
pub use packing::STEP_CM;

/// Version of the store's layout.
pub const VERSION: u32 = 2;

const HEADER_BYTES: usize = 64;
/// Checksum, time, sequence, length of the payload.
const CHUNK_HEADER_BYTES: usize = 24;
/// Frame count of a store that was never finished.
const UNFINISHED: u64 = u64::MAX;

/// Where a frame comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInfo {
    /// Number of the motion sequence; neighbouring frames of different sequences are unrelated.
    pub sequence: u32,
    /// Time within the sequence, in seconds.
    pub time_s: f64,
}

/// Frames that can be read in any order from several threads.
pub trait FrameSource: Sync {
    /// Strands in every frame.
    fn n_strands(&self) -> usize;
    /// Particles per strand.
    fn n_particles(&self) -> usize;
    /// Number of frames.
    fn n_frames(&self) -> usize;
    /// Sequence and time of a frame.
    ///
    /// # Panics
    /// If there is no such frame.
    fn info(&self, frame: usize) -> FrameInfo;
    /// Head-frame positions (cm) of one frame into `out`: `n_strands * n_particles` points, strand-major, root first.
    ///
    /// # Errors
    /// When there is no such frame, `out` has another length, or the bytes are damaged.
    fn read(&self, frame: usize, out: &mut [[f32; 3]]) -> Result<()>;
}

fn check_request(source: &dyn FrameSource, frame: usize, n_out: usize) -> Result<()> {
    let expected = source.n_strands() * source.n_particles();
    if frame >= source.n_frames() {
        let reason = format!("frame {frame} of {} frames", source.n_frames());
        return Err(Error::BadFrame { reason });
    }
    if n_out != expected {
        return Err(Error::BadFrame { reason: format!("a frame has {expected} points, the buffer {n_out}") });
    }
    Ok(())
}

/// Frames held in memory.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MemoryFrames {
    n_strands: usize,
    n_particles: usize,
    infos: Vec<FrameInfo>,
    points: Vec<[f32; 3]>,
}

impl MemoryFrames {
    /// No frames yet.
    #[must_use]
    pub fn new(n_strands: usize, n_particles: usize) -> Self {
        Self { n_strands, n_particles, ..Self::default() }
    }

    /// Adds a frame of `n_strands * n_particles` points.
    ///
    /// # Errors
    /// When the number of points is another.
    pub fn push(&mut self, info: FrameInfo, points: &[[f32; 3]]) -> Result<()> {
        let expected = self.n_strands * self.n_particles;
        if points.len() != expected {
            let reason = format!("a frame has {expected} points, {} were given", points.len());
            return Err(Error::BadFrame { reason });
        }
        self.infos.push(info);
        self.points.extend_from_slice(points);
        Ok(())
    }
}

impl FrameSource for MemoryFrames {
    fn n_strands(&self) -> usize {
        self.n_strands
    }
    fn n_particles(&self) -> usize {
        self.n_particles
    }
    fn n_frames(&self) -> usize {
        self.infos.len()
    }
    fn info(&self, frame: usize) -> FrameInfo {
        self.infos[frame]
    }
    fn read(&self, frame: usize, out: &mut [[f32; 3]]) -> Result<()> {
        check_request(self, frame, out.len())?;
        let n = out.len();
        out.copy_from_slice(&self.points[frame * n..(frame + 1) * n]);
        Ok(())
    }
}

/// The fields of a store's header.
#[derive(Debug, Clone, Copy)]
struct Header {
    n_strands: u32,
    n_particles: u32,
    provenance: u64,
    n_frames: u64,
}

impl Header {
    fn to_bytes(self) -> [u8; HEADER_BYTES] {
        let mut h = [0; HEADER_BYTES];
        h[..8].copy_from_slice(&MAGIC);
        h[8..12].copy_from_slice(&Kind::FRAME_STORE.0);
        h[12..16].copy_from_slice(&VERSION.to_le_bytes());
        h[16..20].copy_from_slice(&self.n_strands.to_le_bytes());
        h[20..24].copy_from_slice(&self.n_particles.to_le_bytes());
        h[24..32].copy_from_slice(&self.provenance.to_le_bytes());
        h[32..40].copy_from_slice(&self.n_frames.to_le_bytes());
        let sum = xxh3_64(&h[..56]);
        h[56..].copy_from_slice(&sum.to_le_bytes());
        h
    }

    fn from_bytes(path: &Path, h: &[u8]) -> Result<Self> {
        check_tag(path, h, HEADER_BYTES, Kind::FRAME_STORE, VERSION)?;
        if xxh3_64(&h[..56]) != u64_at(h, 56) {
            return Err(Error::Checksum { path: path.to_path_buf(), part: "the header".into() });
        }
        let low = u64_at(h, 16);
        let header = Self {
            n_strands: low as u32,
            n_particles: (low >> 32) as u32,
            provenance: u64_at(h, 24),
            n_frames: u64_at(h, 32),
        };
        if header.n_strands == 0 || header.n_particles == 0 {
            return Err(Error::BadField {
                path: path.to_path_buf(),
                field: "strand and particle counts",
                offset: 16,
                reason: format!("{} strands of {} particles", header.n_strands, header.n_particles),
            });
        }
        Ok(header)
    }

    fn points(self) -> u64 {
        u64::from(self.n_strands) * u64::from(self.n_particles)
    }
}

fn chunk_header(info: FrameInfo, payload: &[u8], n_bytes: u32) -> [u8; CHUNK_HEADER_BYTES] {
    let mut c = [0; CHUNK_HEADER_BYTES];
    c[8..16].copy_from_slice(&info.time_s.to_le_bytes());
    c[16..20].copy_from_slice(&info.sequence.to_le_bytes());
    c[20..].copy_from_slice(&n_bytes.to_le_bytes());
    let sum = chunk_checksum(&c[8..], payload);
    c[..8].copy_from_slice(&sum.to_le_bytes());
    c
}

fn chunk_checksum(info: &[u8], payload: &[u8]) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(info);
    hash.update(payload);
    hash.digest()
}

fn chunk_info(c: &[u8]) -> FrameInfo {
    FrameInfo { sequence: u64_at(c, 16) as u32, time_s: f64::from_bits(u64_at(c, 8)) }
}

/// Where chunks end, and the checksum of that.
fn index_bytes(ends: &[u64]) -> Vec<u8> {
    let mut bytes: Vec<u8> = ends.iter().flat_map(|end| end.to_le_bytes()).collect();
    let sum = xxh3_64(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

fn payload_bytes(c: &[u8]) -> u64 {
    u64_at(c, 16) >> 32
}

/// Streams frames to a new store.
#[derive(Debug)]
pub struct FrameStoreWriter {
    file: std::io::BufWriter<File>,
    temporary: PathBuf,
    path: PathBuf,
    header: Header,
    infos: Vec<FrameInfo>,
    /// Where each chunk ends.
    ends: Vec<u64>,
    packed: Vec<u8>,
}

impl FrameStoreWriter {
    /// Starts a store at `path`, discarding an unfinished one. `provenance` is a hash of everything the frames were made from.
    ///
    /// # Errors
    /// When the counts are zero or beyond `u32`, or the file cannot be created.
    pub fn create(path: &Path, n_strands: usize, n_particles: usize, provenance: u64) -> Result<Self> {
        let header = Self::new_header(path, n_strands, n_particles, provenance)?;
        let temporary = temporary_path(path);
        let mut file = File::create(&temporary).map_err(Error::io("create", &temporary))?;
        file.write_all(&header.to_bytes()).map_err(Error::io("write", &temporary))?;
        Ok(Self {
            file: std::io::BufWriter::new(file),
            temporary,
            path: path.to_path_buf(),
            header,
            infos: Vec::new(),
            ends: Vec::new(),
            packed: Vec::new(),
        })
    }

    /// Takes up an unfinished store after its last undamaged frame (see [`FrameStoreWriter::infos`]), or starts a new one
    /// when there is none or it was made from other inputs.
    ///
    /// # Errors
    /// As [`FrameStoreWriter::create`], or when the unfinished file cannot be read.
    pub fn resume(path: &Path, n_strands: usize, n_particles: usize, provenance: u64) -> Result<Self> {
        let header = Self::new_header(path, n_strands, n_particles, provenance)?;
        let temporary = temporary_path(path);
        let Ok(mut file) = OpenOptions::new().read(true).write(true).open(&temporary) else {
            return Self::create(path, n_strands, n_particles, provenance);
        };
        let mut found = [0; HEADER_BYTES];
        if file.read_exact(&mut found).is_err() || found != header.to_bytes() {
            return Self::create(path, n_strands, n_particles, provenance);
        }
        let file_bytes = file.metadata().map_err(Error::io("read", &temporary))?.len();
        let (mut infos, mut ends) = (Vec::new(), Vec::new());
        let mut end = HEADER_BYTES as u64;
        let (mut chunk, mut packed) = ([0; CHUNK_HEADER_BYTES], Vec::new());
        while end + CHUNK_HEADER_BYTES as u64 <= file_bytes {
            file.read_exact(&mut chunk).map_err(Error::io("read", &temporary))?;
            let after = end + CHUNK_HEADER_BYTES as u64 + payload_bytes(&chunk);
            // Allocated only when so many bytes are known to be there.
            if after > file_bytes {
                break;
            }
            packed.resize(payload_bytes(&chunk) as usize, 0);
            file.read_exact(&mut packed).map_err(Error::io("read", &temporary))?;
            if chunk_checksum(&chunk[8..], &packed) != u64_at(&chunk, 0) {
                break;
            }
            infos.push(chunk_info(&chunk));
            ends.push(after);
            end = after;
        }
        file.set_len(end).map_err(Error::io("truncate", &temporary))?;
        file.seek(SeekFrom::Start(end)).map_err(Error::io("seek in", &temporary))?;
        let file = std::io::BufWriter::new(file);
        Ok(Self { file, temporary, path: path.to_path_buf(), header, infos, ends, packed })
    }

    fn new_header(path: &Path, n_strands: usize, n_particles: usize, provenance: u64) -> Result<Header> {
        match (u32::try_from(n_strands), u32::try_from(n_particles)) {
            (Ok(s), Ok(p)) if s > 0 && p > 0 => {
                Ok(Header { n_strands: s, n_particles: p, provenance, n_frames: UNFINISHED })
            }
            _ => Err(Error::CannotWrite {
                path: path.to_path_buf(),
                reason: format!("frames of {n_strands} strands of {n_particles} particles"),
            }),
        }
    }

    /// The frames written so far, those taken over by [`FrameStoreWriter::resume`] included.
    #[must_use]
    pub fn infos(&self) -> &[FrameInfo] {
        &self.infos
    }

    /// Writes one frame: head-frame positions (cm), strand-major; kept to half of [`STEP_CM`].
    ///
    /// # Errors
    /// When the number of points is wrong, a point or the time is not finite, or the disk refuses.
    pub fn append(&mut self, info: FrameInfo, points: &[[f32; 3]]) -> Result<()> {
        if points.len() as u64 != self.header.points() {
            let reason = format!("a frame has {} points, {} were given", self.header.points(), points.len());
            return Err(Error::BadFrame { reason });
        }
        if !info.time_s.is_finite() {
            return Err(Error::BadFrame { reason: format!("time of frame {} is not finite", self.infos.len()) });
        }
        self.packed.clear();
        let n_particles = self.header.n_particles as usize;
        let refuse = |reason: String| Error::BadFrame { reason: format!("frame {}, {reason}", self.infos.len()) };
        packing::pack(points, n_particles, &mut self.packed)
            .map_err(|i| refuse(format!("strand {} is not finite or kilometres away", i / n_particles)))?;
        let n_bytes = u32::try_from(self.packed.len()).map_err(|_| refuse("all of it: too many particles".into()))?;
        let header = chunk_header(info, &self.packed, n_bytes);
        self.file.write_all(&header).map_err(Error::io("write", &self.temporary))?;
        self.file.write_all(&self.packed).map_err(Error::io("write", &self.temporary))?;
        let begin = self.ends.last().copied().unwrap_or(HEADER_BYTES as u64);
        self.ends.push(begin + (header.len() + self.packed.len()) as u64);
        self.infos.push(info);
        Ok(())
    }

    /// Completes the header, flushes to disk and gives the store its name.
    ///
    /// # Errors
    /// When the disk refuses; the unfinished file then stays.
    pub fn finish(self) -> Result<()> {
        let Self { mut file, temporary, path, mut header, infos, ends, .. } = self;
        file.write_all(&index_bytes(&ends)).map_err(Error::io("write", &temporary))?;
        let mut file = file.into_inner().map_err(|e| Error::io("write", &temporary)(e.into_error()))?;
        header.n_frames = infos.len() as u64;
        file.seek(SeekFrom::Start(0)).map_err(Error::io("seek in", &temporary))?;
        file.write_all(&header.to_bytes()).map_err(Error::io("write", &temporary))?;
        publish(file, &temporary, &path)
    }
}

/// A finished store, read by position.
#[derive(Debug)]
pub struct FrameStore {
    path: PathBuf,
    file: PositionedFile,
    header: Header,
    infos: Vec<FrameInfo>,
    /// Where each chunk begins, and where the last one ends.
    start: Vec<u64>,
}

impl FrameStore {
    /// Opens a store and reads where its frames come from; the frames themselves are checked when read.
    ///
    /// # Errors
    /// When the file cannot be read, is no finished frame store of this version, or its length does not fit its counts.
    pub fn open(path: &Path) -> Result<Self> {
        let mut file = File::open(path).map_err(Error::io("read", path))?;
        let file_bytes = file.metadata().map_err(Error::io("read", path))?.len();
        let mut bytes = Vec::with_capacity(HEADER_BYTES);
        (&mut file).take(HEADER_BYTES as u64).read_to_end(&mut bytes).map_err(Error::io("read", path))?;
        let header = Header::from_bytes(path, &bytes)?;
        if header.n_frames == UNFINISHED {
            return Err(Error::BadField {
                path: path.to_path_buf(),
                field: "frame count",
                offset: 32,
                reason: "the store was never finished; record the frames again or resume".into(),
            });
        }
        let actual = file_bytes.saturating_sub(HEADER_BYTES as u64);
        let index_bytes = header.n_frames.saturating_mul(8).saturating_add(8);
        let promised = header.n_frames.saturating_mul(CHUNK_HEADER_BYTES as u64).saturating_add(index_bytes);
        if promised > actual {
            return Err(Error::WrongLength { path: path.to_path_buf(), promised, actual });
        }
        let file = PositionedFile::new(file);
        let mut index = vec![0; index_bytes as usize];
        file.read_exact_at(&mut index, file_bytes - index_bytes).map_err(Error::io("read", path))?;
        let (ends, sum) = index.split_at(index.len() - 8);
        let mut start = vec![HEADER_BYTES as u64];
        start.extend((0..header.n_frames as usize).map(|f| u64_at(ends, 8 * f)));
        let in_order = start.windows(2).all(|w| w[1] >= w[0].saturating_add(CHUNK_HEADER_BYTES as u64));
        if u64_at(sum, 0) != xxh3_64(ends) || !in_order || start.last() != Some(&(file_bytes - index_bytes)) {
            let part = "the index at its end (or the file is cut short)".into();
            return Err(Error::Checksum { path: path.to_path_buf(), part });
        }
        let mut infos = Vec::with_capacity(header.n_frames as usize);
        let mut chunk = [0; CHUNK_HEADER_BYTES];
        for &begin in &start[..header.n_frames as usize] {
            file.read_exact_at(&mut chunk, begin).map_err(Error::io("read", path))?;
            infos.push(chunk_info(&chunk));
        }
        Ok(Self { path: path.to_path_buf(), file, header, infos, start })
    }

    /// Hash of everything the frames were made from, as given to the writer.
    #[must_use]
    pub fn provenance(&self) -> u64 {
        self.header.provenance
    }
}

impl FrameSource for FrameStore {
    fn n_strands(&self) -> usize {
        self.header.n_strands as usize
    }
    fn n_particles(&self) -> usize {
        self.header.n_particles as usize
    }
    fn n_frames(&self) -> usize {
        self.infos.len()
    }
    fn info(&self, frame: usize) -> FrameInfo {
        self.infos[frame]
    }
    fn read(&self, frame: usize, out: &mut [[f32; 3]]) -> Result<()> {
        check_request(self, frame, out.len())?;
        let damaged = || Error::Checksum { path: self.path.clone(), part: format!("frame {frame}") };
        let mut chunk = vec![0; (self.start[frame + 1] - self.start[frame]) as usize];
        self.file.read_exact_at(&mut chunk, self.start[frame]).map_err(Error::io("read", &self.path))?;
        let (header, packed) = chunk.split_at(CHUNK_HEADER_BYTES);
        if chunk_checksum(&header[8..], packed) != u64_at(header, 0) {
            return Err(damaged());
        }
        packing::unpack(packed, self.header.n_particles as usize, out).ok_or_else(damaged)
    }
}

/// Reads at an offset from several threads: directly on Unix, elsewhere by seeking under a lock.
#[derive(Debug)]
struct PositionedFile {
    #[cfg(unix)]
    file: File,
    #[cfg(not(unix))]
    file: std::sync::Mutex<File>,
}

impl PositionedFile {
    #[cfg(unix)]
    fn new(file: File) -> Self {
        Self { file }
    }

    #[cfg(unix)]
    fn read_exact_at(&self, out: &mut [u8], offset: u64) -> std::io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, out, offset)
    }

    #[cfg(not(unix))]
    fn new(file: File) -> Self {
        Self { file: std::sync::Mutex::new(file) }
    }

    #[cfg(not(unix))]
    fn read_exact_at(&self, out: &mut [u8], offset: u64) -> std::io::Result<()> {
        // A reader that panicked leaves only a file position behind, and each read sets its own.
        let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        file.seek(SeekFrom::Start(offset))?;
        file.read_exact(out)
    }
}
