//! Videos: frames handed one by one to `ffmpeg`, where that is installed.
//!
//! Nothing of it is linked: the program reads raw frames from a pipe. Without it the caller is told what to install and
//! can still write one PNG file a frame.

use crate::error::Error;
use crate::image::Image;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A video in the making.
#[derive(Debug)]
pub struct Video {
    path: PathBuf,
    size: [usize; 2],
    child: Child,
}

impl Video {
    /// Begins a video (H.264; `path` ends in `.mp4` or `.mkv`) of frames of this size, so many a second.
    ///
    /// # Errors
    /// [`Error::NoEncoder`] where there is no ffmpeg.
    pub fn create(path: &Path, width: usize, height: usize, fps: f64) -> Result<Self, Error> {
        let child = Command::new("ffmpeg")
            .args(["-hide_banner", "-loglevel", "error", "-y"])
            .args(["-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &format!("{width}x{height}"), "-r", &fps.to_string(), "-i", "-"])
            // The usual players want even sizes and halved chroma.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-preset", "medium", "-crf", "18"])
            .args(["-pix_fmt", "yuv420p", "-movflags", "+faststart"])
            .arg(path)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|source| Error::NoEncoder { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), size: [width, height], child })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// A frame of another size, or what ffmpeg says.
    pub fn push(&mut self, frame: &Image) -> Result<(), Error> {
        if [frame.width, frame.height] != self.size {
            return Err(Error::SizesDiffer { a: self.size, b: [frame.width, frame.height] });
        }
        let written = self.child.stdin.as_mut().map(|pipe| pipe.write_all(&frame.rgb));
        // A pipe that broke means that ffmpeg has ended: why, only it knows.
        if matches!(written, Some(Ok(()))) { Ok(()) } else { Err(self.last_words()) }
    }

    /// Ends the video; the file is whole after this.
    ///
    /// # Errors
    /// What ffmpeg says.
    pub fn finish(mut self) -> Result<(), Error> {
        drop(self.child.stdin.take());
        let said = self.said();
        let status = self.child.wait().map_err(|source| Error::Io { path: self.path.clone(), source })?;
        if status.success() { Ok(()) } else { Err(Error::Encoder { path: self.path.clone(), said }) }
    }

    fn said(&mut self) -> String {
        let mut said = String::new();
        if let Some(mut pipe) = self.child.stderr.take() {
            // Unreadable last words are no words.
            let _ = pipe.read_to_string(&mut said);
        }
        said.trim().to_owned()
    }

    fn last_words(&mut self) -> Error {
        drop(self.child.stdin.take());
        Error::Encoder { path: self.path.clone(), said: self.said() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn has_ffmpeg() -> bool {
        let found = Command::new("ffmpeg").arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        if found.is_err() {
            println!("skipped: there is no ffmpeg here (Debian: apt-get install ffmpeg)");
        }
        found.is_ok()
    }

    #[test]
    fn a_video_of_odd_size_is_written_whole_and_a_frame_of_another_size_refused() {
        if !has_ffmpeg() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("turn.mp4");
        let mut video = Video::create(&path, 33, 21, 24.0).unwrap();
        for k in 0..5 {
            video.push(&Image { width: 33, height: 21, rgb: vec![40 * k; 3 * 33 * 21] }).unwrap();
        }
        let other = Image { width: 34, height: 21, rgb: vec![0; 3 * 34 * 21] };
        assert!(matches!(video.push(&other), Err(Error::SizesDiffer { .. })));
        video.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        // Its kind comes first; its index is written once it is whole.
        assert!(bytes.len() > 1000 && bytes[4..8] == *b"ftyp", "{} bytes", bytes.len());
        assert!(bytes.windows(4).any(|w| w == b"moov"));
    }

    #[test]
    fn a_video_that_cannot_be_written_says_why() {
        if !has_ffmpeg() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let video = Video::create(&folder.path().join("no/such/folder/a.mp4"), 16, 16, 24.0).unwrap();
        let said = video.finish().unwrap_err().to_string();
        assert!(said.contains("a.mp4") && said.contains("No such file"), "{said}");
    }
}
